"""Pooling by halves is a sum and a maximum, with their gradients, at any length, under jit and vmap."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.nn.pooling import most_of, total_of, weighted_total

PAIRS: list[tuple[Callable[..., Any], Callable[..., Any]]] = [(total_of, jnp.sum), (most_of, jnp.max)]


@pytest.mark.parametrize("count", [1, 2, 3, 5, 7, 48, 64])
@pytest.mark.parametrize(("ours", "plain"), PAIRS)
def test_they_are_the_reductions_and_their_gradients(ours: Callable, plain: Callable, count: int) -> None:
    x = jnp.asarray(np.random.default_rng(count).normal(size=(4, 3, count)), jnp.float32)
    np.testing.assert_allclose(ours(x), plain(x, axis=-1), atol=2e-6)
    weight = jnp.arange(1.0, 13.0).reshape(4, 3)
    gradient = jax.jit(jax.grad(lambda x: jnp.sum(weight * ours(x))))(x)
    expected = jax.grad(lambda x: jnp.sum(weight * plain(x, axis=-1)))(x)
    np.testing.assert_allclose(gradient, expected, atol=1e-6)
    np.testing.assert_allclose(jax.vmap(ours)(x), plain(x, axis=-1), atol=2e-6)


def test_by_hand() -> None:
    x = jnp.array([1.0, -2.0, 5.0, 5.0, 0.5])
    assert float(total_of(x)) == 9.5 and float(most_of(x)) == 5.0
    np.testing.assert_allclose(jax.grad(most_of)(x), [0, 0, 0.5, 0.5, 0])


@pytest.mark.parametrize("ours", [total_of, most_of])
def test_the_order_does_not_matter(ours: Callable) -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=(10, 64)).astype(np.float32)
    np.testing.assert_allclose(ours(jnp.asarray(rng.permuted(x, axis=1))).sum(), ours(jnp.asarray(x)).sum(), rtol=1e-5)


def test_weighted_totals_are_totals_of_products_and_their_gradients() -> None:
    """By hand 2 x 1 + 3 x 10 = 32; of any length, under jit and vmap."""
    hand = weighted_total(jnp.array([[2.0, 3.0]]), jnp.array([[[1.0, 10.0]], [[0.5, 0.0]]]))
    np.testing.assert_array_equal(hand, [[32.0], [1.0]])
    rng = np.random.default_rng(0)
    for count in (1, 24, 100):
        weight, x = (jnp.asarray(rng.normal(size=(*shape, 5, count)), jnp.float32) for shape in ((), (3,)))
        plain = lambda weight, x: jnp.sum(weight[None] * x, axis=-1)  # noqa: E731
        np.testing.assert_allclose(weighted_total(weight, x), plain(weight, x), atol=1e-5)
        stacked = jax.vmap(weighted_total)(jnp.stack([weight, -weight]), jnp.stack([x, x]))
        np.testing.assert_allclose(stacked[1], -plain(weight, x), atol=1e-5)
        ours, expected = (
            jax.jit(jax.grad(lambda w, y, f=f: jnp.sum(f(w, y) ** 2), argnums=(0, 1)))(weight, x)
            for f in (weighted_total, plain)
        )
        for a, b in zip(ours, expected, strict=True):
            np.testing.assert_allclose(a, b, atol=1e-3)
