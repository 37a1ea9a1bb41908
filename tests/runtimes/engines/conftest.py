"""Transfers, and what `gash convert` makes of them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.apps.cli import gash
from gash_jax.light.environment import Light, save_light
from gash_jax.prt.transfer import Transfer, save_transfer
from gash_jax.shapes.primitives import icosphere

BALL = icosphere(2)
QUARTERS = (0.2, -0.5, 0.7, 0.4)  # x, y, z, w of a turn about no axis of the world; made unit below
TURN = tuple(float(q) for q in Rotation.from_quat(QUARTERS).as_quat())


def matrix(quaternion: tuple[float, ...]) -> np.ndarray:
    return Rotation.from_quat(quaternion).as_matrix()


def convert(*arguments: Any) -> None:
    gash.main(["convert", *map(str, arguments), "--quiet"], standalone_mode=False)


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """grey.npz and coloured.npz with four bands, light.npz; every coefficient counts, so none can go missing."""
    folder = tmp_path_factory.mktemp("engines")
    rng = np.random.default_rng(17)
    for name, shape in (("grey", (len(BALL.vertices), 16)), ("coloured", (len(BALL.vertices), 16, 3))):
        values = rng.uniform(-1, 1, size=shape).astype(np.float32)
        save_transfer(folder / f"{name}.npz", Transfer(values, None, *BALL, {}))
    for name, bands in (("light", 4), ("nine", 3)):
        numbers = np.random.default_rng(5).normal(size=(16, 3)).astype(np.float32)[: bands * bands]
        save_light(folder / f"{name}.npz", Light(numbers, {}))
    return folder
