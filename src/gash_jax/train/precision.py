"""Half precision with a dynamic loss scale (Micikevicius et al. 2018): parameters and losses stay float32.

The loss is multiplied by a scale before it is differentiated, so that small gradients do not vanish in float16; a step
whose gradients overflow is skipped and halves the scale, and many good steps in a row double it
(`flax.training.dynamic_scale`). In float32 nothing is scaled and every step counts.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from flax.training.dynamic_scale import DynamicScale
from jaxtyping import Array, Bool, Float

# positions, normals and frames stay float32: the closed form is exact or it is nothing
HALVED = ("motor", "visibility", "relative")


def computes_in_half(precision: str) -> bool:
    """Whether a run with this setting computes in float16 here; "auto" does where the device has units for it."""
    return precision == "float16" or (precision == "auto" and jax.default_backend() == "gpu")


def initial_scale(half: bool) -> DynamicScale:
    """The state that goes into checkpoints; in float32 it never changes."""
    return DynamicScale(scale=jnp.float32(2.0**15 if half else 1.0), fin_steps=jnp.int32(0))  # type: ignore[arg-type]


def in_half(params: Any, inputs: Any) -> tuple[Any, Any]:
    """Weights, and of a network's inputs the arrays named in HALVED, in float16."""

    def halved(path: tuple, leaf: Array) -> Array:
        return jnp.asarray(leaf, jnp.float16) if getattr(path[-1], "key", None) in HALVED else leaf

    weights = jax.tree.map(lambda leaf: leaf.astype(jnp.float16), params)
    return weights, jax.tree_util.tree_map_with_path(halved, inputs)


def scaled_gradients(
    objective: Callable[[Any], Float[Array, ""]], params: Any, scale: DynamicScale, half: bool
) -> tuple[Float[Array, ""], Any, DynamicScale, Bool[Array, ""]]:
    """Loss, gradients, next scale, and whether the gradients are finite (always true in float32)."""
    if not half:
        loss, gradients = jax.value_and_grad(objective)(params)
        return loss, gradients, scale, jnp.bool_(True)
    following, finite, loss, gradients = scale.value_and_grad(objective)(params)
    return loss, gradients, following, finite
