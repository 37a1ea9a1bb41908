"""Rotation of spherical-harmonic coefficients.

D(R) is block-diagonal, one orthogonal (2l+1, 2l+1) block per band, with

    Y_l(R n) = D_l(R) Y_l(n)   for every direction n.

So the coefficients D(R) c describe the function w -> f(R^-1 w) when c describes f: the function turned by R. D_0 = 1
and D_1 is R with its axes in the order (y, z, x). For l > 1 the definition, taken at 2l+1 fixed directions N, is a
square linear system with the exact solution

    D_l(R) = Y_l(R N) Y_l(N)^-1,

whose inverse is a constant formed in float64. N are approximate Fekete points, so that its condition number is below
9 in every band. Unlike in a recurrence over l no error accumulates, half turns are nothing special, and the gradients
with respect to R are those of polynomials. `rotations.rotation_matrix` gives R of a quaternion, rotor or motor;
`rotor_quadrature` turns coefficients by rotors without D.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra.directions import fibonacci_hemisphere
from gash_jax.algebra.sh import PRODUCT_BANDS, sh_components, validate_bands

_CANDIDATES = 1000


def _band(directions: np.ndarray, band: int) -> np.ndarray:
    """Y_l at (n, 3) directions, (n, 2l+1)."""
    x, y, z = directions.T
    return np.stack(sh_components(x, y, z, band + 1)[band * band :], axis=-1)


@functools.cache
def fixed_system(band: int) -> tuple[np.ndarray, np.ndarray]:
    """The 2l+1 fixed directions N of a band, (2l+1, 3), and Y_l(N)^-1 with Y_l(N) one column per direction.

    Each next direction is the candidate whose Y_l is furthest from the span of those chosen before. A hemisphere
    of candidates suffices, as Y_l(-n) = (-1)^l Y_l(n).
    """
    candidates = fibonacci_hemisphere(_CANDIDATES)
    residual = _band(candidates, band)
    chosen = []
    for _ in range(2 * band + 1):
        lengths = np.linalg.norm(residual, axis=1)
        # The first lengths are all equal but for rounding: the rounded ones make the choice the same everywhere.
        chosen.append(int(np.argmax(np.round(lengths, 9))))
        axis = residual[chosen[-1]] / lengths[chosen[-1]]
        residual = residual - np.outer(residual @ axis, axis)
    directions = candidates[chosen]
    return directions, np.linalg.inv(_band(directions, band).T)


def _turned_basis(rotation: Array, band: int) -> tuple[Array, Array]:
    """Y_l(R N), (..., 2l+1, 2l+1) with one column per direction, and the constant Y_l(N)^-1."""
    directions, inverse = (jnp.asarray(constant, rotation.dtype) for constant in fixed_system(band))
    turned = jnp.einsum("...ij,nj->...ni", rotation, directions, precision="highest")
    components = sh_components(turned[..., 0], turned[..., 1], turned[..., 2], band + 1)[band * band :]
    return jnp.stack([jnp.asarray(component) for component in components], axis=-2), inverse


def _block(rotation: Array, band: int) -> Array:
    """D_l of rotation matrices."""
    if band == 0:
        return jnp.ones_like(rotation[..., :1, :1])
    if band == 1:
        order = np.array([1, 2, 0])
        return rotation[..., order[:, None], order]
    basis, inverse = _turned_basis(rotation, band)
    return jnp.matmul(basis, inverse, precision="highest")


def _turn(coefficients: Array, rotation: Array, band: int) -> Array:
    """D_l c without forming D_l: the products are sums along a short last axis, which XLA fuses; a batch of small
    matrix products would take five times as long on a CPU."""
    if band == 0:
        return coefficients
    if band == 1:
        matrix, vector = _block(rotation, 1), coefficients
    else:
        matrix, inverse = _turned_basis(rotation, band)
        vector = jnp.matmul(coefficients, inverse.T, precision="highest")
    shape = jnp.broadcast_shapes(matrix.shape[:-2], vector.shape[:-1])
    matrix = jnp.broadcast_to(matrix, (*shape, *matrix.shape[-2:]))
    return jnp.sum(matrix * jnp.broadcast_to(vector, (*shape, vector.shape[-1]))[..., None, :], axis=-1)


@functools.partial(jax.jit, static_argnames="bands")
def sh_rotation_blocks(rotation: Float[Array | np.ndarray, "... 3 3"], bands: int) -> list[Float[Array, "... _ _"]]:
    """Blocks D_0 .. D_(bands - 1) of rotation matrices, (..., 2l+1, 2l+1) each."""
    validate_bands(bands, PRODUCT_BANDS)
    return [_block(jnp.asarray(rotation), band) for band in range(bands)]


@jax.jit
def rotate_coefficients(
    coefficients: Float[Array | np.ndarray, "*v k"], rotation: Float[Array | np.ndarray, "*r 3 3"]
) -> Float[Array, "... k"]:
    """Coefficients of the function turned by the rotation: D(R) c. Leading shapes broadcast."""
    coefficients = jnp.asarray(coefficients)
    bands = math.isqrt(coefficients.shape[-1])
    if bands * bands != coefficients.shape[-1] or not 1 <= bands <= PRODUCT_BANDS:
        raise ValueError(
            f"{coefficients.shape[-1]} coefficients are no whole number of bands: the last axis must hold bands^2, "
            f"bands from 1 to {PRODUCT_BANDS} (put colours on a leading axis)"
        )
    rotation = jnp.asarray(rotation)
    if rotation.ndim == 2 and coefficients.ndim > 1:  # one turn of many: a single product takes a quarter of the time
        matrix = jax.scipy.linalg.block_diag(*(_block(rotation, band) for band in range(bands)))
        return jnp.matmul(coefficients, matrix.T, precision="highest")
    parts = [_turn(coefficients[..., band**2 : (band + 1) ** 2], rotation, band) for band in range(bands)]
    shape = parts[-1].shape[:-1]
    return jnp.concatenate([jnp.broadcast_to(part, (*shape, part.shape[-1])) for part in parts], axis=-1)
