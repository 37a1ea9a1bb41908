"""Integrals over the hemisphere of a normal in closed form, and the transfer of a vertex that nothing shadows.

A kernel that depends on the cosine z = n.w alone has the coefficients K_l Y_lm(n), K_l = 2 pi times the integral of
its value times the Legendre polynomial P_l(z) over z (Funk & Hecke). Three kernels occur:

    clamped cosine   max(z, 0)          A_l  (Ramamoorthi & Hanrahan 2001, eq. 8)
    hemisphere       1 for z > 0        H_l
    cap              1 for z > cos a    4 pi sin²(a/2), then 2 pi sin² a P_l'(cos a) / (l (l + 1))

The last is the integral of Legendre's equation ((1 - z²) P_l')' + l (l + 1) P_l = 0; it keeps its digits however small
the half-angle a is.

Unshadowed transfer is t_lm = A_l / pi Y_lm(n): a formula, never sampled.
"""

import math

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike, WholeNumber, as_array, is_real
from gash_jax.algebra.sh import band_index, evaluate_sh, legendre_functions, validate_bands


def _existing(band: int) -> None:
    if band < 0:
        raise ValueError(f"band {band} does not exist: use 0 or more")


def clamped_cosine(band: int) -> float:
    """Factor A_l of the clamped cosine in band l >= 0."""
    _existing(band)
    if band == 1:
        return 2.0 * math.pi / 3.0
    if band % 2 == 1:
        return 0.0
    half = band // 2
    # l! / (2^l (l/2)!^2) as an exact ratio of integers: no overflow, no rounding before the division.
    central = math.comb(band, half) / 2**band
    return 2.0 * math.pi * (-1) ** (half - 1) / ((band + 2) * (band - 1)) * central


def clamped_cosine_coefficients(bands: int) -> Float[np.ndarray, " k"]:
    """Factor A_l for each coefficient k, float64."""
    return np.array([clamped_cosine(int(band)) for band in band_index(bands)])


def hemisphere(band: int) -> float:
    """Factor H_l of the hemisphere in band l >= 0: 2 pi, then 0 in even bands.

    The integral of P_l over [0, 1] is P_(l-1)(0) / (l + 1) for odd l, and |P_2j(0)| = (2j)! / (2^j j!)^2.
    """
    _existing(band)
    if band % 2 == 0:
        return 2.0 * math.pi if band == 0 else 0.0
    half = (band - 1) // 2
    return 2.0 * math.pi * (-1) ** half * (math.comb(band - 1, half) / 2 ** (band - 1)) / (band + 1)


def cap(bands: int, half_angle: float | Float[Array, ""]) -> Float[Array, " b"]:
    """Factors of a cap of half-angle a (radians) in the bands l = 0 .. bands - 1; a = pi / 2 is the hemisphere.

    P_l' = P_(l-1)' z + l P_(l-1) (Abramowitz & Stegun, from 8.5.3 and 8.5.4). Works under jit, vmap and grad.
    """
    angle = jnp.asarray(half_angle, jnp.float32)
    z, one = jnp.cos(angle), jnp.ones_like(angle)
    legendre = legendre_functions(z, one, validate_bands(bands), 0)
    factors, slope = [4.0 * math.pi * jnp.sin(angle / 2.0) ** 2], 0.0 * one
    for band in range(1, bands):
        slope = slope * z + band * legendre[band - 1]
        factors.append(2.0 * math.pi * jnp.sin(angle) ** 2 * slope / (band * (band + 1)))
    return jnp.stack(factors)


def zero_without_normal(
    coefficients: Float[Array, "v k"], normals: Float[Array | np.ndarray, "v 3"]
) -> Float[Array, "v k"]:
    """The coefficients, exactly 0 (and with gradient 0) at vertices whose normal is 0."""
    return jnp.where(jnp.any(jnp.asarray(normals) != 0, axis=-1, keepdims=True), coefficients, 0.0)


def unshadowed_transfer(normals: ArrayLike | Array, bands: WholeNumber = 3) -> Float[Array, "v k"]:
    """Exact transfer without shadows, A_l Y_k(n) / pi, of unit normals (v, 3); 0 where a normal is 0.

    Works under jit, vmap and grad. Raises ValueError for another shape and for bands outside 1 to 10.

    >>> up = gash_jax.unshadowed_transfer(np.array([[0.0, 1.0, 0.0]]), bands=2)
    >>> [round(float(t), 4) for t in up[0]]
    [0.2821, 0.3257, 0.0, 0.0]
    """
    bands, given = validate_bands(bands), as_array(normals)
    if given.ndim != 2 or given.shape[1] != 3 or not is_real(given):
        raise ValueError(f"normals have shape {given.shape} {given.dtype}: give (v, 3) unit vectors")
    normals = jnp.asarray(given) if given.dtype.kind not in "iu" else jnp.asarray(given, jnp.float32)
    factors = jnp.asarray(clamped_cosine_coefficients(bands) / np.pi, jnp.float32)
    return zero_without_normal(evaluate_sh(normals, bands) * factors[None], normals)
