import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.numerics import safe_norm, safe_normalize

MAGNITUDES = [1e-37, 1e-30, 1e-19, 1e-3, 1.0, 1e6, 1e15, 1e30]


@pytest.mark.parametrize("shape", [(3,), (7, 9, 3)])
def test_agrees_with_float64(shape):
    x = np.random.default_rng(1).normal(size=shape)
    norm = np.linalg.norm(x, axis=-1)
    np.testing.assert_allclose(safe_norm(x), norm, rtol=3e-7)
    np.testing.assert_allclose(safe_normalize(x), x / norm[..., None], rtol=3e-7, atol=1e-7)


@pytest.mark.parametrize("magnitude", MAGNITUDES)
def test_value_and_gradient_keep_their_scale(magnitude):
    x = jnp.array([3.0, -4.0, 0.0], jnp.float32) * magnitude
    unit = np.array([0.6, -0.8, 0.0])
    np.testing.assert_allclose(safe_norm(x), 5.0 * magnitude, rtol=3e-7)
    np.testing.assert_allclose(safe_normalize(x), unit, rtol=3e-7)
    np.testing.assert_allclose(jax.grad(safe_norm)(x), unit, rtol=3e-7)
    jacobian = jax.jacobian(safe_normalize)(x) * (5.0 * magnitude)
    np.testing.assert_allclose(jacobian, np.eye(3) - np.outer(unit, unit), atol=1e-6)


@pytest.mark.parametrize("value", [0.0, 1e-42])
def test_zero_and_subnormal_vectors_are_zero_with_zero_gradient(value):
    x = jnp.full(3, value, jnp.float32)
    assert safe_norm(x) == 0.0
    np.testing.assert_array_equal(safe_normalize(x), 0.0)
    np.testing.assert_array_equal(jax.grad(safe_norm)(x), 0.0)
    np.testing.assert_array_equal(jax.jacobian(safe_normalize)(x), 0.0)


def test_plain_norm_fails_where_the_safe_one_holds():
    assert jnp.isinf(jnp.sqrt(jnp.sum(jnp.full(3, 1e20, jnp.float32) ** 2)))
    np.testing.assert_allclose(safe_norm(jnp.full(3, 1e20, jnp.float32)), np.sqrt(3) * 1e20, rtol=3e-7)


def test_nan_is_not_hidden():
    assert np.isnan(safe_norm(jnp.array([jnp.nan, 1.0, 0.0])))


def test_jit_and_vmap_change_nothing():
    x = np.random.default_rng(2).normal(size=(5, 3)).astype(np.float32)
    x[2] = 0.0
    for function in (safe_norm, safe_normalize):
        loop = np.stack([function(row) for row in x])
        np.testing.assert_allclose(jax.jit(function)(x), loop, rtol=3e-7)
        np.testing.assert_allclose(jax.vmap(function)(x), loop, rtol=3e-7)
