"""Files on the command line: an output is never an input, a map's layout is named or certain, notes are told."""

import json
from pathlib import Path

import click
import numpy as np
import OpenEXR
import pytest

from gash_jax.apps.cli import gash
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.formats.hdr import LightError, write_hdr
from gash_jax.formats.meshes import mesh_files, save_mesh
from gash_jax.light.environment import load_light
from gash_jax.light.layouts import pixel_rays
from gash_jax.models.model import shipped_models
from gash_jax.shapes.primitives import icosphere


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mesh, its bake, a map, a light and weights."""
    folder = tmp_path_factory.mktemp("made")
    save_mesh(folder / "ball.ply", icosphere(1))
    write_hdr(folder / "sky.hdr", np.ones((8, 16, 3)))
    (folder / "weights.npz").write_bytes(shipped_models()["local"].read_bytes())
    (folder / "run").mkdir()
    (folder / "run" / "model.npz").write_bytes(shipped_models()["local"].read_bytes())
    for command in (["bake", "ball.ply", "-o", "ball.npz", "--rays", "16"], ["light", "sky.hdr", "-o", "sky.npz"]):
        _run(folder, *command, "--quiet")
    return folder


def _run(folder: Path, *arguments: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        gash.main(list(arguments), standalone_mode=False)


@pytest.mark.parametrize(
    ("command", "source"),
    [
        ("bake ball.ply", "ball.ply"),
        ("bake ball.ply --auto --light sky.hdr", "sky.hdr"),
        ("predict ball.ply", "ball.ply"),
        ("predict ball.ply --model weights.npz", "weights.npz"),
        ("light sky.hdr", "sky.hdr"),
        ("light sky.npz", "sky.npz"),
        ("render ball.npz --light sky.hdr", "ball.npz"),
        ("render ball.npz --light sky.hdr", "sky.hdr"),
        ("render ball.npz --light sky.npz", "sky.npz"),
        ("export run", "run/model.npz"),
        ("evaluate weights.npz ball.ply", "ball.ply"),
        ("evaluate weights.npz ball.ply", "weights.npz"),
        ("evaluate run ball.ply", "run/model.npz"),
        ("predict ball.ply --model run", "run/model.npz"),
        ("bench ball.ply --model run", "run/model.npz"),
        ("bench ball.ply --model weights.npz", "weights.npz"),
        ("bench ball.ply", "ball.ply"),
    ],
)
def test_an_output_named_like_an_input_is_refused(made: Path, command: str, source: str) -> None:
    """Under its name, by another path and by a link; the input stays as it was."""
    before = (made / source).read_bytes()
    link = made / "link"
    link.unlink(missing_ok=True)
    link.symlink_to(source)
    for name in (source, f"../{made.name}/{source}", str(made / source), "link"):
        with pytest.raises(FileError, match="it is the input .*, give the output another name"):
            _run(made, *command.split(), "-o", name)
    assert (made / source).read_bytes() == before and link.is_symlink()


@pytest.mark.parametrize("command", ["bake", "predict", "bench", "evaluate weights.npz"])
def test_what_a_mesh_names_is_an_input(made: Path, command: str) -> None:
    """A .gltf keeps its corners, and its pictures, in files of their own."""
    for name in ("scene data.bin", "skin.png"):
        (made / name).write_bytes(b"kept")
    document = {"buffers": [{"uri": "scene%20data.bin", "byteLength": 4}, {"uri": "data:,x", "byteLength": 1}]}
    (made / "scene.gltf").write_text(json.dumps({**document, "images": [{"uri": "skin.png"}, {"bufferView": 0}]}))
    for name in ("scene data.bin", "skin.png", "scene.gltf"):
        before = (made / name).read_bytes()
        with pytest.raises(FileError, match="it is the input .*, give the output another name"):
            _run(made, *command.split(), "scene.gltf", "-o", name)
        assert (made / name).read_bytes() == before


def test_damaged_scenes_name_no_files(made: Path) -> None:
    for text in (b"", b"{", b"[1]", b'{"buffers": [3]}', b'{"buffers": [{"uri": 3}]}', b"glTF\1\0\0\0", b"\xff\xfe{"):
        (made / "cut.gltf").write_bytes(text)
        assert mesh_files(made / "cut.gltf") == [made / "cut.gltf"]
    assert mesh_files(made / "absent.gltf") == [made / "absent.gltf"]


def test_outputs_that_are_no_files_are_refused(made: Path) -> None:
    for command in (["bake", "ball.ply"], ["render", "ball.npz", "--light", "sky.hdr"], ["light", "sky.hdr"]):
        with pytest.raises(FileError, match="it is a device or a pipe"):
            _run(made, *command, "-o", "/dev/null")


def test_a_layout_is_named_recognised_or_asked_for(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A sky in an equal-area square: 1.7725 with its layout, refused without, naming the option."""
    sky = np.repeat(pixel_rays("equal-area", 64, 64).directions[..., 1:2] > 0, 3, axis=-1).astype(float)
    write_hdr(made / "square.hdr", sky)
    with pytest.raises(LightError, match="--layout latlong|angular|cross|equal-area"):
        _run(made, "light", "square.hdr", "-o", "square.npz")
    assert not (made / "square.npz").exists()
    for command in (["plan", "ball.ply", "--light"], ["render", "ball.npz", "-o", "p.png", "--light"]):
        with pytest.raises(LightError, match="--layout"):
            _run(made, *command, "square.hdr")
    _run(made, "light", "square.hdr", "-o", "square.npz", "--layout", "equal-area")
    np.testing.assert_allclose(load_light(made / "square.npz").coefficients[0], 1.7725, atol=0.06)
    for command in (
        ["plan", "ball.ply", "--light", "square.hdr"],
        ["bake", "ball.ply", "-o", "b.npz", "--auto", "--light", "square.hdr"],
        ["render", "ball.npz", "-o", "p.png", "--size", "32", "--light", "square.hdr"],
    ):
        _run(made, *command, "--layout", "equal-area")
    disk = np.ones((32, 32, 3)) * (pixel_rays("angular", 32, 32).solid_angles > 0)[..., None]
    write_hdr(made / "probe.hdr", disk)
    capsys.readouterr()
    _run(made, "light", "probe.hdr", "-o", "probe.npz")
    assert "read as an angular map (light probe) by its black corners" in capsys.readouterr().out
    _, metadata = read_npz(made / "probe.npz", "light", ())
    assert metadata["layout"] == "angular" and len(metadata["notes"]) == 1


def test_layouts_without_a_map(made: Path) -> None:
    for command in (["plan", "ball.ply"], ["bake", "ball.ply", "-o", "b.npz"], ["demo", "-o", "d"]):
        with pytest.raises(click.UsageError, match="--layout says how the map of --light is laid out"):
            _run(made, *command, "--layout", "cross")
    with pytest.raises(LightError, match="a light file, which has no layout"):
        _run(made, "light", "sky.npz", "-o", "again.npz", "--layout", "cross")
    with pytest.raises(click.BadParameter, match="mirror"):
        _run(made, "light", "sky.hdr", "-o", "again.npz", "--layout", "mirror")


def test_what_reading_decided_is_told(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    image = np.ones((8, 16, 3), np.float32)
    image[2, 2] = -1e-6
    ap0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
    header = {"type": OpenEXR.scanlineimage, "chromaticities": ap0, "envmap": OpenEXR.ENVMAP_LATLONG}
    OpenEXR.File(header, {"RGB": image}).write(str(made / "map.exr"))
    for command in (["light", "map.exr", "-o", "m.npz"], ["render", "ball.npz", "--light", "map.exr", "-o", "p.png"]):
        _run(made, *command)
        out = capsys.readouterr().out
        assert all(words in out for words in ("3 negative values", "converted to Rec. 709", "envmap = latlong"))
    _run(made, "light", "map.exr", "-o", "m.npz", "--quiet")
    assert capsys.readouterr().out == ""


def test_info_refuses_a_transfer_that_does_not_fit(made: Path) -> None:
    arrays, metadata = read_npz(made / "ball.npz", "transfer", ())
    write_npz(made / "bad.npz", {**arrays, "faces": arrays["faces"] + 1}, metadata)
    with pytest.raises(FileError, match="faces name vertices that do not exist"):
        _run(made, "info", "bad.npz")
    _run(made, "info", "ball.npz")
