"""What each model minimises, as a list of phases that are trained one after the other.

The two-stage network (GNN paper, 4.2) first learns visibility by class-balanced BCE, then, with that net fixed,
coefficients by MSE. Every other model has one phase.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.learn.batches import Batch
from gash_jax.learn.losses import balanced_bce, squared_error, visibility_accuracy
from gash_jax.nn.registry import ModelConfig, build_model

# (params, batch, dropout key or None) -> (loss, further measures)
LossFn = Callable[[Any, Batch, jax.Array | None], tuple[Float[Array, ""], dict[str, Float[Array, ""]]]]


class Phase(NamedTuple):
    """`trainable` names the top-level parameters that change (None: all); `share` is the part of the budget."""

    name: str
    share: float
    trainable: tuple[str, ...] | None
    loss: LossFn


def _rngs(key: jax.Array | None) -> dict[str, jax.Array]:
    return {} if key is None else {"dropout": key}


def _coefficient_loss(module: nn.Module) -> LossFn:
    def loss(params: Any, batch: Batch, key: jax.Array | None) -> tuple[Array, dict[str, Array]]:
        options: dict[str, Any] = {} if key is None else {"deterministic": False}
        prediction = module.apply({"params": params}, batch.graph, rngs=_rngs(key), **options)
        value = squared_error(prediction=prediction, target=batch.coefficients, mask=batch.mask)  # type: ignore[arg-type]
        return value, {"mse": value}

    return loss


def _visibility_loss(module: nn.Module) -> LossFn:
    def loss(params: Any, batch: Batch, key: jax.Array | None) -> tuple[Array, dict[str, Array]]:
        # in one block while training: only inference is cut into blocks
        options: dict[str, Any] = {"deterministic": key is None}
        logits = module.apply({"params": params}, batch.graph, method="visibility_logits", **options)
        terms = {"logits": logits, "labels": batch.visibility, "mask": batch.mask}
        return balanced_bce(**terms), {"accuracy": visibility_accuracy(**terms)}  # type: ignore[arg-type]

    return loss


def phases(config: ModelConfig) -> list[Phase]:
    """The phases of a model, in order; shares add up to 1."""
    module = build_model(config)
    if config.name == "two-stage":
        return [
            Phase("visibility", 0.4, ("visibility",), _visibility_loss(module)),
            Phase("coefficients", 0.6, ("coefficient",), _coefficient_loss(module)),
        ]
    return [Phase("coefficients", 1.0, None, _coefficient_loss(module))]
