"""The experiment on deforming objects runs on a small generated one, and its table says what it found."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from PIL.WebPImagePlugin import WebPImageFile

from docs.deforming_tables import deforming_table
from experiments.deforming import leaving, objects, pictures, run
from experiments.deforming.objects import object_file
from experiments.deforming.yardstick import Frames, Yardstick
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.formats.animations import load_animation
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.sequence import posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere, grid


def grid_mesh() -> Mesh:
    """A wavy sheet over the xy plane whose faces look along +z."""
    u, w, faces = grid(12, 12)
    points = np.stack([u, w, 0.1 * np.sin(6 * u)], axis=1).astype(np.float32)
    return prepare_mesh(points, faces.astype(np.int32))[0]


def test_it_runs_and_its_table_has_every_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(run, "MEGABYTES", (0.1, 1.0))
    monkeypatch.setattr(run, "COMPONENTS", (3, 9, 99))
    monkeypatch.setattr(run, "RAYS", (4, 16))
    monkeypatch.setattr(run, "STEADY", 4)
    sizes = {"frames": 12, "test_frames": 3, "rays": 8, "test_rays": 64}
    folders: dict[str, Any] = {"work": tmp_path / "work", "output": tmp_path / "result.json"}
    result = run.main("bumps", None, "", **sizes, more=(20, 4), also=["again=local"], **folders)
    rows = {row["method"]: row for row in result["rows"]}
    assert rows["PCA floor, 9 components"]["relrmse"] < rows["PCA floor, 3 components"]["relrmse"]
    assert rows["PCA floor, 3 components"]["relrmse"] < rows["mean of the training frames"]["relrmse"]
    assert rows["bake, 16 rays"]["relrmse"] < rows["bake, 4 rays"]["relrmse"]
    assert rows["deform, 0.1 MB"]["bytes"] < rows["deform, 1 MB"]["bytes"]
    assert rows["again, 3 bands"]["relrmse"] == rows["local, 3 bands"]["relrmse"]
    assert all(0 <= row["accuracy"] <= 1 and row["ssim"] <= 1 for row in rows.values())
    assert "momo-prt, 20 frames of 4 rays" in rows and "deform, 0.1 MB, 20 frames of 4 rays" in rows
    assert result["cpu_seconds_a_baked_frame"]["more"] > 0
    assert rows["mean of the training frames"]["flicker"] > 0  # what never moves is off by what moves
    assert rows["deform, 1 MB"]["flicker"] > 0 and rows["bake, 4 rays"]["flicker"] > 0
    text = deforming_table(result)
    assert all(f"| {name} |" in text for name in rows) and "bumps, 642 vertices" in text
    assert "; the others 0." in text
    monkeypatch.setattr(pictures, "FRAMES", 3)
    monkeypatch.setattr(pictures, "SIZE", 48)
    files = tmp_path / "strip.png", tmp_path / "face.webp"
    pictures.main(tmp_path / "work" / "model.npz", tmp_path / "work" / "bumps.npz", "", 8, *files)
    with Image.open(files[1]) as picture:
        assert isinstance(picture, WebPImageFile) and picture.n_frames == 3


def test_the_journeys_run_and_leave_what_was_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(leaving, "STEPS", 3)
    folders: dict[str, Any] = {"work": tmp_path / "work", "output": tmp_path / "result.json"}
    folders["figure"] = tmp_path / "way.png"
    sizes = {"frames": 16, "rays": 8, "test_rays": 64, "images": 0.0}
    result = leaving.main(None, "", "bump 1", **sizes, **folders)
    for told in result["journeys"].values():
        rows = {row["method"]: row["relrmse"] for row in told["rows"]}
        assert set(rows) == {"mean", "momo-prt", "deform"} and all(len(row) == 3 for row in rows.values())
    rows = {row["method"]: row["relrmse"] for row in result["journeys"]["bump 1 left out"]["rows"]}
    assert rows["deform"][2] > rows["deform"][0]  # the shape was never seen
    assert (tmp_path / "way.png").stat().st_size > 0
    assert 0 < result["journeys"]["bump 1 left out"]["training_frames"] < 16


def test_the_sheet_is_flat_and_its_faces_look_up() -> None:
    rest = grid_mesh()
    sheet = leaving.flat_sheet(rest)
    first, second, third = sheet[rest.faces.T]
    across = np.cross(second - first, third - first)
    assert np.ptp(sheet[:, 2]) < 1e-6
    assert (across[:, 2] > 0).mean() > 0.95


def test_the_yardstick_finds_nothing_wrong_with_the_truth_and_much_with_less_light() -> None:
    moving = blendshape_animation(bumpy_sphere(4), 0, 4, 2)
    meshes = list(posed_meshes(moving))
    truth = [0.8 * np.asarray(unshadowed_transfer(mesh.normals, 4)) for mesh in meshes]
    frames = Frames(meshes, truth)
    yardstick = Yardstick(frames, frames, np.ptp(np.stack(truth), axis=(0, 1)), 4)
    exact = yardstick.scores(truth)
    assert exact["relrmse"] == 0 and exact["ssim"] == pytest.approx(1) and exact["accuracy"] == 1
    spoilt = yardstick.scores([0.7 * frame for frame in truth])
    assert spoilt["relrmse"] == pytest.approx(0.3) and spoilt["ssim"] < 0.99
    following = {id(mesh): frame for mesh, frame in zip(meshes, truth, strict=True)}
    assert yardstick.flicker(lambda mesh: following[id(mesh)])["flicker"] == 0
    assert yardstick.flicker(lambda mesh: truth[0])["flicker"] > 1e-3
    for rays, relrmse in ((16, 0.2), (64, 0.1)):
        yardstick.add_bake(rays, {"relrmse": relrmse, "model_ms": 10.0 * rays})
    found = yardstick.against_bakes(0.1 * 2**0.5)
    assert found["equivalent_rays"] == pytest.approx(32) and found["bake_ms"] == pytest.approx(320)
    assert yardstick.against_bakes(0.05) == {"equivalent_rays": ">= 64"}


@pytest.mark.parametrize("name", ["cloth", "figure", "bumps"])
def test_generated_objects_are_files_that_training_reads(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(objects, "FRAMES", 3)
    animation = load_animation(object_file(name, None, tmp_path))
    assert len(animation) >= 3 and len(animation.mesh.vertices) > 500
    with pytest.raises(ValueError, match="--animation"):
        object_file("face", None, tmp_path)
