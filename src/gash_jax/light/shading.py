"""Relighting: radiance that leaves a vertex under an environment, from its transfer and the light.

radiance_c = albedo_c * sum_k t_kc w_k L_kc with transfer t, one for all colours or one for each, radiance
coefficients L and an optional window w. The transfer holds the 1/pi of the diffuse reflection, so constant light of
radiance 1 shades an unoccluded vertex to exactly 1. Windows (see `gash_jax.algebra.sh`) damp the ringing of small
bright lights; they act here, never in files.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.light.environment import Light
from gash_jax.prt.transfer import Transfer


def shade(
    transfer: Transfer | Float[Array | np.ndarray, "v k"] | Float[Array | np.ndarray, "v k 3"],
    light: Light | Float[Array | np.ndarray, "j 3"],
    albedo: Float[Array | np.ndarray, "*v 3"] | None = None,
    window: Float[Array | np.ndarray, " k"] | None = None,
) -> Float[Array, "v 3"]:
    """Linear radiance leaving each vertex; works under jit, vmap and grad.

    A light with more bands than the transfer is cut to the bands of the transfer. `albedo` is one colour (3,) or one
    per vertex (v, 3), white if None; `window` one factor per transfer coefficient. Raises ValueError if the light has
    fewer bands than the transfer: project it again with as many.
    """
    coefficients = jnp.asarray(transfer.coefficients if isinstance(transfer, Transfer) else transfer)
    radiance = jnp.asarray(light.coefficients if isinstance(light, Light) else light)
    count = coefficients.shape[1]
    if radiance.shape[0] < count:
        raise ValueError(
            f"the light has {radiance.shape[0]} coefficients, the transfer {count}: "
            f"project the light again with {round(count**0.5)} bands"
        )
    radiance = radiance[:count]
    if window is not None:
        radiance = radiance * jnp.asarray(window, radiance.dtype)[:, None]
    if coefficients.ndim == 2:
        leaving = jnp.matmul(coefficients, radiance, precision="highest")
    else:
        leaving = jnp.einsum("vkc,kc->vc", coefficients, radiance, precision="highest")
    if albedo is None:
        return leaving
    return leaving * jnp.broadcast_to(jnp.asarray(albedo), leaving.shape)
