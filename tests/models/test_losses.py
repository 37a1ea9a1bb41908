"""Objectives by hand, at extremes, and under padding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.models.losses import balanced_bce, masked_mean, squared_error

MASK = jnp.array([True, True, False])


def test_squared_error_ignores_padding() -> None:
    prediction, target = jnp.array([[1.0], [3.0], [99.0]]), jnp.zeros((3, 1))
    assert float(squared_error(prediction=prediction, target=target, mask=MASK)) == 5.0
    assert float(masked_mean(prediction, jnp.zeros(3, bool))) == 0.0


def test_balanced_bce_by_hand() -> None:
    """One occluded against three visible samples: each class is averaged first."""
    logits, labels = jnp.array([[0.0, 2.0], [2.0, 2.0]]), jnp.array([[0.0, 1.0], [1.0, 1.0]])
    expected = 0.5 * (np.log(2.0) + np.log1p(np.exp(-2.0)))
    assert float(balanced_bce(logits=logits, labels=labels, mask=jnp.ones(2, bool))) == pytest.approx(
        expected, rel=1e-6
    )


@pytest.mark.parametrize("label", [0.0, 1.0])
def test_a_batch_of_one_class_is_the_plain_loss(label: float) -> None:
    logits = jnp.array([[0.5, -1.0]])
    labels = jnp.full((1, 2), label)
    expected = np.mean(np.log1p(np.exp(np.asarray(logits) * (1 - 2 * label))))
    assert float(balanced_bce(logits=logits, labels=labels, mask=jnp.ones(1, bool))) == pytest.approx(
        expected, rel=1e-6
    )


def test_extreme_logits_and_empty_masks_stay_finite() -> None:
    logits, labels = jnp.array([[1e4, -1e4]]), jnp.array([[0.0, 1.0]])
    loss = lambda z, mask: balanced_bce(logits=z, labels=labels, mask=mask)  # noqa: E731
    value, gradient = jax.value_and_grad(loss)(logits, jnp.ones(1, bool))
    assert float(value) == pytest.approx(1e4)
    assert np.isfinite(np.asarray(gradient)).all()
    assert float(loss(logits, jnp.zeros(1, bool))) == 0.0
