import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from gash_jax.formats.gltf_clips import interpolated
from gash_jax.geometry.mesh import MeshError

KEYS = np.array([0.0, 0.5, 2.0, 2.25])
TIMES = np.array([-1.0, 0.0, 0.2, 0.5, 1.9, 2.1, 2.25, 9.0])
RNG = np.random.default_rng(0)


def test_linear_is_that_of_numpy() -> None:
    values = RNG.normal(size=(4, 1, 3))
    found = interpolated(TIMES, KEYS, values, "LINEAR", False)
    expected = np.stack([np.interp(TIMES, KEYS, values[:, 0, axis]) for axis in range(3)], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_rotations_are_those_of_scipy() -> None:
    turns = Rotation.random(4, rng=RNG)
    quaternions = turns.as_quat()
    quaternions[2] *= -1  # the same rotation the long way round
    found = interpolated(TIMES, KEYS, quaternions[:, None], "LINEAR", True)
    expected = Slerp(KEYS, turns)(np.clip(TIMES, 0, 2.25))
    assert (Rotation.from_quat(found) * expected.inv()).magnitude().max() < 1e-7
    still = interpolated(TIMES, KEYS, np.tile(quaternions[:1], (4, 1))[:, None], "LINEAR", True)
    np.testing.assert_allclose(still, np.tile(quaternions[:1], (len(TIMES), 1)), atol=1e-12)


def test_steps_hold_until_the_next_key() -> None:
    found = interpolated(TIMES, KEYS, np.arange(4.0).reshape(4, 1, 1), "STEP", False)
    np.testing.assert_array_equal(found[:, 0], [0, 0, 0, 1, 1, 2, 3, 3])


def test_cubic_splines_are_those_of_scipy() -> None:
    values = RNG.normal(size=(4, 3, 2))
    values[:, 0] = values[:, 2]  # scipy has one tangent at a key
    found = interpolated(TIMES, KEYS, values, "CUBICSPLINE", False)
    expected = CubicHermiteSpline(KEYS, values[:, 1], values[:, 2])(np.clip(TIMES, 0, 2.25))
    np.testing.assert_allclose(found, expected, atol=1e-12)
    turned = interpolated(TIMES, KEYS, RNG.normal(size=(4, 3, 4)), "CUBICSPLINE", True)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), 1)


@pytest.mark.parametrize(("mode", "parts"), [("LINEAR", 1), ("STEP", 1), ("CUBICSPLINE", 3)])
def test_one_key_holds_for_ever(mode: str, parts: int) -> None:
    values = np.zeros((1, parts, 2))
    values[0, -1 if parts == 1 else 1] = [3, 4]
    np.testing.assert_array_equal(interpolated(TIMES, KEYS[:1], values, mode, False), [[3, 4]] * len(TIMES))


def test_other_ways_are_refused() -> None:
    with pytest.raises(MeshError, match="unknown interpolation 'BEZIER'"):
        interpolated(TIMES, KEYS, np.zeros((4, 1, 1)), "BEZIER", False)
