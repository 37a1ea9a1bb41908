"""The sampling kernels against their definition, written out in float64."""

import jax
import numpy as np
import pytest

from gash_jax.algebra.directions import cosine_hemisphere, orthonormal_frame
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.prt.sampling import integrate_rays, lattice, sample_rays


def _rows(count: int = 7, rotations: int = 3, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    origins = rng.normal(size=(count, 3))
    return origins.astype(np.float32), normals.astype(np.float32), rng.random((count, rotations, 2), np.float32)


def test_lattice_is_hammersley_in_order_of_azimuth() -> None:
    np.testing.assert_allclose(lattice(4), [[0 / 4, 0.0], [2 / 4, 0.25], [1 / 4, 0.5], [3 / 4, 0.75]], atol=0.126)
    assert np.all(np.diff(lattice(64)[:, 1]) > 0)
    assert len(np.unique(lattice(64)[:, 0])) == 64


def test_directions_follow_the_definition() -> None:
    """frac(point + shift) on the cosine hemisphere, turned into the frame of the normal."""
    origins, normals, shifts = _rows()
    n = 16
    starts, directions = (np.asarray(a).reshape(7, 3, n, 3) for a in sample_rays(origins, normals, shifts, n))
    points = (lattice(n)[None, None].astype(np.float64) + shifts[:, :, None]) % 1.0
    local = np.asarray(cosine_hemisphere(points))
    frames = np.asarray(orthonormal_frame(normals))
    expected = np.einsum("vij,vrnj->vrni", frames, local)
    np.testing.assert_allclose(directions, expected, atol=2e-6)
    np.testing.assert_array_equal(starts, np.broadcast_to(origins[:, None, None], starts.shape))


def test_directions_stay_above_the_surface_and_are_unit() -> None:
    origins, normals, shifts = _rows(count=50)
    shifts[0] = 1 - 2**-24  # the largest float32 below 1 must not wrap below the horizon
    directions = np.asarray(sample_rays(origins, normals, shifts, 64)[1]).reshape(50, -1, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    assert np.einsum("vnc,vc->vn", directions, normals).min() > -1e-6


@pytest.mark.parametrize("bands", [1, 3, 6, 10])
def test_integral_is_the_mean_of_visibility_times_harmonics(bands: int) -> None:
    origins, normals, shifts = _rows()
    n = 32
    directions = np.asarray(sample_rays(origins, normals, shifts, n)[1]).reshape(7, 3, n, 3)
    visible = np.random.default_rng(1).random((7, 3, n)) < 0.6
    expected = (visible[..., None] * np.asarray(evaluate_sh(directions, bands), np.float64)).mean(2)
    found = np.asarray(integrate_rays(visible, normals, shifts, bands))
    np.testing.assert_allclose(found, expected, atol=3e-6 * bands)


def test_integral_by_hand() -> None:
    """One ray straight along +z, visible: the coefficients are Y(+z) = (.2821, 0, .4886, 0)."""
    shifts = np.zeros((1, 1, 2), np.float32)
    shifts[0, 0, 0] = -float(lattice(1)[0, 0])  # u = 0 is the pole
    found = np.asarray(integrate_rays(np.ones((1, 1, 1), bool), np.array([[0, 0, 1]], np.float32), shifts, 2))
    np.testing.assert_allclose(found[0, 0], [0.282095, 0, 0.488603, 0], atol=1e-6)


def test_jit_equals_eager_and_rows_are_independent() -> None:
    origins, normals, shifts = _rows()
    visible = np.random.default_rng(1).random((7, 3, 8)) < 0.5
    jitted = np.asarray(integrate_rays(visible, normals, shifts, 3))
    with jax.disable_jit():
        eager = np.asarray(integrate_rays(visible, normals, shifts, 3))
    np.testing.assert_allclose(jitted, eager, atol=1e-6)
    alone = np.asarray(integrate_rays(visible[4:5], normals[4:5], shifts[4:5], 3))
    np.testing.assert_allclose(alone[0], jitted[4], atol=1e-6)
