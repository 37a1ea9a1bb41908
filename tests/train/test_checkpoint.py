"""Checkpoints: what was written comes back, what was damaged is recognised, the one before takes its place."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.settings import ConfigError
from gash_jax.train.checkpoint import BEFORE, NEWEST, has_checkpoint, restore_checkpoint, save_checkpoint


def _state(value: float) -> dict[str, np.ndarray]:
    return {"weights": np.full((40, 5), value, np.float32), "step": np.array(3)}


def _largest(folder: Path) -> Path:
    return max((path for path in folder.rglob("*") if path.is_file()), key=lambda path: path.stat().st_size)


def _flip(folder: Path) -> None:
    path = _largest(folder)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x10
    path.write_bytes(bytes(data))


def _cut(folder: Path) -> None:
    path = _largest(folder)
    path.write_bytes(path.read_bytes()[:-5])


def _empty(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


def _drop(folder: Path) -> None:
    _largest(folder).unlink()


@pytest.fixture(scope="module")
def saved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    assert not has_checkpoint(folder)
    save_checkpoint(folder, _state(1.0))
    save_checkpoint(folder, _state(2.0))
    return folder


def test_the_newest_comes_back_and_there_is_nothing_to_say(saved: Path) -> None:
    state, note = restore_checkpoint(saved, _state(0.0))
    np.testing.assert_array_equal(state["weights"], 2.0)
    assert note == "" and has_checkpoint(saved)


@pytest.mark.parametrize("damage", [_flip, _cut, _empty, _drop], ids=lambda damage: damage.__name__)
def test_a_damaged_one_gives_way_to_the_one_before(saved: Path, tmp_path: Path, damage: Callable[[Path], None]) -> None:
    folder = tmp_path / "run"
    shutil.copytree(saved, folder)
    damage(folder / NEWEST)
    state, note = restore_checkpoint(folder, _state(0.0))
    np.testing.assert_array_equal(state["weights"], 1.0)
    assert "is damaged: continued from the checkpoint before it" in note
    damage(folder / BEFORE)
    with pytest.raises(ConfigError, match="holds no whole checkpoint"):
        restore_checkpoint(folder, _state(0.0))


def test_an_interruption_between_the_renames_loses_nothing(saved: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(saved, folder)
    shutil.rmtree(folder / NEWEST)
    assert has_checkpoint(folder)
    np.testing.assert_array_equal(restore_checkpoint(folder, _state(0.0))[0]["weights"], 1.0)


def test_another_structure_is_refused_in_one_line(saved: Path) -> None:
    with pytest.raises(ConfigError, match="holds no whole checkpoint"):
        restore_checkpoint(saved, {"weights": np.zeros((40, 6), np.float32), "other": np.zeros(2)})
