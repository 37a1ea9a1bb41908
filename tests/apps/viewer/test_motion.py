"""What a page keeps of animations: all of short ones, the less wrong of two ways of long ones, and what it says."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.apps.viewer import page as pages
from gash_jax.apps.viewer.components import Error, Series, expanded
from gash_jax.apps.viewer.motion import keep, total
from gash_jax.apps.viewer.moving import read_moving
from gash_jax.files.atomic import FileError
from gash_jax.geometry.mesh import angle_weighted_normals
from gash_jax.shapes.primitives import bumpy_sphere
from tests.apps.viewer.conftest import FRAMES, Frames, held, kept_components, long_animation, run


def test_a_short_animation_stays_as_it_is(frames: Frames, tmp_path: Path) -> None:
    run("view", frames.path, "-o", tmp_path / "page.html", "--quiet")
    arrays = held((tmp_path / "page.html").read_text())[0][2]
    np.testing.assert_array_equal(arrays["coefficients"], frames.coefficients)
    np.testing.assert_array_equal(arrays["visibility"], frames.visibility)
    metadata = json.loads(str(arrays["metadata"]))
    assert metadata["notes"] == [f"492 vertices, 980 faces, {FRAMES} frames"]
    low, step = (np.array(metadata["grid"][key]) for key in ("low", "step"))
    vertices = np.stack([mesh.vertices for mesh in frames.meshes])
    np.testing.assert_allclose(low + arrays["vertices"] * step, vertices, atol=0.51 * step.max())
    normals = np.stack([mesh.normals for mesh in frames.meshes])
    np.testing.assert_allclose(arrays["normals"], normals, atol=2.0**-11)


def test_a_long_animation_is_rebuilt_from_components_and_says_so(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    path = long_animation(tmp_path / "long.npz")
    monkeypatch.setattr(pages, "LARGEST", 2_000_000)
    run("view", path, "--light", folder / "studio.hdr", "-o", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert len(text) <= 2_000_000
    given, arrays = np.load(path), held(text)[0][2]
    words = {"coefficients": "coefficients", "vertices": "positions", "normals": "normals", "visibility": "visibility"}
    notes = json.loads(str(arrays["metadata"]))["notes"]
    assert notes[1].startswith("all 60 frames, rebuilt from principal components")
    assert notes[2].startswith("one in 3 of the frames would fit, and be further off: coefficients by ")
    said = capsys.readouterr().out
    for name, shown in words.items():
        one = kept_components(arrays, name)
        apart = (expanded(one) - given[name]).astype(float)
        unit = np.sqrt(np.mean(given[name].astype(float) ** 2))
        if name == "vertices":
            unit = np.linalg.norm(np.ptp(given[name].reshape(-1, 3).astype(float), axis=0)) / 2
        elif name == "normals":
            unit = 3**-0.5
        (note,) = (note for note in notes if note.startswith(f"{shown} from "))
        assert f"from {len(one.components)} components" in note and note in said
        numbers = [float(word) / 100 for word in note.replace(":", "").split() if word.replace(".", "").isdigit()][1:]
        wanted = [np.sqrt(np.mean(apart**2)) / unit, np.abs(apart).max() / unit]
        assert numbers == pytest.approx(wanted, rel=0.06)  # two digits are said
    assert np.sqrt(np.mean((given["coefficients"] - given["coefficients"].mean(0)) ** 2)) > 1e-3  # it does change


def test_frames_that_repeat_are_left_out_rather(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = long_animation(tmp_path / "twos.npz", twice=True)
    monkeypatch.setattr(pages, "LARGEST", 2_400_000)
    run("view", path, "--light", folder / "studio.hdr", "-o", tmp_path / "page.html", "--quiet")
    given, arrays = np.load(path), held((tmp_path / "page.html").read_text())[0][2]
    notes = json.loads(str(arrays["metadata"]))["notes"]
    assert notes[1:] == ["30 of 60 frames: a page of all of them would be too large"]
    np.testing.assert_array_equal(arrays["coefficients"], given["coefficients"][::2])


def test_the_less_wrong_way_is_taken() -> None:
    moving = np.linspace(0, 1, 30)[:, None, None] * np.random.default_rng(0).normal(size=(200, 2))
    smooth = {"0 coefficients": Series(moving, 1.0)}
    kept = keep(smooth, 10 * 2 * 400)
    assert kept.components is not None and kept.frames == list(range(30)) and len(kept.notes) == 3
    steps = {"0 coefficients": Series(np.repeat(np.random.default_rng(0).normal(size=(10, 200, 2)), 3, axis=0), 1.0)}
    kept = keep(steps, 10 * 2 * 400)
    assert kept.components is None and kept.frames == list(range(0, 30, 3))
    assert keep(smooth, 30 * 2 * 400) == (list(range(30)), None, [])  # all of it fits
    assert keep(smooth, 2 * 400).components is None  # no room for a mean
    assert total({"a": Error(3.0, 9.0), "b": Error(4.0, 9.0)}) == 5.0


def test_several_animations_share_the_room(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [long_animation(tmp_path / f"{name}.npz", seed=name) for name in (1, 2)]
    monkeypatch.setattr(pages, "LARGEST", 2_000_000)
    run("view", *paths, "--light", folder / "studio.hdr", "-o", tmp_path / "page.html", "--quiet")
    text = (tmp_path / "page.html").read_text()
    first, second = (arrays for kind, _, arrays in held(text) if kind == "transfer")
    assert len(text) <= 2_000_000 and "coefficients_components" in second and "vertices_components" in first
    assert "faces" not in second and "vertices_mean" not in second


def test_normals_of_the_file_are_taken_and_others_computed(tmp_path: Path) -> None:
    ball = bumpy_sphere(5)
    vertices = np.stack([ball.vertices, 2 * ball.vertices])
    arrays: dict[str, Any] = {
        "coefficients": np.ones((2, len(ball.vertices), 4), np.float16),
        "vertices": vertices,
        "faces": ball.faces,
    }
    np.savez(tmp_path / "bare.npz", **arrays)
    wanted = angle_weighted_normals(ball.vertices.astype(float), ball.faces).astype(np.float16)
    bare = read_moving(tmp_path / "bare.npz")
    assert bare is not None and bare.visibility is None
    np.testing.assert_array_equal(bare.normals, np.stack([wanted] * 2))
    np.savez(tmp_path / "own.npz", **arrays, normals=np.stack([-wanted] * 2))
    own = read_moving(tmp_path / "own.npz")
    assert own is not None
    np.testing.assert_array_equal(own.normals, -bare.normals)
    cases: list[tuple[dict[str, Any], str]] = [
        ({"normals": wanted}, "do not fit its vertices"),
        ({"normals": np.full((2, len(wanted), 3), np.nan)}, "normals that are not finite in frame 0"),
        ({"visibility": np.ones((2, len(wanted), 4), np.float16)}, "its visibility has shape"),
        ({"visibility": np.full((2, len(wanted), 9), np.inf, np.float16)}, "visibility that are not finite"),
    ]
    for bad, words in cases:
        np.savez(tmp_path / "bad.npz", **arrays, **bad)
        with pytest.raises(FileError, match=words):
            read_moving(tmp_path / "bad.npz")
