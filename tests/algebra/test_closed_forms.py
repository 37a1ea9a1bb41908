"""Closed forms against their definition by quadrature, and by hand."""

from collections.abc import Callable
from math import pi, sqrt

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.polynomial.legendre import Legendre, leggauss

from gash_jax.algebra import closed_forms
from gash_jax.algebra.closed_forms import unshadowed_transfer, zero_without_normal
from gash_jax.algebra.sh import evaluate_sh


def test_clamped_cosine_by_hand() -> None:
    expected = np.pi * np.array([1, 2 / 3, 1 / 4, 0, -1 / 24, 0, 1 / 64, 0, -1 / 128])
    np.testing.assert_allclose([closed_forms.clamped_cosine(band) for band in range(9)], expected, rtol=1e-15)


def test_hemisphere_by_hand() -> None:
    """P_1 = z and P_3 = (5 z^3 - 3 z) / 2 have the integrals 1/2 and -1/8 over [0, 1]."""
    expected = 2 * np.pi * np.array([1, 1 / 2, 0, -1 / 8, 0, 1 / 16])
    np.testing.assert_allclose([closed_forms.hemisphere(band) for band in range(6)], expected, rtol=1e-15)


@pytest.mark.parametrize(
    ("factor", "value"), [(closed_forms.clamped_cosine, lambda z: z), (closed_forms.hemisphere, np.ones_like)]
)
def test_factors_are_their_integrals(factor: Callable, value: Callable) -> None:
    """2 pi times the integral of the kernel times P_l over [0, 1], by Gauss-Legendre quadrature."""
    node, weight = leggauss(60)
    z, weight = (node + 1) / 2, weight / 2
    for band in range(101):
        integral = 2 * np.pi * np.sum(weight * value(z) * Legendre.basis(band)(z))
        np.testing.assert_allclose(factor(band), integral, atol=3e-14)
    with pytest.raises(ValueError, match="use 0 or more"):
        factor(-1)


def test_clamped_cosine_coefficients_repeat_per_band() -> None:
    coefficients = closed_forms.clamped_cosine_coefficients(3)
    np.testing.assert_allclose(coefficients / np.pi, [1, *[2 / 3] * 3, *[1 / 4] * 5], rtol=1e-15)


def _normals(count: int) -> np.ndarray:
    normals = np.random.default_rng(0).normal(size=(count, 3))
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def test_unshadowed_transfer_against_quadrature() -> None:
    """(1/pi) integral of max(n.w, 0) Y over the sphere, on a product Gauss-Legendre x uniform grid."""
    z, weights = leggauss(200)
    phi = (np.arange(400) + 0.5) * 2 * pi / 400
    r = np.sqrt(1 - z**2)[:, None]
    directions = np.stack(np.broadcast_arrays(r * np.cos(phi), r * np.sin(phi), z[:, None]), -1).reshape(-1, 3)
    area = np.repeat(weights * 2 * pi / 400, 400)
    normals = _normals(5)
    basis = np.asarray(evaluate_sh(directions.astype(np.float32), 5), np.float64)
    expected = (np.maximum(normals @ directions.T, 0) * area) @ basis / pi
    np.testing.assert_allclose(unshadowed_transfer(normals, 5), expected, atol=2e-5)


def test_unshadowed_transfer_by_hand() -> None:
    """Band 1 is (y, z, x); Y_00 alone lights a vertex to exactly 1 with L_00 = 2 sqrt(pi)."""
    found = np.asarray(unshadowed_transfer(np.array([[0, 1, 0], [0, 0, 1]], np.float32), 2))
    zero, one = 1 / (2 * sqrt(pi)), 2 / 3 * sqrt(3 / (4 * pi))
    np.testing.assert_allclose(found, [[zero, one, 0, 0], [zero, 0, one, 0]], atol=1e-7)
    assert found[0, 0] * 2 * np.sqrt(np.pi) == pytest.approx(1.0, abs=1e-6)


def test_missing_normals_give_zero_with_finite_gradient() -> None:
    normals = jnp.asarray([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    assert not np.any(unshadowed_transfer(normals, 3)[0])
    gradient = jax.grad(lambda c: jnp.sum(zero_without_normal(c, normals)))(jnp.ones((3, 4)))
    np.testing.assert_array_equal(gradient, [[0] * 4, [1] * 4, [1] * 4])
    assert np.isfinite(jax.grad(lambda n: jnp.sum(unshadowed_transfer(n, 3)))(normals)).all()


def test_unshadowed_transfer_under_jit_and_vmap() -> None:
    normals = jnp.asarray(_normals(6))
    plain = unshadowed_transfer(normals, 3)
    np.testing.assert_allclose(jax.jit(unshadowed_transfer, static_argnums=1)(normals, 3), plain, atol=1e-6)
    mapped = jax.vmap(lambda n: unshadowed_transfer(n, 3))(normals.reshape(2, 3, 3))
    np.testing.assert_allclose(mapped.reshape(6, 9), plain, atol=1e-6)


def test_caps_by_hand_and_hemispheres() -> None:
    """u = cos a: 2 pi (1 - u), pi (1 - u²), pi u (1 - u²); a = pi / 2 is the hemisphere."""
    u = 0.3
    np.testing.assert_allclose(
        closed_forms.cap(3, np.arccos(u)), np.pi * np.array([2 * (1 - u), 1 - u**2, u * (1 - u**2)]), rtol=1e-5
    )
    half = [closed_forms.hemisphere(band) for band in range(10)]
    np.testing.assert_allclose(closed_forms.cap(10, np.pi / 2), half, atol=2e-6)
    tiny = closed_forms.cap(10, 1e-5)  # all light from one direction: the same in every band
    np.testing.assert_allclose(tiny, np.pi * 1e-10, rtol=1e-5)
