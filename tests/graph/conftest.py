"""One mesh and one rotation for the room."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from tests.helpers.bumpy import bumpy_mesh, random_rotation


@pytest.fixture(scope="session")
def bumpy() -> Mesh:
    return bumpy_mesh(300)


@pytest.fixture(scope="session")
def rotation() -> np.ndarray:
    return random_rotation(1)
