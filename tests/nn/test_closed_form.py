"""The closed form against its definition by quadrature and by hand."""

from math import pi, sqrt

import jax
import jax.numpy as jnp
import numpy as np

from gash_jax.algebra.sh import evaluate_sh
from gash_jax.nn.closed_form import closed_form, zero_without_normal


def _normals(count: int) -> np.ndarray:
    normals = np.random.default_rng(0).normal(size=(count, 3))
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)


def test_quadrature_of_the_definition() -> None:
    z, weights = np.polynomial.legendre.leggauss(200)
    phi = (np.arange(400) + 0.5) * 2 * pi / 400
    r = np.sqrt(1 - z**2)[:, None]
    directions = np.stack(np.broadcast_arrays(r * np.cos(phi), r * np.sin(phi), z[:, None]), -1).reshape(-1, 3)
    area = np.repeat(weights * 2 * pi / 400, 400)
    normals = _normals(5)
    basis = np.asarray(evaluate_sh(directions.astype(np.float32), 5), np.float64)
    expected = (np.maximum(normals @ directions.T, 0) * area) @ basis / pi
    np.testing.assert_allclose(closed_form(normals, 5), expected, atol=2e-5)


def test_by_hand_for_an_upward_normal() -> None:
    # normal +y: band 0 is A_0/pi * 0.282095; band 1 is (y, z, x), so y comes first
    expected = [1 / (2 * sqrt(pi)), 2 / 3 * sqrt(3 / (4 * pi)), 0, 0]
    np.testing.assert_allclose(closed_form(np.array([[0, 1, 0]], np.float32), 2)[0], expected, atol=1e-6)


def test_zero_normals_give_zero_with_zero_gradient() -> None:
    normals = jnp.asarray([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert not np.any(closed_form(normals, 3)[0])
    gradient = jax.grad(lambda c: jnp.sum(zero_without_normal(c, normals)))(jnp.ones((2, 4)))
    np.testing.assert_array_equal(gradient, [[0] * 4, [1] * 4])
    assert np.isfinite(jax.grad(lambda n: jnp.sum(closed_form(n, 3)))(normals)).all()


def test_under_jit_and_vmap() -> None:
    normals = jnp.asarray(_normals(6))
    plain = closed_form(normals, 3)
    np.testing.assert_allclose(jax.jit(closed_form, static_argnums=1)(normals, 3), plain, atol=1e-6)
    mapped = jax.vmap(lambda n: closed_form(n, 3))(normals.reshape(2, 3, 3))
    np.testing.assert_allclose(mapped.reshape(6, 9), plain, atol=1e-6)
