"""The experiment on deforming objects runs on a small generated one, and its table says what it found."""

from pathlib import Path

import numpy as np
import pytest

from docs.deforming_tables import deforming_table
from experiments.deforming import run
from experiments.deforming.pictures import SIZE, strip
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.models.deform import DeformConfig, fit_deform
from gash_jax.models.deforming_model import DeformingModel
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import moving_scene, posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.truth import Truth, write_frames


def test_it_runs_and_its_table_has_every_method(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(run, "RANKS", (4, 12))
    monkeypatch.setattr(run, "COMPONENTS", (3, 9, 99))
    monkeypatch.setattr(run, "RAYS", (4, 16))
    sizes = {"frames": 12, "test_frames": 3, "rays": 8, "test_rays": 64}
    result = run.main(None, "", "bumps", **sizes, work=tmp_path / "work", output=tmp_path / "result.json")
    rows = {row["method"]: row for row in result["rows"]}
    assert rows["PCA floor, 9 components"]["relrmse"] < rows["PCA floor, 3 components"]["relrmse"]
    assert rows["PCA floor, 3 components"]["relrmse"] < rows["mean of the training frames"]["relrmse"]
    assert rows["bake, 16 rays"]["relrmse"] < rows["bake, 4 rays"]["relrmse"]
    assert rows["deform, 4 numbers"]["bytes"] < rows["deform, 12 numbers"]["bytes"]
    assert all(0 <= row["accuracy"] <= 1 for row in rows.values())
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
