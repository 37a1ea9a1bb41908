"""Gaunt coefficients of the real basis: what the product of two spherical harmonics is made of.

    G_ijk = integral over the sphere of Y_i Y_j Y_k,      Y_i Y_j = sum over k of G_ijk Y_k,

i and j in B bands, k in the 2B - 1 that such a product has. G is symmetric in its indices. It vanishes unless
|l_i - l_j| <= l_k <= l_i + l_j, l_i + l_j + l_k is even, and |m_k| is the sum or the difference of |m_i| and |m_j|: of
ten bands one in fifty is left. (Gaunt 1929; Homeier & Steinborn 1996 for real harmonics.)

The integrand is a polynomial of degree 4 (B - 1), so a quadrature of that degree gives G exactly but for rounding:
Gauss and Legendre's nodes in z times equal steps of azimuth.

With them multiplication by a function f is a matrix: of f = sum_k f_k Y_k it is M_ij = sum_k G_ijk f_k, the integral of
f Y_i Y_j, and M c are the coefficients of f times the function c, in B bands.
"""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra.sh import PRODUCT_BANDS, bands_of, sh_components, validate_bands

_ROUNDING = 1e-12  # the smallest coefficient of ten bands is 5e-6; of what vanishes the quadrature leaves 1e-14


class GauntTerms(NamedTuple):
    """The coefficients that are not 0, by their indices."""

    i: Int[np.ndarray, "t"]
    j: Int[np.ndarray, "t"]
    k: Int[np.ndarray, "t"]
    value: Float[np.ndarray, "t"]


@cache
def gaunt_terms(bands: int) -> GauntTerms:
    """All G_ijk other than 0, float64; i and j in `bands` bands from 1 to 10, k in 2 bands - 1."""
    nodes, weights = np.polynomial.legendre.leggauss(2 * validate_bands(bands) - 1)
    steps = 4 * bands - 3
    azimuth = 2 * np.pi * np.arange(steps) / steps
    z, azimuth = (grid.ravel() for grid in np.meshgrid(nodes, azimuth, indexing="ij"))
    r = np.sqrt(1 - z * z)
    basis = np.stack(sh_components(r * np.cos(azimuth), r * np.sin(azimuth), z, 2 * bands - 1), axis=-1)
    count = bands * bands
    pairs = (basis[:, :count, None] * basis[:, None, :count]).reshape(len(z), -1)
    area = np.repeat(weights, steps) * 2 * np.pi / steps
    product = (pairs.T @ (basis * area[:, None])).reshape(count, count, -1)
    i, j, k = np.nonzero(np.abs(product) > _ROUNDING)
    return GauntTerms(i, j, k, product[i, j, k])


def product_bands(count: int) -> int:
    """B, where a function has (2B-1)² coefficients. Raises ValueError where no B from 1 to 10 fits."""
    high = bands_of(count, PRODUCT_BANDS)
    if high % 2 == 0:
        raise ValueError(f"{count} coefficients are {high} bands: products need an odd number, 2 bands - 1")
    return (high + 1) // 2


@jax.jit
def product_matrices(function: Float[Array | np.ndarray, "*v j"]) -> Float[Array, "*v k k"]:
    """M_ij = sum_k G_ijk f_k of functions in 2B - 1 bands, (2B-1)² coefficients: the matrices in B bands, symmetric.

    Raises ValueError for another number of coefficients.
    """
    function = jnp.asarray(function)
    count = product_bands(function.shape[-1]) ** 2
    terms = gaunt_terms(product_bands(function.shape[-1]))
    dense = np.zeros((function.shape[-1], count, count))
    dense[terms.k, terms.i, terms.j] = terms.value
    flat = jnp.asarray(dense.reshape(len(dense), -1), function.dtype)
    return jnp.matmul(function, flat, precision="highest").reshape(*function.shape[:-1], count, count)


@jax.jit
def multiplier(function: Float[Array | np.ndarray, "k c"]) -> Float[Array, "j k c"]:
    """A_jic = sum_k G_ikj f_kc of c functions in B bands.

    It multiplies by them: a function in 2B - 1 bands with coefficients g_j times f_c is sum_j g_j A_jic in B bands.
    For many g and few f that costs far less than a matrix of each g.
    """
    function = jnp.asarray(function)
    bands = bands_of(len(function))
    terms = gaunt_terms(bands)
    products = jnp.asarray(terms.value, function.dtype)[:, None] * function[terms.j]
    return jnp.zeros(((2 * bands - 1) ** 2, *function.shape), function.dtype).at[terms.k, terms.i].add(products)
