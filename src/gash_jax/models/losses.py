"""Objectives, elementwise and masked: padding never counts, shapes never broadcast.

A mask may also hold weights: how much each vertex counts, 0 for not at all.
"""

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Mask = Bool[Array, "v"] | Float[Array, "v"]


def masked_mean(values: Float[Array, "v k"], mask: Mask) -> Float[Array, ""]:
    """Mean over the vertices of the mask; 0 where the mask is empty."""
    weights = mask.astype(values.dtype)
    return jnp.sum(values * weights[:, None]) / (jnp.maximum(jnp.sum(weights), 1.0) * values.shape[1])


def squared_error(*, prediction: Float[Array, "v k"], target: Float[Array, "v k"], mask: Mask) -> Float[Array, ""]:
    """Mean squared error."""
    return masked_mean((prediction - target) ** 2, mask)


def balanced_bce(*, logits: Float[Array, "v n"], labels: Float[Array, "v n"], mask: Mask) -> Float[Array, ""]:
    """Class-balanced binary cross-entropy on logits (GNN paper, 4.2.1).

    Visible and occluded samples are averaged apart and then together, so that rare occlusion weighs as much as
    plentiful sky. A class that does not occur in the batch adds nothing, and the other one then counts alone.
    """
    import optax  # slow to import, and a prediction has no loss

    loss = optax.sigmoid_binary_cross_entropy(logits, labels)
    weights = jnp.broadcast_to(mask[:, None], loss.shape).astype(loss.dtype)
    total, present = jnp.zeros(()), jnp.zeros(())
    for belongs in (labels, 1.0 - labels):
        count = jnp.sum(weights * belongs)
        total = total + jnp.sum(loss * weights * belongs) / jnp.maximum(count, 1.0)
        present = present + (count > 0)
    return total / jnp.maximum(present, 1.0)
