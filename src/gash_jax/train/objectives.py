"""The phases of a family as functions that the loop can run: output, loss, measures.

A phase is validated on all validation vertices at once: its loss, and measures that people read.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.measure import metrics
from gash_jax.models.examples import Batch
from gash_jax.models.families import build_model, family_of
from gash_jax.models.phases import Phase
from gash_jax.nn.config import ModelConfig
from gash_jax.train.precision import in_half

# (params, batch, dropout key or None) -> output of every vertex
OutputFn = Callable[[Any, Batch, jax.Array | None], Float[Array, "v m"]]


class Objective(NamedTuple):
    """A phase, and how its output is had from a batch."""

    phase: Phase
    output: OutputFn

    def loss(self, params: Any, batch: Batch, key: jax.Array | None) -> Float[Array, ""]:
        """The loss of a batch, in which vertices count by their weight."""
        labels = flat(getattr(batch, self.phase.labels))
        return self.phase.loss(self.output(params, batch, key), labels, flat(batch.weight))

    def measure(self, output: np.ndarray, labels: np.ndarray, normals: np.ndarray) -> dict[str, float]:
        """Measures by name of what was predicted on the host."""
        columns = labels.shape[1] if self.phase.columns is None else self.phase.columns
        return MEASURES[self.phase.labels](output[:, :columns], labels[:, :columns], normals)


def flat(array: Array | np.ndarray) -> Array:
    """The vertices of all shards in one axis."""
    return jnp.asarray(array).reshape(-1, *array.shape[2:])


def _output(module: nn.Module, method: str, half: bool) -> OutputFn:
    """Apply the module to every shard: side by side where there are several, so that each device keeps its own."""

    def output(params: Any, batch: Batch, key: jax.Array | None) -> Array:
        shards = len(batch.mask)
        keys = None if key is None else jax.random.split(key, shards) if shards > 1 else key[None]

        def one(inputs: Any, key: jax.Array | None) -> Array:
            # in one block while training: only inference is cut into blocks
            rngs = {} if key is None else {"dropout": key}
            weights, inputs = in_half(params, inputs) if half else (params, inputs)
            out = module.apply({"params": weights}, inputs, deterministic=key is None, rngs=rngs, method=method)
            return jnp.asarray(out, jnp.float32)

        if shards > 1:
            return flat(jax.vmap(one)(batch.inputs, keys))
        return one(jax.tree.map(lambda leaf: leaf[0], batch.inputs), None if keys is None else keys[0])

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


# by the labels that a phase is held against
MEASURES = {"coefficients": _coefficient_measures, "visibility": _visibility_measures}


@cache
def objectives(config: ModelConfig, half: bool = False) -> tuple[Objective, ...]:
    """What a network is trained for, in order; shares add up to 1. `half`: the networks compute in float16.

    The same ones for equal configs, so that what was compiled for one run serves the next of the same process.
    """
    module = build_model(config)
    return tuple(Objective(phase, _output(module, phase.method, half)) for phase in family_of(config).phases(config))
