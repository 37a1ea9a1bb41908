"""What the experiment on rotation holds its subjects to."""

import numpy as np
from scipy.spatial.transform import Rotation

from experiments.rotation.exact import exact_matrix, generators
from experiments.rotation.products import error_bars


def test_generators_by_hand() -> None:
    """Band 1 is (y, z, x); a turn about z takes x to y, so d/da (y, z, x) = (x, 0, -y)."""
    np.testing.assert_allclose(generators(1)[2], [[0, 0, 1], [0, 0, 0], [-1, 0, 0]], atol=1e-15)
    for band in range(10):
        about = generators(band)
        np.testing.assert_allclose(about, -np.swapaxes(about, 1, 2), atol=1e-14)
        np.testing.assert_allclose(about[0] @ about[1] - about[1] @ about[0], about[2], atol=1e-13)


def test_the_exact_matrix_composes() -> None:
    one, two = (Rotation.random(rng=np.random.default_rng(seed)) for seed in (0, 1))
    both = exact_matrix((one * two).as_rotvec(), 10)
    np.testing.assert_allclose(exact_matrix(one.as_rotvec(), 10) @ exact_matrix(two.as_rotvec(), 10), both, atol=1e-12)


def test_turned_error_bars_stay_calibrated() -> None:
    for row in error_bars(4, reference_rays=2048):
        assert 0.85 < row["ratio"] < 1.15 and 0.92 < row["coverage"] <= 1.0
