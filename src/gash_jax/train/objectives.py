"""What each model minimises, as a list of phases that are trained one after the other.

The two-stage network (GNN paper, 4.2) first learns visibility by class-balanced BCE, then, with that net fixed,
coefficients by MSE. `local` learns coefficients by MSE and then, with them fixed, what errors to expect. Every other
model has one phase. A phase is validated on all validation vertices at once: its loss, and measures that people read.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.measure import metrics
from gash_jax.models.batches import Batch
from gash_jax.models.config import ModelConfig, build_model
from gash_jax.models.losses import Mask, balanced_bce, masked_mean, squared_error
from gash_jax.train.precision import in_half

# (params, batch, dropout key or None) -> output of every vertex
OutputFn = Callable[[Any, Batch, jax.Array | None], Float[Array, "v m"]]
# (output, labels, mask) -> loss
LossFn = Callable[..., Float[Array, ""]]
# (output, labels, normals) on the host -> measures by name
MeasureFn = Callable[[np.ndarray, np.ndarray, np.ndarray], dict[str, float]]


class Phase(NamedTuple):
    """`trainable` names the top-level parameters that change (None: all); `share` is the part of the budget.

    `labels` is the field of the batch that `loss` is held against.
    """

    name: str
    share: float
    trainable: tuple[str, ...] | None
    labels: str
    output: OutputFn
    loss: LossFn
    measure: MeasureFn

    def objective(self, params: Any, batch: Batch, key: jax.Array | None) -> Float[Array, ""]:
        """The loss of a batch."""
        return self.loss(self.output(params, batch, key), flat(getattr(batch, self.labels)), flat(batch.weight))


def flat(array: Array | np.ndarray) -> Array:
    """The vertices of all shards in one axis."""
    return jnp.asarray(array).reshape(-1, *array.shape[2:])


def _output(module: nn.Module, method: str, half: bool) -> OutputFn:
    """Apply the module to every shard: side by side where there are several, so that each device keeps its own."""

    def output(params: Any, batch: Batch, key: jax.Array | None) -> Array:
        shards = len(batch.mask)
        keys = None if key is None else jax.random.split(key, shards) if shards > 1 else key[None]

        def one(graph: Any, key: jax.Array | None) -> Array:
            # in one block while training: only inference is cut into blocks
            rngs = {} if key is None else {"dropout": key}
            weights, graph = in_half(params, graph) if half else (params, graph)
            out = module.apply({"params": weights}, graph, deterministic=key is None, rngs=rngs, method=method)
            return jnp.asarray(out, jnp.float32)

        if shards > 1:
            return flat(jax.vmap(one)(batch.graph, keys))
        return one(jax.tree.map(lambda leaf: leaf[0], batch.graph), None if keys is None else keys[0])

    return output


def _coefficient_measures(output: np.ndarray, labels: np.ndarray, normals: np.ndarray) -> dict[str, float]:
    skill = metrics.skill(output, labels, normals)
    return {
        "mse": metrics.mse(output, labels),
        "relrmse": metrics.relrmse(output, labels) or 0.0,
        "shadow_mse": metrics.shadow_mse(output, labels),
        "skill": skill if isinstance(skill, float) else float("nan"),
    }


def _visibility_measures(output: np.ndarray, labels: np.ndarray, normals: np.ndarray) -> dict[str, float]:
    return metrics.visibility_scores(output > 0, labels > 0.5)


def _squared(output: Float[Array, "v k"], labels: Float[Array, "v k"], mask: Mask) -> Float[Array, ""]:
    return squared_error(prediction=output, target=labels, mask=mask)


def _balanced(output: Float[Array, "v n"], labels: Float[Array, "v n"], mask: Mask) -> Float[Array, ""]:
    return balanced_bce(logits=output, labels=labels, mask=mask)


def _squared_first(output: Float[Array, "v m"], labels: Float[Array, "v k"], mask: Mask) -> Float[Array, ""]:
    """MSE of the coefficients that `nn.surfel_net` says first."""
    return squared_error(prediction=output[:, : labels.shape[1]], target=labels, mask=mask)


def _likelihood(output: Float[Array, "v m"], labels: Float[Array, "v k"], mask: Mask) -> Float[Array, ""]:
    """Of what `nn.surfel_net` says of its own and the closed form's errors: normal ones, in each band, negative log."""
    k = labels.shape[1]
    bands = round(k**0.5)
    raw, exact, doubts = output[:, :k], output[:, k : 2 * k], output[:, 2 * k :]
    terms = []
    for estimate, doubt in ((raw, doubts[:, :bands]), (exact, doubts[:, bands:])):
        square = (estimate - labels) ** 2
        bandwise = [jnp.mean(square[:, band**2 : (band + 1) ** 2], axis=1) for band in range(bands)]
        terms.append(doubt + jnp.stack(bandwise, axis=1) * jnp.exp(-doubt))
    return masked_mean(jnp.concatenate(terms, axis=1), jnp.asarray(mask > 0, labels.dtype))


def phases(config: ModelConfig, half: bool = False) -> list[Phase]:
    """The phases of a model, in order; shares add up to 1. `half`: the networks compute in float16."""
    module = build_model(config)

    def coefficients(share: float, trainable: tuple[str, ...] | None) -> Phase:
        output = _output(module, "__call__", half)
        return Phase("coefficients", share, trainable, "coefficients", output, _squared, _coefficient_measures)

    if config.name == "local":
        output = _output(module, "with_error", half)
        measure = lambda out, labels, normals: _coefficient_measures(out[:, : labels.shape[1]], labels, normals)  # noqa: E731
        body = ("surfel", "near", "mix", "head", *(f"hidden_{i}" for i in range(config.layers)))
        first = Phase("coefficients", 0.9, body, "coefficients", output, _squared_first, measure)
        return [first, Phase("doubt", 0.1, ("doubt", "error"), "coefficients", output, _likelihood, measure)]
    if config.name != "two-stage":
        return [coefficients(1.0, None)]
    logits = _output(module, "visibility_logits", half)
    visibility = Phase("visibility", 0.4, ("visibility",), "visibility", logits, _balanced, _visibility_measures)
    return [visibility, coefficients(0.6, ("coefficient",))]
