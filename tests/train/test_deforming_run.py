"""Which frames of a file a model is fitted to, and which it is tested on."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.shapes.primitives import icosphere
from gash_jax.train.config import DataConfig
from gash_jax.train.deforming_run import split_animation


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
