"""The sampling kernels against their definition, written out in float64."""

import jax
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.directions import cosine_hemisphere, orthonormal_frame
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.prt.sampling import LATTICES, integrate_rays, korobov, lattice, sample_rays, to_world


def _rows(count: int = 7, rotations: int = 3, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins, frames and shifts; the frames are turned about their normals at random."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    angle = rng.random(count) * 2 * np.pi
    turn = np.zeros((count, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1], turn[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    frames = np.asarray(orthonormal_frame(normals)) @ turn
    origins = rng.normal(size=(count, 3)).astype(np.float32)
    return origins, frames.astype(np.float32), rng.random((count, rotations, 2), np.float32)


def test_lattice_is_hammersley_in_order_of_azimuth() -> None:
    np.testing.assert_allclose(lattice(4), [[0 / 4, 0.0], [2 / 4, 0.25], [1 / 4, 0.5], [3 / 4, 0.75]], atol=0.126)
    for name in LATTICES:
        assert np.all(np.diff(lattice(64, name)[:, 1]) > 0)
        assert len(np.unique(lattice(64, name)[:, 0])) == 64


def test_korobov_points_by_hand() -> None:
    """v(0..3) = 0, 1/2, 1/4, 3/4 and K = 3 modulo 4: second coordinates 0, 1/2, 3/4, 1/4."""
    np.testing.assert_array_equal(korobov(np.arange(4)), [[0, 0], [0.5, 0.5], [0.25, 0.75], [0.75, 0.25]])


@pytest.mark.parametrize("size", [2, 8, 64, 2048])
def test_korobov_blocks_are_shifted_lattices(size: int) -> None:
    """The law that lets a bake go on: any aligned block of 2^m points is the first 2^m points, shifted modulo 1."""
    first = korobov(np.arange(size))
    for block in (1, 2, 5, 2**19 // size - 1):
        moved = korobov(np.arange(block * size, (block + 1) * size))
        shift = moved[0] - first[0]
        np.testing.assert_allclose((first + shift) % 1.0, moved, atol=1e-9)


def test_korobov_is_even_at_every_size() -> None:
    """Shortest vector of the dual lattice against the best possible, sqrt(2/sqrt 3) of sqrt(N): at least 0.5."""
    for exponent in range(3, 21):
        n = 1 << exponent
        u, v = np.array([n, 0]), np.array([-_generator(n), 1])
        while True:  # Gauss reduction
            if u @ u < v @ v:
                u, v = v, u
            step = int(np.rint((u @ v) / (v @ v)))
            if step == 0:
                break
            u = u - step * v
        assert np.sqrt(min(u @ u, v @ v) / n) >= 0.5, n


def _generator(n: int) -> int:
    """K modulo n, read off the points themselves: the one whose first coordinate is 1/n."""
    points = korobov(np.arange(n))
    return int(np.rint(points[np.argmin(np.abs(points[:, 0] - 1 / n)), 1] * n))


@pytest.mark.parametrize("name", LATTICES)
def test_directions_follow_the_definition(name: str) -> None:
    """frac(point + shift) on the cosine hemisphere, turned into the frame of the vertex."""
    origins, frames, shifts = _rows()
    n = 16
    starts, directions = (np.asarray(a).reshape(7, 3, n, 3) for a in sample_rays(origins, frames, shifts, n, name))
    points = (lattice(n, name)[None, None].astype(np.float64) + shifts[:, :, None]) % 1.0
    local = np.asarray(cosine_hemisphere(points))
    expected = np.einsum("vij,vrnj->vrni", frames, local)
    np.testing.assert_allclose(directions, expected, atol=2e-6)
    np.testing.assert_array_equal(starts, np.broadcast_to(origins[:, None, None], starts.shape))


def test_directions_stay_above_the_surface_and_are_unit() -> None:
    origins, frames, shifts = _rows(count=50)
    shifts[0] = 1 - 2**-24  # the largest float32 below 1 must not wrap below the horizon
    directions = np.asarray(sample_rays(origins, frames, shifts, 64)[1]).reshape(50, -1, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    assert np.einsum("vnc,vc->vn", directions, frames[..., 2]).min() > -1e-6


@pytest.mark.parametrize("name", LATTICES)
@pytest.mark.parametrize("bands", [1, 3, 6, 10])
def test_estimate_is_share_of_closed_form_plus_mean_of_the_rest(bands: int, name: str) -> None:
    """p c + mean of (V - p) Y, written out in the world frame."""
    origins, frames, shifts = _rows()
    n = 32
    directions = np.asarray(sample_rays(origins, frames, shifts, n, name)[1]).reshape(7, 3, n, 3)
    visible = np.random.default_rng(1).random((7, 3, n)) < 0.6
    share = np.linspace(0, 1, 7, dtype=np.float32)
    rest = (visible - share[:, None, None])[..., None] * np.asarray(evaluate_sh(directions, bands), np.float64)
    closed = np.asarray(unshadowed_transfer(frames[..., 2], bands), np.float64)
    expected = share[:, None, None] * closed[:, None] + rest.mean(2)
    found = np.asarray(to_world(integrate_rays(visible, share, shifts, bands, name), frames))
    np.testing.assert_allclose(found, expected, atol=3e-6 * bands)


def test_all_free_is_the_closed_form_and_all_blocked_is_zero_whatever_the_rays() -> None:
    _, frames, shifts = _rows()
    ones = np.ones(7, np.float32)
    free = np.asarray(to_world(integrate_rays(np.ones((7, 3, 4), bool), ones, shifts, 4), frames))
    closed = np.asarray(unshadowed_transfer(frames[..., 2], 4))
    np.testing.assert_allclose(free, np.broadcast_to(closed[:, None], free.shape), atol=5e-7)
    blocked = integrate_rays(np.zeros((7, 3, 4), bool), 0 * ones, shifts, 4)
    np.testing.assert_array_equal(np.asarray(blocked), 0.0)


def test_integral_by_hand() -> None:
    """One ray straight along +z, visible: the coefficients are Y(+z) = (.2821, 0, .4886, 0)."""
    shifts = np.zeros((1, 1, 2), np.float32)
    shifts[0, 0, 0] = -float(lattice(1)[0, 0])  # u = 0 is the pole
    found = np.asarray(integrate_rays(np.ones((1, 1, 1), bool), np.zeros(1, np.float32), shifts, 2))
    np.testing.assert_allclose(found[0, 0], [0.282095, 0, 0.488603, 0], atol=1e-6)


def test_jit_equals_eager_and_rows_are_independent() -> None:
    _, _, shifts = _rows()
    visible = np.random.default_rng(1).random((7, 3, 8)) < 0.5
    share = np.full(7, 0.3, np.float32)
    jitted = np.asarray(integrate_rays(visible, share, shifts, 3))
    with jax.disable_jit():
        eager = np.asarray(integrate_rays(visible, share, shifts, 3))
    np.testing.assert_allclose(jitted, eager, atol=1e-6)
    alone = np.asarray(integrate_rays(visible[4:5], share[4:5], shifts[4:5], 3))
    np.testing.assert_allclose(alone[0], jitted[4], atol=1e-6)
