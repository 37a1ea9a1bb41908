"""One step of training: AdamW, cosine decay, clipped gradients; and the validation of parameters."""

from collections.abc import Sequence
from functools import cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax.training.dynamic_scale import DynamicScale
from jaxtyping import Array

from gash_jax.models.examples import Batch
from gash_jax.train.config import OptimConfig
from gash_jax.train.objectives import Objective, flat
from gash_jax.train.precision import scaled_gradients


@cache
def make_optimizer(config: OptimConfig) -> optax.GradientTransformation:
    """Clipped AdamW; the learning rate is applied by the step, which knows how much of the budget is used."""
    return optax.chain(
        optax.clip_by_global_norm(config.clip_norm),
        optax.scale_by_adam(),
        optax.add_decayed_weights(config.weight_decay),
    )


def learning_rate(config: OptimConfig, fraction: float) -> float:
    """Linear warm-up, then cosine to zero; `fraction` of the phase's budget is used."""
    if fraction < config.warmup:
        return config.learning_rate * fraction / config.warmup
    rest = (fraction - config.warmup) / (1.0 - config.warmup)
    return config.learning_rate * 0.5 * (1.0 + float(np.cos(np.pi * min(rest, 1.0))))


@partial(jax.jit, static_argnames=("objective", "optimizer", "half"))
def train_step(
    params: Any,
    moments: Any,
    scale: DynamicScale,
    batch: Batch,
    rate: Array,
    key: Array,
    *,
    objective: Objective,
    optimizer: Any,
    half: bool = False,
) -> tuple[Any, Any, DynamicScale, dict[str, Array]]:
    """One step on one batch; only the phase's parameters change (the others have gradient 0).

    A step whose gradients overflowed in half precision changes nothing but the loss scale.
    """
    trainable = objective.phase.trainable
    frozen = {name: value for name, value in params.items() if trainable and name not in trainable}
    chosen = {name: value for name, value in params.items() if name not in frozen}
    loss, gradients, scale, finite = scaled_gradients(
        lambda chosen: objective.loss({**frozen, **chosen}, batch, key), chosen, scale, half
    )
    gradients = {**gradients, **jax.tree.map(jnp.zeros_like, frozen)}
    updates, after = optimizer.update(gradients, moments, params)
    moved = {**jax.tree.map(lambda p, u: p - rate * u, params, updates), **frozen}
    if half:
        keep = lambda new, old: jnp.where(finite, new, old)  # noqa: E731
        moved, after = jax.tree.map(keep, moved, params), jax.tree.map(keep, after, moments)
    measures = {"loss": loss, "gradient_norm": optax.tree.norm(gradients)}
    return moved, after, scale, measures | ({"scale": jnp.asarray(scale.scale)} if half else {})


@partial(jax.jit, static_argnames="objective")
def predict_step(params: Any, batch: Batch, *, objective: Objective) -> Array:
    """Output of every vertex of a batch, without dropout."""
    return objective.output(params, batch, None)


def validate(params: Any, batches: Sequence[Batch], objective: Objective) -> dict[str, float]:
    """Loss and measures over the vertices of all validation shapes together."""
    outputs, labels, normals = [], [], []
    for batch in batches:
        mask = np.asarray(flat(batch.mask))
        outputs.append(np.asarray(predict_step(params, batch, objective=objective))[mask])
        labels.append(np.asarray(flat(getattr(batch, objective.phase.labels)))[mask])
        normals.append(np.asarray(flat(batch.normals))[mask])
    output, label, normal = (np.concatenate(arrays) for arrays in (outputs, labels, normals))
    loss = float(objective.phase.loss(jnp.asarray(output), jnp.asarray(label), jnp.ones(len(output), bool)))
    return {"validation": loss, **objective.measure(output, label, normal)}
