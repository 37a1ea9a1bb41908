"""Relighting: radiance that leaves a vertex under an environment, from its transfer and the light.

radiance_c = albedo_c * sum_k t_kc w_k L_kc with transfer t, one for all colours or one for each, radiance
coefficients L and an optional window w. The transfer holds the 1/pi of the diffuse reflection, so constant light of
radiance 1 shades an unoccluded vertex to exactly 1. Windows (`windows`) damp the ringing of small bright lights; they
act here, never in files. With a lobe the radiance is what a glossy surface reflects towards a viewer instead (`gloss`).
"""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike, as_array, is_real, shown
from gash_jax.light.brdf import Lobe
from gash_jax.light.container import LightLike, light_coefficients
from gash_jax.light.gloss import glossy_radiance
from gash_jax.light.windows import light_window
from gash_jax.prt.texture import TransferTexture
from gash_jax.prt.transfer import TransferLike, transfer_coefficients

_TEXELS = 1 << 18  # that are shaded at once


def shade(
    transfer: TransferLike,
    light: LightLike,
    albedo: ArrayLike | Array | None = None,
    window: str | ArrayLike | Array | None = None,
    *,
    view: ArrayLike | Array | None = None,
    lobe: Lobe | None = None,
) -> Float[Array, "v 3"]:
    """Linear radiance leaving each vertex; works under jit, vmap and grad.

    `transfer` is a Transfer or coefficients (v, k) or (v, k, 3), `light` a Light or coefficients (j, 3); a light with
    more bands than the transfer is cut to those of the transfer. `albedo` is one colour (3,) or one per vertex (v, 3),
    white if None; `window` one factor per transfer coefficient (k,), or the kind of a window for this light in as many
    bands as the transfer has, as `light_window` knows them. Raises ValueError for other shapes, and if the light has
    fewer bands than the transfer: project it again with as many.

    `lobe` (`phong`, `ggx`) makes it the radiance that a glossy surface reflects towards `view`, the position of a
    camera (3,) or a direction towards the viewer for each vertex (v, 3); the transfer must be a glossy bake, and
    `albedo` is the colour of the reflection.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", rays=64)
    >>> radiance = gash_jax.shade(transfer, gash_jax.load_light("studio.hdr"), albedo=np.array([0.8, 0.6, 0.5]))
    >>> radiance.shape
    (362, 3)
    >>> glossy = gash_jax.bake_transfer("bunny.ply", rays=64, glossy=True)
    >>> camera = np.array([0.0, 1.0, 5.0])
    >>> gash_jax.shade(glossy, gash_jax.load_light("studio.hdr"), view=camera, lobe=gash_jax.phong(30)).shape
    (362, 3)
    """
    coefficients = jnp.asarray(transfer_coefficients(transfer))
    radiance = jnp.asarray(light_coefficients(light))
    count = coefficients.shape[1]
    factors = None if albedo is None else _factors("albedo", albedo, [(3,), (len(coefficients), 3)])
    if radiance.shape[0] < count:
        raise ValueError(
            f"the light has {radiance.shape[0]} coefficients, the transfer {count}: "
            f"project the light again with {round(count**0.5)} bands"
        )
    radiance = radiance[:count]
    if window is not None:
        named = light_window(radiance, window) if isinstance(window, str) else window
        radiance = radiance * _factors("window", named, [(count,)]).astype(radiance.dtype)[:, None]
    if lobe is not None:
        leaving = glossy_radiance(transfer, radiance, view, lobe)
    elif view is not None:
        raise ValueError("diffuse radiance is the same for every view: give a lobe, phong(exponent) or ggx(roughness)")
    elif coefficients.ndim == 2:
        leaving = jnp.matmul(coefficients, radiance, precision="highest")
    else:
        leaving = jnp.einsum("vkc,kc->vc", coefficients, radiance, precision="highest")
    return leaving if factors is None else leaving * jnp.broadcast_to(factors, leaving.shape)


def shade_texture(
    texture: TransferTexture,
    light: LightLike,
    albedo: ArrayLike | Array | None = None,
    window: str | ArrayLike | Array | None = None,
) -> Float[np.ndarray, "n n 3"]:
    """Linear radiance at each texel of a transfer texture; `albedo` is one colour (3,), `window` as for `shade`.

    Raises ValueError as `shade`.

    >>> square = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]])
    >>> texture = gash_jax.bake_texture(square, rays=16, size=8, uv=uv)
    >>> gash_jax.shade_texture(texture, gash_jax.load_light("studio.hdr")).shape
    (8, 8, 3)
    """
    if not isinstance(texture, TransferTexture):
        raise ValueError(f"a {type(texture).__name__} is no TransferTexture: give what bake_texture returns")
    if albedo is not None and np.shape(as_array(albedo)) != (3,):
        raise ValueError(f"albedo has shape {np.shape(as_array(albedo))}: give one colour (3,) for all texels")
    values = texture.texture
    texels = values.reshape(-1, *values.shape[2:])
    if isinstance(window, str):
        window = light_window(np.asarray(light_coefficients(light))[: texels.shape[1]], window)
    parts = [texels[start : start + _TEXELS].astype(np.float32) for start in range(0, len(texels), _TEXELS)]
    shaded = [np.asarray(shade(part, light, albedo, window)) for part in parts]
    return np.concatenate(shaded).reshape(*values.shape[:2], 3)


def _factors(name: str, value: object, shapes: list[tuple[int, ...]]) -> Array:
    found = as_array(value)
    wanted = " or ".join(map(str, shapes))
    if not is_real(found):
        raise ValueError(f"{name} is {shown(value)}: give numbers {wanted}")
    if found.shape not in shapes:
        raise ValueError(f"{name} has shape {found.shape}: give {wanted}")
    return jnp.asarray(found)
