"""Transfer and light in fewer numbers and fewer bits: what an engine or a phone keeps of a bake.

*Numbers*: the coefficients as they are, or of three bands five numbers or four (`algebra.zonal`). *Bits*: 32 are
floats; 16 and 8 are signed whole numbers c that stand for c / 32767 or c / 127 of `scale`, the largest magnitude there
is (SNORM, as graphics cards read it; -32768 and -128 do not occur). Nine floats a vertex are 36 bytes, five numbers of
8 bits are 5, and four are 4: those of a vertex colour.

Colours are compressed each for itself, about an axis of its own. Engines that take one axis for all three colours, that
of their luminance, differ where the colours do not point the same way.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.arguments import WholeNumber, shown, whole_number
from gash_jax.algebra.zonal import Curve, from_zonal, light_curve, to_zonal, transfer_curve
from gash_jax.light.container import LightLike, light_coefficients
from gash_jax.prt.transfer import TransferLike, transfer_coefficients

TYPES = {8: jnp.int8, 16: jnp.int16, 32: jnp.float32}


class Compressed(NamedTuple):
    """Numbers n of a transfer (v, n) or (v, n, 3), or of a light (n, 3): int8, int16 or float32; and their scale.

    >>> small = gash_jax.compress_transfer(gash_jax.bake_transfer("bunny.ply", rays=64), numbers=5, bits=8)
    >>> small.values.shape, small.values.nbytes
    ((362, 5), 1810)
    """

    values: Any
    scale: Any  # () float32: of whole numbers, what the largest stands for; of floats 1


def compress_transfer(transfer: TransferLike, numbers: WholeNumber | None = None, bits: WholeNumber = 8) -> Compressed:
    """A transfer in 5 or 4 `numbers` a vertex for its three or more bands, or all if None, of 8, 16 or 32 `bits` each.

    Four numbers are exact where nothing is hidden. Works under jit and vmap. Raises ValueError for other counts and
    bits, and for less than three bands where there are to be 5 or 4.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", rays=64)
    >>> small = gash_jax.compress_transfer(transfer, numbers=4)
    >>> light = gash_jax.load_light("studio.hdr")
    >>> gash_jax.shade(gash_jax.expand_transfer(small), light).shape
    (362, 3)
    """
    return _stored(_fewer(jnp.moveaxis(jnp.asarray(transfer_coefficients(transfer)), 1, -1), numbers), bits, 1)


def expand_transfer(compressed: Compressed) -> Float[Array, "v k *c"]:
    """Coefficients (v, k) or (v, k, 3) of a compressed transfer, float32: 9 of five or four numbers.

    >>> small = gash_jax.compress_transfer(gash_jax.bake_transfer("bunny.ply", rays=64), numbers=5, bits=16)
    >>> gash_jax.expand_transfer(small).shape
    (362, 9)
    """
    return jnp.moveaxis(_expanded(compressed, 1, transfer_curve), -1, 1)


def compress_light(light: LightLike, numbers: WholeNumber | None = None, bits: WholeNumber = 8) -> Compressed:
    """A light in 5 or 4 `numbers` a colour for its three or more bands, or all if None, of 8, 16 or 32 `bits` each.

    Works under jit and vmap. Raises ValueError as `compress_transfer`.

    >>> small = gash_jax.compress_light(gash_jax.load_light("studio.hdr"), numbers=4, bits=16)
    >>> small.values.shape, small.values.nbytes
    ((4, 3), 24)
    """
    return _stored(_fewer(jnp.asarray(light_coefficients(light)).T, numbers), bits, 0)


def expand_light(compressed: Compressed) -> Float[Array, "k 3"]:
    """Coefficients of a compressed light, float32: (9, 3) of five or four numbers.

    >>> light = gash_jax.load_light("studio.hdr")
    >>> small = gash_jax.compress_light(light, numbers=5, bits=32)
    >>> bool(np.allclose(gash_jax.expand_light(small)[:4], light.coefficients[:4]))
    True
    """
    return _expanded(compressed, 0, light_curve).T


def _fewer(rows: Float[Array, "... k"], numbers: object) -> Float[Array, "... n"]:
    if numbers is None:
        if rows.shape[-1] == 4:
            raise ValueError("two bands are four numbers already: store them as they are, or bake three")
        return rows
    count = whole_number(numbers, "numbers", 4, 5)
    if rows.shape[-1] < 9:
        raise ValueError(f"{rows.shape[-1]} coefficients are less than three bands: bake or project three")
    return to_zonal(rows)[..., :count]


def _stored(rows: Float[Array, "... n"], bits: object, axis: int) -> Compressed:
    kind = TYPES.get(whole_number(bits, "bits", 8, 32))
    if kind is None:
        raise ValueError(f"bits is {shown(bits)}: use 8, 16 or 32")
    values = jnp.moveaxis(rows.astype(jnp.float32), -1, axis)
    if kind == jnp.float32:
        return Compressed(values, jnp.ones((), jnp.float32))
    scale = jnp.max(jnp.abs(values), initial=0.0)
    largest = jnp.iinfo(kind).max
    return Compressed(jnp.round(values * (largest / jnp.where(scale > 0, scale, 1.0))).astype(kind), scale)


def _expanded(compressed: Compressed, axis: int, curve: Curve) -> Float[Array, "... k"]:
    values = jnp.moveaxis(jnp.asarray(compressed.values), axis, -1)
    if jnp.issubdtype(values.dtype, jnp.integer):
        values = values.astype(jnp.float32) * (jnp.asarray(compressed.scale) / jnp.iinfo(values.dtype).max)
    return from_zonal(values, curve) if values.shape[-1] in (4, 5) else values
