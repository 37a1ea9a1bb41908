"""Point sets and the directions made of them, against their definition written out in float64."""

import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.prt.sampling import COSINE, LATTICES, UNIFORM, korobov, lattice, sample_rays
from tests.helpers.random_rows import random_rows

DENSITIES = {"cosine": COSINE, "uniform": UNIFORM}


BY_HAND = [[0, 0], [0.5, 0.25], [0.25, 0.5], [0.75, 0.75]]  # (i/4, i with its two digits mirrored), by the latter


def _is_hammersley(points: np.ndarray) -> bool:
    """Whether the points are (i/n, v(i)) for i = 0 .. n-1 in order of v(i), v mirroring binary digits at the point."""
    n = len(points)
    digits = (n - 1).bit_length()
    mirrored = [int(f"{i:0{digits}b}"[::-1], 2) for i in range(n)]  # i = v(j) n is at place i, with j = mirrored[i]
    return np.array_equal(points, np.stack([mirrored, np.arange(n)], axis=1) / n)


def test_lattice_is_hammersley_in_order_of_azimuth() -> None:
    np.testing.assert_array_equal(lattice(4), BY_HAND)
    for n in (2, 4, 64, 256):
        points = lattice(n)
        assert _is_hammersley(points)
        # the same points shifted, in another order, one of them moved
        moved = points.copy()
        moved[-1, 0] += 0.5 / n
        for bad in ((points + 0.5 / n) % 1, (points + 1 / n) % 1, points[::-1], moved):
            assert not _is_hammersley(bad)
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
    origins, frames, shifts = random_rows()
    n = 16
    starts, directions = (np.asarray(a).reshape(7, 3, n, 3) for a in sample_rays(origins, frames, shifts, n, name))
    points = (lattice(n, name)[None, None].astype(np.float64) + shifts[:, :, None]) % 1.0
    radius, azimuth = np.sqrt(points[..., 0]), 2 * np.pi * points[..., 1]
    local = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), np.sqrt(1 - points[..., 0])], -1)
    expected = np.einsum("vij,vrnj->vrni", frames, local)
    np.testing.assert_allclose(directions, expected, atol=2e-6)
    np.testing.assert_array_equal(starts, np.broadcast_to(origins[:, None, None], starts.shape))


@pytest.mark.parametrize("density", DENSITIES, ids=str)
def test_directions_stay_above_the_surface_and_are_unit(density: str) -> None:
    origins, frames, shifts = random_rows(count=50)
    shifts[0] = 1 - 2**-24  # the largest float32 below 1 must not wrap below the horizon
    directions = np.asarray(sample_rays(origins, frames, shifts, 64, density=DENSITIES[density])[1]).reshape(50, -1, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-6)
    assert np.einsum("vnc,vc->vn", directions, frames[..., 2]).min() > -1e-6


@pytest.mark.parametrize("density", DENSITIES, ids=str)
def test_density_is_that_of_its_directions(density: str) -> None:
    """A uniform number u makes z with density 2 pi pdf(z): its integral from z to 1 is u; z² + r² = 1."""
    height, pdf = DENSITIES[density]
    u = np.linspace(0, 1, 101, dtype=np.float32)[:-1]
    z, r = (np.asarray(a, np.float64) for a in height(jnp.asarray(u)))
    np.testing.assert_allclose(z**2 + r**2, 1, atol=3e-7)
    nodes, weights = np.polynomial.legendre.leggauss(20)
    above = z[:, None] + (1 - z)[:, None] * (nodes + 1) / 2
    share = np.asarray(pdf(jnp.asarray(above)), np.float64) @ weights / 2 * (1 - z) * 2 * np.pi
    np.testing.assert_allclose(share, u, atol=1e-6)


def test_densities_by_hand() -> None:
    """At u = 3/4 cosine-weighted directions have z = 1/2, uniform ones z = 1/4; straight up they have 1/pi, 1/2pi."""
    three = jnp.asarray([0.75])
    np.testing.assert_allclose(COSINE.height(three), [[0.5], [np.sqrt(0.75)]], rtol=1e-6)
    np.testing.assert_allclose(UNIFORM.height(three), [[0.25], [np.sqrt(15) / 4]], rtol=1e-6)
    np.testing.assert_allclose(
        [COSINE.pdf(jnp.ones(1)), UNIFORM.pdf(jnp.ones(1))], [[1 / np.pi], [0.5 / np.pi]], rtol=1e-6
    )
