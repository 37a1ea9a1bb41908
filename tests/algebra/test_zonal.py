"""ZH3: what it returns exactly, the nearest axis-symmetric band 2, cones by quadrature, turning, transforms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.algebra.zonal import from_zonal, light_curve, to_zonal, transfer_curve

CURVES = (light_curve, transfer_curve)


def random_directions(count: int, seed: int = 0) -> np.ndarray:
    d = np.random.default_rng(seed).normal(size=(count, 3))
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def cosine_between(low: float, high: float) -> np.ndarray:
    """Transfer by quadrature of a vertex with normal +z that sees where the cosine to it is from low to high."""
    nodes, weights = np.polynomial.legendre.leggauss(20)
    z = low + (nodes + 1) / 2 * (high - low)
    azimuth = np.arange(16) / 16 * 2 * np.pi
    sine = np.sqrt(1 - z**2)
    w = np.stack(np.broadcast_arrays(sine * np.cos(azimuth[:, None]), sine * np.sin(azimuth[:, None]), z), -1)
    basis = np.asarray(evaluate_sh(w, 3), np.float64)
    return np.einsum("ank,n->k", basis, weights * z) * (high - low) / 2 * 2 / 16


def test_by_hand() -> None:
    """About +z only Y_20 counts: its coefficient is z. About +x Z is -1/2 in Y_20 and sqrt(3)/2 in Y_22."""
    assert to_zonal(np.array([1.0, 0, 2, 0, 5, 6, 7, 8, 9])).tolist() == [1, 0, 2, 0, 7]
    found = to_zonal(np.array([1.0, 0, 0, 2, 5, 6, 7, 8, 9]))
    np.testing.assert_allclose(found, [1, 0, 0, 2, -7 / 2 + 9 * np.sqrt(3) / 2], rtol=1e-6)
    np.testing.assert_allclose(
        from_zonal(np.array([1.0, 0, -2, 0, 7]), light_curve), [1, 0, -2, 0, 0, 0, 7, 0, 0], atol=1e-6
    )
    # r = 1/2: 2 (0.04 + 0.15)
    np.testing.assert_allclose(from_zonal(np.array([2.0, 0, 1, 0]), light_curve)[6], 0.38, rtol=1e-6)


def test_what_is_symmetric_about_an_axis_is_exact() -> None:
    axis, rng = random_directions(50), np.random.default_rng(1)
    parts = rng.normal(size=(50, 3)).astype(np.float32)
    functions = np.asarray(evaluate_sh(axis, 3)) * np.repeat(parts, [1, 3, 5], axis=1)
    np.testing.assert_allclose(from_zonal(to_zonal(functions), light_curve), functions, atol=1e-5)


def test_band_two_is_the_nearest_about_the_axis() -> None:
    values = np.random.default_rng(2).normal(size=(40, 9)).astype(np.float32)
    numbers = np.asarray(to_zonal(values))
    error = np.linalg.norm(np.asarray(from_zonal(numbers, light_curve)) - values, axis=1)
    for change in (-0.05, 0.05):
        other = numbers + change * np.eye(5, dtype=np.float32)[4]
        assert (np.linalg.norm(np.asarray(from_zonal(other, light_curve)) - values, axis=1) > error).all()
    np.testing.assert_array_equal(from_zonal(numbers, light_curve)[:, :4], values[:, :4])


@pytest.mark.parametrize("u", [0.0, 0.2, 0.6, 0.9, 0.99])
def test_cones_and_blocked_cones_are_exact_in_four_numbers(u: float) -> None:
    for seen in (cosine_between(u, 1.0), cosine_between(0.0, u)):
        if seen[0] > 0:
            np.testing.assert_allclose(from_zonal(seen[:4].astype(np.float32), transfer_curve), seen, atol=2e-5)


def test_unshadowed_transfer_is_exact_in_four_numbers() -> None:
    exact = np.asarray(evaluate_sh(random_directions(50), 3)) * (clamped_cosine_coefficients(3) / np.pi).astype(
        np.float32
    )
    np.testing.assert_allclose(from_zonal(exact[:, :4], transfer_curve), exact, atol=2e-4)


def test_the_curve_is_whole() -> None:
    """Its two halves meet at q = 1 in sqrt(5)/4; it grows throughout, from -sqrt(5)/2 to sqrt(5), and ends there."""
    ratio = np.linspace(0.0, 2.5, 2001) * 2 / np.sqrt(3)
    values = np.asarray(transfer_curve(jnp.asarray(ratio, jnp.float32)))
    assert np.isfinite(values).all() and (np.diff(values) > -1e-6).all()
    np.testing.assert_allclose(values[[0, 800, -1]], np.sqrt(5) * np.array([-1 / 2, 1 / 4, 1]), atol=2e-3)


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("numbers", [4, 5])
def test_it_turns_with_the_function(curve, numbers: int) -> None:
    values = np.random.default_rng(3).normal(size=(30, 9)).astype(np.float32)
    values[:, 0] = np.abs(values[:, 0]) + 2
    turn = Rotation.from_rotvec([0.3, 1.2, -0.8]).as_matrix().astype(np.float32)
    there = rotate_coefficients(from_zonal(to_zonal(values)[:, :numbers], curve), turn)
    back = from_zonal(to_zonal(rotate_coefficients(values, turn))[:, :numbers], curve)
    np.testing.assert_allclose(there, back, atol=2e-5)


@pytest.mark.parametrize("curve", CURVES)
def test_transforms_and_ends(curve) -> None:
    values = np.random.default_rng(4).normal(size=(6, 9)).astype(np.float32)
    whole = lambda c: from_zonal(to_zonal(c)[..., :4], curve)  # noqa: E731
    np.testing.assert_allclose(jax.jit(whole)(values), whole(values), atol=1e-6)
    np.testing.assert_allclose(jax.vmap(whole)(values), np.stack([whole(row) for row in values]), atol=1e-6)
    black, even = np.zeros(9, np.float32), np.eye(9, dtype=np.float32)[0]
    unshadowed = (clamped_cosine_coefficients(3) / np.pi).astype(np.float32) * np.asarray(evaluate_sh(np.eye(3)[2], 3))
    for row in (black, even, -even, unshadowed, values[0]):
        assert np.isfinite(whole(row)).all()
        assert np.isfinite(jax.grad(lambda c: jnp.sum(whole(c) ** 2))(row)).all()
    np.testing.assert_array_equal(whole(black), 0)
    np.testing.assert_array_equal(whole(even)[4:], 0)  # no axis, no band 2
