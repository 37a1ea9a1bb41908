"""The integrands against their definition, written out in float64, and against each other."""

import jax
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import hemisphere, unshadowed_transfer
from gash_jax.algebra.sh import band_index, evaluate_sh
from gash_jax.prt.integrands import direct, glossy, integrate_rays, to_world
from gash_jax.prt.sampling import COSINE, LATTICES, UNIFORM, lattice, sample_rays
from gash_jax.prt.tracing import Integrand, Rows, trace_rows
from tests.helpers.random_rows import random_rows


@pytest.mark.parametrize("name", LATTICES)
@pytest.mark.parametrize("bands", [1, 3, 6, 10])
def test_estimate_is_share_of_closed_form_plus_mean_of_the_rest(bands: int, name: str) -> None:
    """p c + mean of (V - p) Y, written out in the world frame."""
    origins, frames, shifts = random_rows()
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
    _, frames, shifts = random_rows()
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
    _, _, shifts = random_rows()
    visible = np.random.default_rng(1).random((7, 3, 8)) < 0.5
    share = np.full(7, 0.3, np.float32)
    jitted = np.asarray(integrate_rays(visible, share, shifts, 3))
    with jax.disable_jit():
        eager = np.asarray(integrate_rays(visible, share, shifts, 3))
    np.testing.assert_allclose(jitted, eager, atol=1e-6)
    alone = np.asarray(integrate_rays(visible[4:5], share[4:5], shifts[4:5], 3))
    np.testing.assert_allclose(alone[0], jitted[4], atol=1e-6)


def _beside_a_wall(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Free are the directions on one side of a slanted plane through the origin."""
    return directions @ np.array([0.6, 0.48, 0.64], np.float32) > 0.1


def _estimates(integrand: Integrand, replicates: int, n: int, seed: int, share: float | None = 0.0) -> np.ndarray:
    """World coefficients of 60 vertices beside the wall, (60, replicates, k)."""
    rows = Rows(*random_rows(60, replicates, seed=5))
    rows = rows._replace(shifts=np.random.default_rng(seed).random((60, replicates, 2), np.float32))
    p = None if share is None else np.full(60, share, np.float32)
    local, _ = trace_rows(rows, integrand, n, _beside_a_wall, share=p)
    return np.asarray(to_world(local, rows.frames), np.float64)


def _score(one: np.ndarray, other: np.ndarray) -> float:
    """Rms over vertices and coefficients of the difference of two means in its standard deviations."""
    variance = (one.var(1, ddof=1) + other.var(1, ddof=1)) / one.shape[1]
    scatter = variance > 1e-10  # a count of free rays may be the same in all replicates
    assert scatter.mean() > 0.9
    return float(np.sqrt(np.mean((one.mean(1) - other.mean(1))[scatter] ** 2 / variance[scatter])))


@pytest.mark.parametrize("share", [0.0, 0.7, 1.0])
def test_any_density_gives_the_same_transfer(share: float) -> None:
    """Uniform rays, weighted by 2 cos, against cosine-weighted ones, within what their replicates scatter."""
    cosine = _estimates(direct(3), 48, 64, 0, share)
    assert 0.8 < _score(_estimates(direct(3, UNIFORM), 48, 64, 1, share), cosine) < 1.25
    # known-bad: the weights of another density
    unweighted = direct(3)._replace(density=UNIFORM)
    assert _score(_estimates(unweighted, 48, 64, 1, share), cosine) > 5


def test_uniform_density_by_hand() -> None:
    """One free ray straight up counts 2 cos = 2: twice Y(+z); one along the horizon nothing."""
    shifts = np.zeros((1, 1, 2), np.float32)
    shifts[0, 0, 0] = -float(lattice(1)[0, 0])
    one, none = np.ones((1, 1, 1), bool), np.zeros(1, np.float32)
    up = np.asarray(integrate_rays(one, none, shifts, 2, density=UNIFORM))
    np.testing.assert_allclose(up[0, 0], [2 * 0.282095, 0, 2 * 0.488603, 0], atol=1e-6)
    shifts[0, 0, 0] += 1 - 2**-24
    assert np.abs(np.asarray(integrate_rays(one, none, shifts, 2, density=UNIFORM))).max() < 1e-5


@pytest.mark.parametrize("bands", [1, 3])
def test_glossy_without_shadow_is_the_hemisphere(bands: int) -> None:
    """V = 1: H_l Y_lm(n) in 2B-1 bands, exactly with p = 1 and in the mean of the rays with p = 0."""
    rows, high = Rows(*random_rows()), 2 * bands - 1
    factors = np.array([hemisphere(int(band)) for band in band_index(high)])
    expected = factors * np.asarray(evaluate_sh(rows.frames[..., 2], high), np.float64)
    for share, tolerance in ((1.0, 3e-6 * high), (0.0, 0.03)):
        p = np.full(7, share, np.float32)
        local, free = trace_rows(rows, glossy(bands), 2048, lambda origins, _: np.ones(len(origins), bool), share=p)
        found = np.asarray(to_world(local, rows.frames))
        assert found.shape == (7, 3, high**2) and (free == 1).all()
        np.testing.assert_allclose(found, np.broadcast_to(expected[:, None], found.shape), atol=tolerance)


def test_glossy_beside_a_wall_is_its_integral() -> None:
    """V Y_k over the hemisphere by quadrature in float64, in the five bands that three bands' products need."""
    found = _estimates(glossy(3), 8, 4096, 2, None)
    z, weight = np.polynomial.legendre.leggauss(400)
    azimuth = (np.arange(800) + 0.5) / 400 * np.pi
    r = np.sqrt(1 - z**2)[:, None]
    sphere = np.stack(np.broadcast_arrays(r * np.cos(azimuth), r * np.sin(azimuth), z[:, None]), -1).reshape(-1, 3)
    area = np.repeat(weight * np.pi / 400, 800) * _beside_a_wall(sphere, sphere.astype(np.float32))
    basis = np.asarray(evaluate_sh(sphere.astype(np.float32), 5), np.float64) * area[:, None]
    expected = (random_rows(60, 1, seed=5)[1][..., 2] @ sphere.T > 0) @ basis
    np.testing.assert_allclose(found.mean(1), expected, atol=0.02)
    assert np.abs(expected).max() > 1


def test_bands_out_of_range_are_refused() -> None:
    for make, bands in ((direct, 0), (direct, 11), (glossy, 11), (glossy, 0)):
        with pytest.raises(ValueError, match="use a whole number"):
            make(bands)


def test_integrands_say_what_their_rays_ask() -> None:
    assert [direct(3).query, glossy(3).query] == ["any", "any"]
    assert direct(3).density is COSINE and direct(3, UNIFORM).density is glossy(2).density is UNIFORM
