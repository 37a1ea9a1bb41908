"""Three bands in five numbers or four: quadratic zonal harmonics, ZH3 (Roughton, Sloan, Silvennoinen, Iwanicki and
Shirley, ZH3: Quadratic Zonal Harmonics, 2024).

Bands 0 and 1 are kept, c_0 and the vector of c_1 = (y, z, x). Band 2 is replaced by a function that is symmetric about
the axis d of that vector,

    c_2m = z Z_m(d),    Z_m(d) = sqrt(4 pi / 5) Y_2m(d),    z = sum over m of c_2m Z_m(d),

the nearest one, as Z(d) has length 1. A function that is symmetric about any axis and not even is returned exactly.
With four numbers z follows from the ratio r = |c_1| / c_0. There is one such curve for light and one for transfer:

- `light_curve`: z = c_0 (0.08 r + 0.6 r²), their fit to environment maps (section 3.4.3).
- `transfer_curve`, with q = r sqrt(3) / 2: what is exact for transfer of a vertex whose sky is a cone about its normal
  (q >= 1), t_00 = sqrt(pi)/2 (1 - u²), t_10 = sqrt(pi/3) (1 - u³), t_20 = sqrt(5 pi)/8 (1 - u²)(1 + 3 u²) with u the
  cosine of its half-angle, so q = (1 + u + u²) / (1 + u), or the hemisphere without a cone (q <= 1), q = u:

      z / c_0 = sqrt(5)/4 (1 + 3 u²),   u = (q - 1 + sqrt((q - 1)(q + 3))) / 2      for q >= 1,
      z / c_0 = sqrt(5)/4 (3 q² - 2)                                               for q <= 1.

  At q = 1 nothing is hidden, and both are sqrt(5)/4.
"""

from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.numerics import safe_norm, safe_normalize
from gash_jax.algebra.sh import sh_components

Curve = Callable[[Float[Array, "..."]], Float[Array, "..."]]


def to_zonal(coefficients: Float[Array | np.ndarray, "... k"]) -> Float[Array, "... 5"]:
    """Bands 0 and 1 and the number z of three or more bands; z is 0 where band 1 is 0."""
    values = jnp.asarray(coefficients)
    zonal = jnp.sum(values[..., 4:9] * _zonal_basis(values[..., 1:4]), axis=-1, keepdims=True)
    return jnp.concatenate([values[..., :4], zonal], axis=-1)


def from_zonal(numbers: Float[Array | np.ndarray, "... n"], curve: Curve) -> Float[Array, "... 9"]:
    """Three bands from five numbers, or from four by a curve z / c_0 of r."""
    values = jnp.asarray(numbers)
    linear = values[..., 1:4]
    if values.shape[-1] == 5:
        zonal = values[..., 4:]
    else:
        mean = values[..., :1]
        lit = mean > 0
        ratio = safe_norm(linear)[..., None] / jnp.where(lit, mean, 1.0)
        zonal = jnp.where(lit, mean * curve(ratio), 0.0)
    return jnp.concatenate([values[..., :4], zonal * _zonal_basis(linear)], axis=-1)


def light_curve(ratio: Float[Array, "..."]) -> Float[Array, "..."]:
    """z / c_0 of light (module docstring)."""
    return ratio * (0.08 + 0.6 * ratio)


def transfer_curve(ratio: Float[Array, "..."]) -> Float[Array, "..."]:
    """z / c_0 of transfer (module docstring); q beyond that of a single direction counts as that."""
    q = jnp.minimum(ratio * (3.0**0.5 / 2.0), 1.5)
    above = jnp.maximum(q - 1.0, 0.0)
    root = jnp.sqrt(jnp.where(above > 0, above * (above + 4.0), 1.0))
    u = jnp.where(above > 0, (above + root) / 2.0, 0.0)
    return 5.0**0.5 / 4.0 * jnp.where(q > 1.0, 1.0 + 3.0 * u * u, 3.0 * q * q - 2.0)


def _zonal_basis(linear: Float[Array, "... 3"]) -> Float[Array, "... 5"]:
    """Z(d) of the axis of band 1, (y, z, x); 0 where that is 0."""
    axis = safe_normalize(linear)
    y, z, x = (axis[..., i] for i in range(3))
    band = jnp.stack([jnp.asarray(part) for part in sh_components(x, y, z, 3)[4:]], axis=-1)
    return (4.0 * np.pi / 5.0) ** 0.5 * jnp.where(jnp.any(axis != 0, axis=-1, keepdims=True), band, 0.0)
