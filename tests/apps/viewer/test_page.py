"""`gash view` and `gash_jax.view` without a browser: what stands in the page, what is refused."""

import re
import webbrowser
from pathlib import Path

import click
import numpy as np
import pytest

import gash_jax
from gash_jax.apps.viewer import page as pages
from gash_jax.apps.viewer.contents import distinct, map_file, result_name, shrunk
from gash_jax.files.atomic import FileError
from gash_jax.light.environment import load_light
from gash_jax.prt.transfer import load_transfer
from tests.apps.viewer.conftest import Frames, held, lopsided, run


def test_a_page_holds_results_with_one_mesh_and_lights_with_their_maps(folder: Path) -> None:
    files = held((folder / "page.html").read_text())
    names = ["bake, 64 rays a vertex", "bake, 16 rays a vertex", "bake, 32 rays a vertex, 2 bounces", "lopsided.hdr"]
    assert [(kind, name) for kind, name, _ in files] == [
        *(("transfer", name) for name in names[:3]),
        ("light", names[3]),
    ]
    glossy = load_transfer(folder / "glossy.npz")
    np.testing.assert_array_equal(files[0][2]["coefficients"], glossy.coefficients)
    np.testing.assert_array_equal(files[0][2]["visibility"], glossy.visibility)
    np.testing.assert_array_equal(files[0][2]["faces"], glossy.faces)
    assert "faces" not in files[1][2] and files[2][2]["coefficients"].shape == (812, 9, 3)
    np.testing.assert_allclose(files[3][2]["map"], lopsided(), rtol=0.01, atol=20 / 256)
    np.testing.assert_allclose(
        files[3][2]["coefficients"][:9], load_light(folder / "lopsided.hdr").coefficients, atol=1e-5
    )


def test_a_page_asks_nothing_of_the_network(folder: Path) -> None:
    text = (folder / "page.html").read_text()
    assert re.findall(r'<(?:script|link|img|iframe)[^>]*(?:src|href)="(?!data:)[^"]*"', text) == []
    assert "@import" not in text and "{{" not in re.sub(r"<script type=\"module\">.*", "", text, flags=re.DOTALL)


def test_a_mesh_is_baked_and_predicted_first(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda address: bool(opened.append(address) or True))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    run("view", folder / "ball.ply", "--quiet")
    (written,) = tmp_path.glob("gash-view-*/ball.html")
    assert opened == [written.as_uri()]
    names = [name for _, name, _ in held(written.read_text())]
    assert names == [
        "bake, 256 rays a vertex", "prediction, network local", "a generated studio", "the same from everywhere",
    ]  # fmt: skip


def test_results_of_different_meshes_or_none_are_refused(folder: Path, tmp_path: Path) -> None:
    run("bake", folder / "ball.ply", "-o", tmp_path / "two.npz", "--rays", 16, "--bands", 2, "--quiet")
    with pytest.raises(ValueError, match="the two files have 2 and 3 bands"):
        run("view", folder / "few.npz", tmp_path / "two.npz", "-o", tmp_path / "page.html")
    with pytest.raises(FileError, match="no such file"):
        run("view", tmp_path / "absent.npz", "-o", tmp_path / "page.html")
    with pytest.raises(FileError, match="it is the input"):
        run("view", folder / "few.npz", "-o", folder / "few.npz")
    with pytest.raises(click.UsageError, match="--layout says how the map of --light"):
        run("view", folder / "few.npz", "--layout", "latlong", "-o", tmp_path / "page.html")
    with pytest.raises(ValueError, match="light 'light' has fewer bands"):
        gash_jax.view(load_transfer(folder / "few.npz"), load_light(folder / "studio.hdr", 2))
    with pytest.raises(ValueError, match="there is nothing to show"):
        gash_jax.view({})
    assert not (tmp_path / "page.html").exists()


def test_a_notebook_shows_the_page_inline(folder: Path) -> None:
    transfer = load_transfer(folder / "few.npz")
    shown = gash_jax.view({"one": transfer, "two": transfer}, {"mine": load_light(folder / "studio.hdr")})
    assert [name for _, name, _ in held(shown.html)] == [
        "bake, 16 rays a vertex (one)", "bake, 16 rays a vertex (two)", "mine",
    ]  # fmt: skip
    inline = shown._repr_html_()
    assert inline.startswith('<iframe srcdoc="&lt;!doctype html&gt;') and inline.count('"') == 4


@pytest.mark.parametrize("title", ["{{script}}", "<b>&\"'", "<!-- files -->"])
def test_names_cannot_break_the_page(folder: Path, title: str) -> None:
    transfer = load_transfer(folder / "few.npz")
    text = pages.make_page(title, {title: transfer, "b": transfer}, []).html
    assert f"<title>{title}</title>" not in text or title == "{{script}}"
    assert len(held(text)) == 2 and text.count("</script>") == 3


def test_names_say_what_a_result_is() -> None:
    assert result_name({"method": "bake", "parameters": {"rays": 4096}}) == "reference, 4096 rays a vertex"
    assert result_name({"method": "predict", "parameters": {"model": {"name": "mlp"}}}) == "prediction, network mlp"
    assert result_name({"method": "bake", "parameters": {}}) == "bake" and result_name({}) == "transfer"
    assert distinct(["a", "b", "a"], ["1.npz", "2.npz", "3.npz"]) == ["a (1.npz)", "b", "a (3.npz)"]


def test_a_page_that_is_too_large_is_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "LARGEST", 1 << 20)
    one = load_transfer(folder / "few.npz")
    big = one._replace(visibility=np.random.default_rng(0).normal(size=(812, 25)).astype(np.float32))
    with pytest.raises(FileError, match="the page would have 2 MiB, more than 1"):
        pages.make_page("many", {str(i): big for i in range(12)}, [])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vertices": np.zeros((2, 492, 3), np.float32)}, "do not fit"),
        ({"coefficients": np.zeros((3, 492, 5), np.float32)}, "5 coefficients are no square"),
        ({"coefficients": np.full((3, 492, 4), np.nan)}, "coefficients that are not finite in frame 0"),
        ({"faces": np.array([[0, 1, 492]])}, "vertices that do not exist"),
        ({"faces": np.zeros((1, 3))}, "give whole numbers"),
        ({"faces": None}, "no vertices or faces"),
    ],
)
def test_frames_that_do_not_belong_together_are_refused(
    frames: Frames, tmp_path: Path, change: dict[str, np.ndarray | None], words: str
) -> None:
    arrays = {**np.load(frames.path), **change}
    np.savez(tmp_path / "bad.npz", **{key: value for key, value in arrays.items() if value is not None})
    with pytest.raises(FileError, match=words):
        run("view", tmp_path / "bad.npz", "-o", tmp_path / "page.html", "--quiet")


def test_maps_are_shrunk_by_means() -> None:
    image = np.arange(8 * 1024 * 3, dtype=np.float32).reshape(8, 1024, 3)
    small = shrunk(image)
    assert small.shape == (4, 512, 3)
    np.testing.assert_allclose(small[0, 0], image[:2, :2].mean((0, 1)))
    np.testing.assert_array_equal(shrunk(image[:, :16]), image[:, :16])


def test_a_light_file_is_read_in_the_bands_that_are_needed(folder: Path, tmp_path: Path) -> None:
    run("light", folder / "studio.hdr", "-o", tmp_path / "studio.npz", "--bands", 4, "--quiet")
    assert map_file(tmp_path / "studio.npz", 3).arrays["coefficients"].shape == (9, 3)
    assert map_file(folder / "studio.hdr", 3).arrays["coefficients"].shape == (100, 3)
