"""Norms whose values and gradients stay finite wherever float32 can represent the argument.

The plain ``sqrt(sum x^2)`` overflows from |x| = 1e19 on in float32, underflows below 1e-19, and its gradient at
zero is NaN. Here the vector is first divided by its largest component s. The norm is homogeneous of degree one
and the unit vector of degree zero, so s can be held constant in the derivative without changing it.
Vectors whose largest component is subnormal count as zero.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float


def _scaled(
    x: Float[Array, "... d"],
) -> tuple[Float[Array, "... d"], Float[Array, "... 1"], Bool[Array, "... 1"]]:
    """Return x divided by its largest component, that component, and whether x counts as zero."""
    largest = jax.lax.stop_gradient(jnp.max(jnp.abs(x), axis=-1, keepdims=True))
    is_zero = largest < jnp.finfo(x.dtype).tiny
    scale = jnp.where(is_zero, 1.0, largest)
    # A vector of ones stands in for zero, so that neither branch of a later `where` has a singular gradient.
    return jnp.where(is_zero, 1.0, x / scale), scale, is_zero


@jax.jit
def safe_norm(x: Float[Array | np.ndarray, "... d"]) -> Float[Array, "..."]:
    """Euclidean norm over the last axis; the gradient at zero is zero."""
    unit_scale, scale, is_zero = _scaled(jnp.asarray(x))
    norm = scale * jnp.sqrt(jnp.sum(unit_scale * unit_scale, axis=-1, keepdims=True))
    return jnp.where(is_zero, 0.0, norm)[..., 0]


@jax.jit
def safe_normalize(x: Float[Array | np.ndarray, "... d"]) -> Float[Array, "... d"]:
    """Unit vector along x over the last axis; zero, with zero gradient, where x is zero."""
    unit_scale, _, is_zero = _scaled(jnp.asarray(x))
    norm = jnp.sqrt(jnp.sum(unit_scale * unit_scale, axis=-1, keepdims=True))
    return jnp.where(is_zero, 0.0, unit_scale / norm)
