"""What is known of the transfer without any network: its unshadowed closed form, and 0 where there is no normal.

t_k = A_l / pi * Y_k(n)    (Ramamoorthi & Hanrahan 2001, for the transfer convention of this project)
"""

from math import pi

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra.sh import clamped_cosine_coefficients, evaluate_sh


def zero_without_normal(
    coefficients: Float[Array, "v k"], normals: Float[Array | np.ndarray, "v 3"]
) -> Float[Array, "v k"]:
    """The coefficients, exactly 0 (and with gradient 0) at vertices whose normal is 0."""
    return jnp.where(jnp.any(jnp.asarray(normals) != 0, axis=-1, keepdims=True), coefficients, 0.0)


def closed_form(normals: Float[Array | np.ndarray, "v 3"], bands: int) -> Float[Array, "v k"]:
    """Unshadowed transfer of every vertex in world directions; 0 at zero normals."""
    weights = jnp.asarray(clamped_cosine_coefficients(bands), jnp.float32)[None] / pi
    return zero_without_normal(weights * evaluate_sh(jnp.asarray(normals), bands), normals)
