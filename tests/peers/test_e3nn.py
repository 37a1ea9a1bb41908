"""Live parity of rotations with e3nn's Wigner D. Needs the extra `peers` (`make peers`).

e3nn's polar axis is y: what it calls x, y, z are our y, z, x.
"""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.algebra import motors
from gash_jax.algebra.rotor_quadrature import rotate_by_rotor
from gash_jax.algebra.sh_rotation import sh_rotation_blocks

e3nn: Any = pytest.importorskip("e3nn_jax", reason="needs e3nn-jax: make peers")
ORDER = np.array([1, 2, 0])


@pytest.mark.parametrize("band", range(10))
def test_our_blocks_are_those_of_e3nn(band: int) -> None:
    rotations = Rotation.random(20, rng=np.random.default_rng(band)).as_matrix().astype(np.float32)
    theirs = np.asarray(e3nn.Irrep(band, (-1) ** band).D_from_matrix(rotations[:, ORDER[:, None], ORDER]))
    np.testing.assert_allclose(sh_rotation_blocks(rotations, band + 1)[band], theirs, atol=3e-5)
    unit = np.eye((band + 1) ** 2, dtype=np.float32)[band**2 :]
    by_rotor = rotate_by_rotor(unit, motors.matrix_to_rotor(rotations)[:, None, :])[..., band**2 :]
    np.testing.assert_allclose(np.swapaxes(by_rotor, 1, 2), theirs, atol=3e-5)
