"""Animations from the command line: baked, fitted, tested, written out, and what is refused."""

import json
from pathlib import Path

import click
import numpy as np
import pytest

from gash_jax.apps.cli import gash
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import Rows, read_npz, write_npz_rows
from gash_jax.files.settings import ConfigError
from gash_jax.formats.animations import load_animation
from gash_jax.geometry.mesh import MeshError
from gash_jax.models.deforming_model import load_deforming_model
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.sequence import posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere

TRAIN = ("train", "deform", "data.animation={}/frames.npz")
SHORT = ("data.frames=12", "data.test_frames=2", "data.rays=8", "data.test_rays=16", "model.bands=2", "--quiet")


def run(*arguments: object) -> None:
    gash.main([str(argument) for argument in arguments], standalone_mode=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of blendshapes, recorded frames of it, and a run that was fitted to it."""
    folder = tmp_path_factory.mktemp("animating")
    moving = blendshape_animation(bumpy_sphere(4), 0, 9, 4)
    shapes = {"base": moving.motion.rest, "delta": moving.motion.deltas, "faces": moving.mesh.faces}  # type: ignore[union-attr]
    np.savez(folder / "bumps.npz", **shapes)
    np.savez(folder / "frames.npz", verts=np.stack(list(moving.frames())), faces=moving.mesh.faces)
    run("train", "deform", f"data.animation={folder / 'bumps.npz'}", "model.patches=3", "-o", folder / "run", *SHORT)
    return folder


def test_a_bake_is_the_bake_of_every_frame(folder: Path, capsys: pytest.CaptureFixture) -> None:
    run("animate", folder / "frames.npz", "-o", folder / "baked.npz", "--bands", 2, "--rays", 8)
    assert "9 frames x 162 vertices" in capsys.readouterr().out
    arrays, metadata = read_npz(folder / "baked.npz", "transfer", ())
    assert arrays["coefficients"].dtype == np.float16 and arrays["coefficients"].shape == (9, 162, 4)
    assert metadata["format"] == "gash-animated-transfer" and metadata["parameters"]["rays"] == 8
    mesh = list(posed_meshes(load_animation(folder / "frames.npz")))[4]
    expected = bake_transfer(mesh, 2, 8, replicates=1, seed=4).coefficients
    np.testing.assert_array_equal(arrays["coefficients"][4], expected.astype(np.float16))
    np.testing.assert_array_equal(arrays["vertices"][4], mesh.vertices)
    np.testing.assert_array_equal(arrays["normals"][4], mesh.normals.astype(np.float16))
    assert "visibility" not in arrays


def test_a_glossy_bake_says_what_every_vertex_sees(folder: Path) -> None:
    options = ("--bands", 2, "--rays", 8, "--glossy", "--vertices", "0:100", "--rest", "occlude", "--quiet")
    run("animate", folder / "frames.npz", "-o", folder / "glossy.npz", *options)
    arrays, metadata = read_npz(folder / "glossy.npz", "transfer", ())
    mesh = list(posed_meshes(load_animation(folder / "frames.npz")))[4]
    expected = bake_transfer(mesh, 2, 8, replicates=1, seed=4, rows=slice(0, 100), glossy=True)
    np.testing.assert_array_equal(arrays["visibility"][4], np.asarray(expected.visibility))
    np.testing.assert_array_equal(arrays["vertices"][4], mesh.vertices[:100])
    assert metadata["parameters"] == {"rays": 8, "rows": [0, 100], "glossy": True}
    with pytest.raises(click.UsageError, match="--glossy is baked"):
        run("animate", folder / "frames.npz", "-o", folder / "new", "--model", folder / "run", "--glossy")


def test_the_page_shows_what_was_baked_and_what_was_said(folder: Path, tmp_path: Path) -> None:
    options = ("--bands", 2, "--rays", 8, "--quiet")
    run("animate", folder / "frames.npz", "-o", tmp_path / "baked.npz", *options)
    run("animate", folder / "frames.npz", "-o", tmp_path / "said.npz", "--model", folder / "run", "--quiet")
    run("view", tmp_path / "baked.npz", tmp_path / "said.npz", "-o", tmp_path / "page.html", "--quiet")
    text = (tmp_path / "page.html").read_text()
    assert 'data-name="bake, 8 rays a vertex"' in text and 'data-name="deform"' in text


def test_a_run_is_fitted_tested_exported_and_used(folder: Path, capsys: pytest.CaptureFixture) -> None:
    scores = json.loads((folder / "run" / "scores.json").read_text())
    assert scores["test_frames"] == 2 and 0 < scores["relrmse"] < 0.5 and 0 < scores["accuracy"] <= 1
    assert scores["bytes"] == (folder / "run" / "model.npz").stat().st_size
    run("animate", folder / "frames.npz", "-o", folder / "said.npz", "--model", folder / "run")
    assert "ms a frame" in capsys.readouterr().out
    model = load_deforming_model(folder / "run")
    arrays, metadata = read_npz(folder / "said.npz", "transfer", ())
    positions = load_animation(folder / "frames.npz").frame(4)
    np.testing.assert_array_equal(arrays["coefficients"][4], np.asarray(model(positions), np.float16))
    assert metadata["method"] == "deform"
    run("export", folder / "run", "-o", folder / "weights.npz")
    run("animate", folder / "frames.npz", "-o", folder / "again.npz", "--model", folder / "weights.npz", "--quiet")
    again = read_npz(folder / "again.npz", "transfer", ())[0]["coefficients"]
    np.testing.assert_array_equal(again, arrays["coefficients"])
    run("evaluate", folder / "weights.npz", folder / "frames.npz", "--rays", 64, "-o", folder / "scores.json")
    (row,) = json.loads((folder / "scores.json").read_text())["rows"]
    assert row["frames"] == 9 and {"relrmse", "accuracy", "l1", "skill", "flicker"} <= row.keys()
    run("info", folder / "weights.npz")
    assert capsys.readouterr().out


def test_frames_of_a_file_are_split_in_time(folder: Path) -> None:
    run("train", "momo-prt", f"data.animation={folder / 'frames.npz'}", "-o", folder / "recorded", *SHORT)
    assert json.loads((folder / "recorded" / "scores.json").read_text())["test_frames"] == 1
    assert len(load_deforming_model(folder / "recorded").arrays["middle"]) == 4  # of 8 frames of 4 shapes


def test_a_network_over_images_is_trained_and_used(folder: Path, capsys: pytest.CaptureFixture) -> None:
    small = ("model.size=16", "model.levels=2", "model.channels=2", "train.steps=3", *SHORT)
    run("train", "deep-prt-small", f"data.animation={folder / 'bumps.npz'}", "-o", folder / "images", *small)
    assert json.loads((folder / "images" / "scores.json").read_text())["test_frames"] == 2
    run("animate", folder / "frames.npz", "-o", folder / "drawn.npz", "--model", folder / "images")
    assert "ms a frame" in capsys.readouterr().out
    assert read_npz(folder / "drawn.npz", "transfer", ())[1]["method"] == "deep-prt"


def test_a_pose_outside_is_said(folder: Path, capsys: pytest.CaptureFixture) -> None:
    shapes = dict(np.load(folder / "bumps.npz"))
    np.savez(folder / "wild.npz", **shapes, parameters=np.array([[0.5, 0, 0, 0], [9, 9, 9, 9]]))
    run("animate", folder / "wild.npz", "-o", folder / "wild_out.npz", "--model", folder / "run")
    assert "1 frames (first: 1) are outside the poses" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "match", "arguments"),
    [
        (ConfigError, "data.animation=FILE", ("train", "deform", "-o", "{}/new")),
        (FileError, "no such file", ("train", "deform", "data.animation={}/absent.npz", "-o", "{}/new")),
        (ConfigError, "bake it with gash animate", ("train", "deform", "data.animation={}/one.npz", "-o", "{}/new")),
        (ValueError, "need blendshapes", (*TRAIN, "data.poses=random", "-o", "{}/new")),
        (ConfigError, "poses = 'all'", ("train", "deform", "data.poses=all", "-o", "{}/new")),
        (FileError, "no model", ("animate", "{}/frames.npz", "-o", "{}/new", "--model", "{}/absent")),
        (MeshError, "this model is of one mesh", ("animate", "{}/one.npz", "-o", "{}/new", "--model", "{}/run")),
        (MeshError, "no part of a mesh", ("animate", "{}/frames.npz", "-o", "{}/new", "--vertices", "0:999")),
        (FileError, "it is the input", ("animate", "{}/frames.npz", "-o", "{}/frames.npz")),
        (MeshError, "are not finite", ("animate", "{}/nan.npz", "-o", "{}/new")),
        (MeshError, "one list for each frame", ("animate", "{}/faces.npz", "-o", "{}/new")),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(folder: Path, error: type, match: str, arguments: tuple[str, ...]) -> None:
    mesh = bumpy_sphere(3)
    frames = np.stack([mesh.vertices] * 3)
    np.savez(folder / "one.npz", verts=frames[:1], faces=mesh.faces)
    np.savez(folder / "faces.npz", verts=frames, faces=np.stack([mesh.faces] * 3))
    frames[1, 5] = np.nan
    np.savez(folder / "nan.npz", verts=frames, faces=mesh.faces)
    with pytest.raises(error, match=match):
        run(*(argument.format(folder) for argument in arguments))
    assert not (folder / "new").exists()


def test_rows_that_do_not_fill_a_file_leave_none(tmp_path: Path) -> None:
    path, rows = tmp_path / "rows.npz", np.arange(12.0).reshape(3, 4)
    large = {"rows": Rows(iter(rows), (3, 4)), "wide": Rows(iter(rows / 7), (3, 4), "<f4")}
    write_npz_rows(path, large, {"other": np.ones(2)}, {"kind": "test"})
    arrays, metadata = read_npz(path, "rows", ("rows", "other"))
    np.testing.assert_array_equal(arrays["rows"], rows)
    np.testing.assert_array_equal(arrays["wide"], (rows / 7).astype(np.float32))
    assert metadata == {"kind": "test"} and arrays["rows"].dtype == np.float16
    for shape in ((2, 4), (4, 4), (3, 5)):
        with pytest.raises(FileError, match="cannot write"):
            write_npz_rows(tmp_path / "no.npz", {"rows": Rows(iter(rows), shape)}, {}, {})
    assert [path.name for path in tmp_path.iterdir()] == ["rows.npz"]
