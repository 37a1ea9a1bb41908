"""Rotation of spherical-harmonic coefficients.

D(R) is block-diagonal, one orthogonal (2l+1, 2l+1) block per band, with

    Y_l(R n) = D_l(R) Y_l(n)   for every direction n.

So the coefficients D(R) c describe the function w -> f(R^-1 w) when c describes f: the function turned by R. D_1 is R
with its axes in the order (y, z, x). Taken at a fixed set of directions N the definition is a linear system, and

    D_l(R) = Y_l(R N) pinv(Y_l(N))

solves it exactly; the set is chosen such that every Y_l(N) is well conditioned, and the pseudo-inverse is a constant
formed in float64. Unlike a recurrence in l no error accumulates, half turns are nothing special, and gradients with
respect to R are those of polynomials. A rotation given as a rotor goes through `motors.rotor_to_matrix`.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra.directions import fibonacci_hemisphere
from gash_jax.algebra.sh import MAX_BANDS, sh_components, validate_bands


@functools.cache
def _fixed_directions(bands: int) -> np.ndarray:
    """Directions N, (n, 3): a hemisphere suffices, as Y_l(-n) = (-1)^l Y_l(n)."""
    return fibonacci_hemisphere(3 * bands)


@functools.cache
def _inverse_basis(bands: int) -> tuple[np.ndarray, ...]:
    """Pseudo-inverse of Y_l at the fixed directions for each band, (n, 2l+1)."""
    basis = np.stack(sh_components(*_fixed_directions(bands).T, bands), axis=-1)
    return tuple(
        np.linalg.pinv(basis[:, band * band : (band + 1) ** 2].T) for band in range(bands)
    )


def _turned_basis(rotation: Array, bands: int) -> Array:
    """Y_k(R N) as (k, n, ...): the batch comes last, where it makes long contiguous rows."""
    matrix = jnp.moveaxis(rotation, (-2, -1), (0, 1))
    shape = (-1, *(1,) * (rotation.ndim - 2))
    directions = [jnp.asarray(axis, rotation.dtype).reshape(shape) for axis in _fixed_directions(bands).T]
    turned = (sum(entry[None] * axis for entry, axis in zip(row, directions, strict=True)) for row in matrix)
    return jnp.stack([jnp.asarray(component) for component in sh_components(*turned, bands)])


@functools.partial(jax.jit, static_argnames="bands")
def sh_rotation_blocks(
    rotation: Float[Array | np.ndarray, "... 3 3"], bands: int
) -> list[Float[Array, "... _ _"]]:
    """Blocks D_0 .. D_(bands - 1) of rotation matrices, (..., 2l+1, 2l+1) each."""
    validate_bands(bands)
    rotation = jnp.asarray(rotation)
    turned = _turned_basis(rotation, bands)
    blocks = []
    for band, inverse in enumerate(_inverse_basis(bands)):
        basis, inverse = turned[band * band : (band + 1) ** 2], jnp.asarray(inverse, rotation.dtype)
        blocks.append(jnp.einsum("in...,nj->...ij", basis, inverse, precision="highest"))
    return blocks


@jax.jit
def rotate_coefficients(
    coefficients: Float[Array | np.ndarray, "... k"], rotation: Float[Array | np.ndarray, "... 3 3"]
) -> Float[Array, "... k"]:
    """Coefficients of the function turned by the rotation: D(R) c. Leading shapes broadcast.

    D_l(R) c_l = Y_l(R N) (pinv(Y_l(N)) c_l) needs no blocks.
    """
    coefficients, rotation = jnp.asarray(coefficients), jnp.asarray(rotation)
    bands = math.isqrt(coefficients.shape[-1])
    if bands * bands != coefficients.shape[-1] or not 1 <= bands <= MAX_BANDS:
        raise ValueError(
            f"{coefficients.shape[-1]} coefficients are no whole number of bands: the last axis must hold bands^2, "
            f"bands from 1 to {MAX_BANDS} (put colours on a leading axis)"
        )
    batch = np.broadcast_shapes(coefficients.shape[:-1], rotation.shape[:-2])
    rotation = rotation.reshape(*(1,) * (len(batch) + 2 - rotation.ndim), *rotation.shape)
    turned = _turned_basis(rotation, bands)
    parts = []
    for band, inverse in enumerate(_inverse_basis(bands)):
        part = coefficients[..., band * band : (band + 1) ** 2]
        part = part.reshape(*(1,) * (len(batch) + 1 - part.ndim), *part.shape)
        samples = jnp.einsum("...j,nj->n...", part, jnp.asarray(inverse, part.dtype), precision="highest")
        parts.append(jnp.sum(turned[band * band : (band + 1) ** 2] * samples[None], axis=1))
    return jnp.moveaxis(jnp.concatenate(parts), 0, -1)
