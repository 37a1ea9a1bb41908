"""The experiment on deforming objects runs on a small generated one, and its table says what it found."""

from pathlib import Path

import numpy as np
import pytest

from docs.deforming_tables import deforming_table
from experiments.deforming import leaving, objects, run
from experiments.deforming.objects import STEPS, object_file, path_between
from experiments.deforming.pictures import SIZE, strip
from experiments.deforming.yardstick import Frames, Yardstick
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.formats.animations import load_animation
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.models.deform import DeformConfig, fit_deform
from gash_jax.models.deforming_model import DeformingModel
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import moving_scene, posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere, grid
from gash_jax.train.truth import Truth, write_frames


def grid_mesh() -> Mesh:
    """A wavy sheet over the xy plane whose faces look along +z."""
    u, w, faces = grid(12, 12)
    points = np.stack([u, w, 0.1 * np.sin(6 * u)], axis=1).astype(np.float32)
    return prepare_mesh(points, faces.astype(np.int32))[0]


def test_it_runs_and_its_table_has_every_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(run, "RANKS", (4, 12))
    monkeypatch.setattr(run, "COMPONENTS", (3, 9, 99))
    monkeypatch.setattr(run, "RAYS", (4, 16))
    monkeypatch.setattr(run, "STEADY", 4)
    sizes = {"frames": 12, "test_frames": 3, "rays": 8, "test_rays": 64}
    folders = {"work": tmp_path / "work", "output": tmp_path / "result.json"}
    result = run.main("bumps", None, "", **sizes, also=["again=local"], **folders)
    rows = {row["method"]: row for row in result["rows"]}
    assert rows["PCA floor, 9 components"]["relrmse"] < rows["PCA floor, 3 components"]["relrmse"]
    assert rows["PCA floor, 3 components"]["relrmse"] < rows["mean of the training frames"]["relrmse"]
    assert rows["bake, 16 rays"]["relrmse"] < rows["bake, 4 rays"]["relrmse"]
    assert rows["deform, 4 numbers"]["bytes"] < rows["deform, 12 numbers"]["bytes"]
    assert rows["again, 3 bands"]["relrmse"] == rows["local, 3 bands"]["relrmse"]
    assert all(0 <= row["accuracy"] <= 1 and row["ssim"] <= 1 for row in rows.values())
    assert rows["deform, 12 numbers"]["flicker"] > 0 and rows["bake, 4 rays"]["flicker"] > 0
    text = deforming_table(result)
    assert all(f"| {name} |" in text for name in rows) and "bumps, 642 vertices" in text


def test_the_strip_has_a_row_for_each_way_and_a_column_for_each_frame(tmp_path: Path) -> None:
    moving = blendshape_animation(bumpy_sphere(4), 0, 3, 2)
    scene = moving_scene(moving)
    files = []
    for number, mesh in enumerate(posed_meshes(moving)):
        path = tmp_path / f"{number}.npz"
        found = np.asarray(unshadowed_transfer(mesh.normals, 4), np.float16)[None]
        write_frames(path, {"coefficients": found}, 0.0, 0.0)
        files.append(path)
    truth = Truth(scene, 4, 1, tuple(files), 0.0, 0.0)
    config = DeformConfig("deform", 4, patches=2)
    arrays = fit_deform(config, TrainingPoses(moving, truth.shards()))
    picture = strip(DeformingModel(config, arrays, moving.mesh, {}), truth)
    assert picture.width > 3 * SIZE and picture.height > 3 * SIZE


def test_the_journeys_run_and_leave_what_was_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(leaving, "STEPS", 3)
    folders = {"work": tmp_path / "work", "output": tmp_path / "result.json", "figure": tmp_path / "way.png"}
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
    across = np.cross(*(sheet[rest.faces[:, i]] - sheet[rest.faces[:, 0]] for i in (1, 2)))
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


def test_a_path_leads_from_pose_to_pose() -> None:
    moving = blendshape_animation(bumpy_sphere(4), 0, 4, 2)
    path = path_between(moving)
    assert len(path) == 2 * STEPS + 1
    np.testing.assert_allclose(path.parameters[[0, STEPS, -1]], moving.parameters[:3])
    middle = (moving.parameters[0] + moving.parameters[1]) / 2
    np.testing.assert_allclose(path.parameters[STEPS // 2], middle, atol=1e-6)


@pytest.mark.parametrize("name", ["cloth", "figure", "bumps"])
def test_generated_objects_are_files_that_training_reads(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(objects, "FRAMES", 3)
    animation = load_animation(object_file(name, None, tmp_path))
    assert len(animation) >= 3 and len(animation.mesh.vertices) > 500
    with pytest.raises(ValueError, match="--animation"):
        object_file("face", None, tmp_path)
