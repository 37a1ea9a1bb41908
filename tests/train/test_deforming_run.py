"""Which frames of a file a model is fitted to, and which it is tested on."""

from pathlib import Path

import numpy as np
import pytest

from experiments.deforming.objects import object_file
from gash_jax.files.settings import ConfigError
from gash_jax.shapes.primitives import icosphere
from gash_jax.train import deforming_run
from gash_jax.train.config import DataConfig, load_config
from gash_jax.train.deforming_run import rays_of_frames, run_deforming, split_animation


@pytest.fixture
def recorded(tmp_path: Path) -> str:
    mesh = icosphere(1)
    path = tmp_path / "frames.npz"
    np.savez(
        path, verts=np.stack([mesh.vertices * (1 + t) for t in range(20)]), faces=mesh.faces, times=np.arange(20.0)
    )
    return str(path)


def numbers(data: DataConfig) -> tuple[list[int], list[int]]:
    training, test = (scene.animation for scene in split_animation(data))
    assert training.seconds is not None and training.seconds.tolist() == training.parameters[:, 0].tolist()
    return training.parameters[:, 0].astype(int).tolist(), test.parameters[:, 0].astype(int).tolist()


def test_the_last_frames_are_for_the_test(recorded: str) -> None:
    training, test = numbers(DataConfig(animation=recorded, test_frames=3))
    assert training == list(range(17)) and test == [17, 18, 19]


def test_or_frames_between_the_others(recorded: str) -> None:
    training, test = numbers(DataConfig(animation=recorded, test_frames=4, poses="between"))
    assert test == [2, 7, 12, 17]
    assert sorted(training + test) == list(range(20)) and not set(training) & set(test)


def test_never_more_than_a_fifth_and_no_more_than_asked_for(recorded: str) -> None:
    for poses in ("file", "between"):
        training, test = numbers(DataConfig(animation=recorded, test_frames=50, frames=10, poses=poses))
        assert len(test) == 4 and len(training) == 10


def test_frames_get_the_more_rays_the_fewer_they_are_and_what_is_asked_for_stays() -> None:
    data = DataConfig(rays=0)
    assert [rays_of_frames(data, frames) for frames in (2, 450, 600, 1800, 10**6)] == [256, 256, 192, 64, 64]
    assert all(450 * 256 >= frames * rays_of_frames(data, frames) for frames in range(450, 1801, 150))
    assert rays_of_frames(DataConfig(rays=7), 10**6) == 7
    assert load_config("deform").data.rays == load_config("momo-prt").data.rays == 0
    with pytest.raises(ConfigError, match=r"data\.rays=0 is for models of an object that deforms: give gnn some rays"):
        load_config("gnn", ["data.rays=0"])


def test_a_run_says_how_many_rays_its_frames_had(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GASH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(deforming_run, "MOST_RAYS", 16)
    monkeypatch.setattr(deforming_run, "FEWEST_RAYS", 8)
    file = object_file("bumps", None, tmp_path)
    data = [f"data.animation={file}", "data.frames=6", "data.test_frames=2", "data.test_rays=32", "model.bands=2"]
    _, found = run_deforming(load_config("momo-prt", data), tmp_path / "run")
    assert (found["frames"], found["rays"]) == (6, 16)
    monkeypatch.setattr(deforming_run, "ALL_RAYS", 60)
    _, found = run_deforming(load_config("momo-prt", data), tmp_path / "other")
    assert found["rays"] == 10
