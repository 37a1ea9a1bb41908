"""A folder of meshes as training data: labels are plain bakes, kept by content; mistakes are named."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.files.settings import ConfigError
from gash_jax.formats.meshes import save_mesh
from gash_jax.models.families import model_config
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bounce_series import bake_series
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train import own_meshes
from gash_jax.train.config import DataConfig, RunConfig, TrainConfig
from gash_jax.train.run import run_config, training_items


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "meshes"
    place.mkdir()
    save_mesh(place / "b.ply", bumpy_sphere(4))
    save_mesh(place / "a.ply", bumpy_sphere(5))
    (place / "notes.txt").write_text("not a mesh")
    return place


def test_labels_are_plain_bakes_kept_by_content(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    items = own_meshes.folder_items(folder, 8, 3)
    assert [item.kind for item in items] == ["a", "b"]
    expected = bake_transfer(items[0].mesh, 3, 8, replicates=1).coefficients
    np.testing.assert_array_equal(items[0].coefficients, expected)
    monkeypatch.setattr(own_meshes, "baked_labels", None)  # nothing is baked again
    (folder / "c.ply").write_bytes((folder / "a.ply").read_bytes())
    again = own_meshes.folder_items(folder, 8, 3)
    np.testing.assert_array_equal(again[2].coefficients, expected)
    with pytest.raises(TypeError):
        own_meshes.folder_items(folder, 16, 3)


def test_folders_that_are_none(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no such folder"):
        own_meshes.folder_items(tmp_path / "absent", 8, 3)
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match="holds no mesh: readable are .ply"):
        own_meshes.folder_items(tmp_path / "empty", 8, 3)


def _run(folder: Path, **train: Any) -> RunConfig:
    data = DataConfig(folder=str(folder), validation_folder=str(folder), rays=8)
    settings: dict[str, Any] = {"steps": 3, "batch_vertices": 1024, **train}
    return RunConfig(model=model_config("mlp", channels=8, layers=1), data=data, train=TrainConfig(**settings))


def test_a_network_is_trained_on_them_and_tuned_further(folder: Path, tmp_path: Path) -> None:
    path, validation = run_config(_run(folder), tmp_path / "run")
    assert [item.kind for item in validation] == ["a", "b"]
    tuned, _ = run_config(_run(folder, start_from=str(path)), tmp_path / "tuned")
    assert tuned.is_file()
    other = replace(_run(folder, start_from=str(path)), model=model_config("mlp", channels=16, layers=1))
    with pytest.raises(ConfigError, match="holds another network"):
        run_config(other, tmp_path / "other")
    with pytest.raises(ConfigError, match="set train.batch_vertices"):
        training_items(_run(folder, batch_vertices=200))


def test_generated_shapes_take_the_place_of_a_folder_that_is_not_named(folder: Path) -> None:
    few: dict[str, Any] = {"shapes": 2, "validation_shapes": 1, "rays": 8, "min_vertices": 150, "max_vertices": 200}
    training, validation, _ = training_items(replace(_run(folder), data=DataConfig(folder=str(folder), **few)))
    assert [item.kind for item in training] == ["a", "b"] and len(validation) == 1
    training, validation, _ = training_items(
        replace(_run(folder), data=DataConfig(validation_folder=str(folder), **few))
    )
    assert len(training) == 2 and [item.kind for item in validation] == ["a", "b"]


def test_labels_with_bounces_are_kept_apart(folder: Path) -> None:
    plain, bounced = own_meshes.folder_items(folder, 8, 3)[0], own_meshes.folder_items(folder, 8, 3, bounces=1)[0]
    series = bake_series(bounced.mesh, 3, 8, 1)
    assert plain.bounced is None and bounced.bounced is not None
    np.testing.assert_array_equal(bounced.bounced[:, 0], series.terms[1])
    np.testing.assert_array_equal(bounced.noise, series.spread)
