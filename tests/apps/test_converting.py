"""`gash convert`, from the command line."""

import json
from pathlib import Path

import numpy as np
import pytest

import gash_jax
from gash_jax.apps.cli import gash, main
from gash_jax.formats.gltf_document import open_document
from gash_jax.formats.hdr import write_hdr
from gash_jax.light.environment import Light, load_light, save_light
from gash_jax.prt.transfer import Transfer, load_transfer, save_transfer
from gash_jax.shapes.primitives import icosphere
from tests.formats.test_gltf_writing import accessors
from tests.geometry.mesh_files import CUBE, CUBE_QUADS, obj

BALL = icosphere(1)
RNG = np.random.default_rng(8)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """t.npz with four bands and error bars, l.npz with three, map.hdr."""
    monkeypatch.chdir(tmp_path)
    values = RNG.normal(size=(len(BALL.vertices), 16)).astype(np.float32)
    save_transfer("t.npz", Transfer(values, np.abs(values), *BALL, {}))
    save_light("l.npz", Light(RNG.normal(size=(9, 3)).astype(np.float32), {}))
    write_hdr("map.hdr", RNG.uniform(0.1, 1, size=(8, 16, 3)))
    return tmp_path


def run(*arguments: str) -> None:
    gash.main(["convert", *arguments], standalone_mode=False)


def refused(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *arguments: str) -> str:
    """The one line of a refusal; nothing but the inputs is left."""
    before = sorted(Path().iterdir())
    monkeypatch.setattr("sys.argv", ["gash", "convert", *arguments])
    with pytest.raises(SystemExit) as stop:
        main()
    said = capsys.readouterr().err
    assert stop.value.code == 2 and said.startswith("error: ") and said.count("\n") == 1
    assert sorted(Path().iterdir()) == before
    return said


def test_a_light_goes_and_comes_back(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("three", "unity", "filament", "e3nn"):
        run("l.npz", "--to", name, "-o", "there.json")
        run("there.json", "--from", name, "-o", "back.npz")
        np.testing.assert_allclose(load_light("back.npz").coefficients, load_light("l.npz").coefficients, atol=1e-5)
    assert "wrote there.json for Unity SphericalHarmonicsL2" in capsys.readouterr().out
    run("l.npz", "--to", "d3dx", "--bands", "2", "-o", "two.txt")
    assert np.loadtxt("two.txt").shape == (4, 3)


def test_a_transfer_goes_and_comes_back(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("t.npz", "--to", "mitsuba", "-o", "there.npz")
    assert "left behind: standard_error" in capsys.readouterr().out
    run("there.npz", "--from", "mitsuba", "-o", "back.npz")
    gash_jax.save_mesh("ball.ply", BALL)
    run("t.npz", "--to", "unreal", "--bands", "3", "-o", "there.txt")
    run("there.txt", "--from", "unreal", "--mesh", "ball.ply", "-o", "three.npz", "--quiet")
    first, back, three = (load_transfer(name) for name in ("t.npz", "back.npz", "three.npz"))
    np.testing.assert_allclose(back.coefficients, first.coefficients, atol=1e-6)
    np.testing.assert_allclose(three.coefficients, first.coefficients[:, :9], atol=1e-6)
    np.testing.assert_array_equal(back.faces, BALL.faces)


def test_for_pifu_with_the_faces_of_their_loader(folder: Path) -> None:
    Path("cube_100k.obj").write_bytes(obj(CUBE, CUBE_QUADS))
    mesh = gash_jax.load_mesh("cube_100k.obj")
    save_transfer("cube.npz", Transfer(gash_jax.unshadowed_transfer(mesh.normals, 3), None, *mesh, {}))
    run("cube.npz", "--to", "pifu", "--mesh", "cube_100k.obj", "-o", "bounce0.txt")
    theirs = [face for q in CUBE_QUADS for face in (q[:3], [q[2], q[3], q[0]])]
    assert np.load("face.npy").tolist() == theirs
    np.testing.assert_allclose(np.loadtxt("bounce0.txt")[:, 0], np.sqrt(np.pi) / 2, atol=1e-6)


def test_a_map_is_turned(folder: Path) -> None:
    run("map.hdr", "--to", "mitsuba", "-o", "turned.hdr")
    half = np.diag([-1.0, 1.0, -1.0])
    turned = gash_jax.rotate_light(load_light("map.hdr"), half)
    np.testing.assert_allclose(load_light("turned.hdr").coefficients, turned.coefficients, atol=1e-4)


def test_an_asset_for_engines(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("t.npz", "-o", "a.glb", "--store", "short")
    assert "42 vertices, _SH0 _SH1 _SH2 _SH3, rounded by" in capsys.readouterr().out
    assert len(accessors(Path("a.glb").read_bytes(), "_SH3")[0]) == 42
    run("t.npz", "-o", "uv.glb", "--attributes", "uv", "--bands", "3", "--mesh", "a.glb", "--weld", "which.npz")
    assert len(accessors(Path("uv.glb").read_bytes(), "TEXCOORD_5")[0]) == 42
    assert "wrote which.npz: file_vertex" in capsys.readouterr().out
    assert np.load("which.npz")["file_vertex"].tolist() == list(range(42))


def test_an_asset_in_the_numbers_of_unity(folder: Path) -> None:
    """The sum over k of what a shader reads and SphericalHarmonicsL2 is the radiance."""
    run("t.npz", "-o", "u.glb", "--to", "unity-gltf", "--attributes", "uv", "--bands", "3", "--store", "short")
    data = Path("u.glb").read_bytes()
    (mesh,) = open_document(data, Path()).json["meshes"]
    extras = mesh["extras"]["gash"]
    stored = np.concatenate([accessors(data, name)[0] for name in extras["attributes"]], axis=1)
    rows = (stored * np.array(extras["scale"]) + np.array(extras["offset"]))[:, : extras["coefficients"]]
    run("l.npz", "--to", "unity-gltf", "-o", "l.json")
    sh = np.array(json.loads(Path("l.json").read_text())["SphericalHarmonicsL2"])
    coefficients = np.asarray(load_transfer("t.npz").coefficients)[:, :9]
    assert extras["convention"] == "unity-gltf"
    np.testing.assert_allclose(rows @ sh.T, gash_jax.shade(coefficients, load_light("l.npz")), atol=2e-3)


def test_coloured_transfer_and_points(folder: Path, capsys, monkeypatch) -> None:
    coloured = Transfer(RNG.normal(size=(42, 9, 3)).astype(np.float32), None, *BALL, {})
    save_transfer("c.npz", coloured)
    save_transfer("p.npz", coloured._replace(faces=np.zeros((0, 3), np.int32)))
    run("c.npz", "-o", "c.glb")
    assert "_SHR0 _SHR1 _SHR2 _SHG0" in capsys.readouterr().out
    said = refused(capsys, monkeypatch, "c.npz", "-o", "cuv.glb", "--attributes", "uv")
    assert "27 numbers need 15 sets" in said
    assert "has no faces" in refused(capsys, monkeypatch, "p.npz", "-o", "p.glb")
    assert "no place for red" in refused(capsys, monkeypatch, "c.npz", "--to", "pifu", "-o", "bounce0.txt")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("t.npz", "-o", "x.json"), "give --to NAME, --from NAME, or an output that ends in .glb"),
        (("t.npz", "-o", "x.glb", "--from", "unity"), "give --to NAME, --from NAME"),
        (("t.npz", "-o", "x.glb", "--to", "unity"), "t.npz: 4 bands, and Unity SphericalHarmonicsL2 reads 3"),
        (("t.npz", "--to", "three", "-o", "x.json"), "t.npz: 4 bands, and three.js LightProbe reads 3: keep"),
        (("l.npz", "--to", "three", "--bands", "2", "-o", "x.json"), "l.npz: 2 bands, and three.js LightProbe reads 3"),
        (("l.npz", "--to", "three", "--bands", "4", "-o", "x.json"), "l.npz has 3 bands, not 4"),
        (("t.npz", "--to", "three", "-o", "t.npz"), "cannot write t.npz: it is the input t.npz"),
        (("l.npz", "-o", "x.glb"), "l.npz is a light, and a .glb holds a transfer"),
        (("map.hdr", "-o", "x.glb"), "a map is turned for a program: give --to NAME"),
        (("map.hdr", "--to", "three", "-o", "x.json"), "written as .hdr"),
        (("map.hdr", "--to", "e3nn", "-o", "x.hdr"), "no latitude-longitude maps of its own"),
        (("t.npz", "-o", "x.glb", "--attributes", "uv"), "16 numbers need 8 sets of texture coordinates"),
        (("t.npz", "-o", "x.glb", "--mesh", "absent.glb"), "no such file: absent.glb"),
        (("t.npz", "-o", "x.glb", "--mesh", "map.hdr"), "map.hdr is no .glb"),
        (("t.npz", "-o", "x.glb", "--weld", "t.npz"), "cannot write t.npz: it is the input t.npz"),
        (("t.npz", "-o", "x.glb", "--weld", "map.txt"), "let it end in .npz"),
        (("map.hdr", "--to", "three", "-o", "x.hdr", "--bands", "3"), "--bands cuts our own"),
        (("l.npz", "--to", "three", "-o", "x.json", "--store", "byte"), "name the output so"),
        (("absent.npz", "--to", "three", "-o", "x.json"), "no such file: absent.npz"),
        (("l.npz", "--from", "three", "-o", "x.npz"), "are our own: it needs no --from"),
        (("l.npz", "--to", "three", "-o", "x.exr"), "numbers are written as .npz .json .txt .npy"),
        (("l.npz", "--to", "pifu", "--mesh", "t.npz", "-o", "x.npy"), "a light has none: leave it out"),
        (("l.npz", "--to", "maya", "-o", "x.npz"), "Invalid value for '--to'"),
    ],
)
def test_what_cannot_be_meant_is_refused(arguments, message: str, folder: Path, capsys, monkeypatch) -> None:
    assert message in refused(capsys, monkeypatch, *arguments)


def test_transfers_that_are_not_finite_are_refused(folder: Path, capsys, monkeypatch) -> None:
    arrays = dict(np.load("t.npz"))
    arrays["coefficients"][3, 3] = np.nan
    np.savez("nan.npz", **arrays)
    assert "not finite" in refused(capsys, monkeypatch, "nan.npz", "-o", "x.glb")
