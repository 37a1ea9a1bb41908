"""Lobes: how a glossy surface spreads what comes from one direction about the mirror direction.

A lobe is a function K(x) of the cosine x between a direction w and the mirror direction r of the viewer, with integral
1 over the sphere. Convolution with it multiplies band l by (Funk & Hecke)

    k_l = 2 pi integral of K(x) P_l(x) dx,      k_0 = 1.

*Phong*: K = (s + 1) / (2 pi) max(x, 0)^s. From l to l + 2 its factor is multiplied by (s - l) / (s + l + 3), from
k_0 = 1 and k_1 = (s + 1) / (s + 2) on: exact for every exponent s >= 0. s = 0 is the hemisphere, a large s a mirror.

*GGX* (Trowbridge & Reitz 1975; Walter et al. 2007) with the height-correlated masking of Smith (Heitz 2014, eq. 99):
its lobe is a function of the angle to r where the viewer looks along the normal, and K is that function. Elsewhere the
true lobe is stretched towards the horizon and not symmetric: K is exact at 0 degrees and an approximation beyond, the
one of split sums (Karis 2013). With h the half vector, t = tan² h and the density of visible normals u = t / (a² + t),

    k_l = integral of G P_l(cos 2h) du / integral of G du,      cos 2h = (1 - t) / (1 + t),   0 <= t <= 1,

a = roughness² as in glTF. Nodes at equal steps of log(a² + t) follow the peak however narrow it is. The light that
single scattering loses is given back: K is normalised.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Float

from gash_jax.algebra.arguments import RealNumber, real_number, shown
from gash_jax.algebra.sh import MAX_BANDS, legendre_functions

_NODES = 64
_MIRROR = 1e-12  # a² below which every band of GGX is reflected whole, to the last bit


class Lobe(NamedTuple):
    """A lobe by its factors k_l in the bands l = 0 .. 9, k_0 = 1; `phong` and `ggx` make them, and any numbers will do.

    >>> matte = gash_jax.Lobe(np.array([1.0, 0.5, 0.0, -0.125]))
    >>> transfer = gash_jax.bake_transfer("bunny.ply", rays=64, glossy=True)
    >>> light = gash_jax.load_light("studio.hdr")
    >>> gash_jax.shade(transfer, light, view=np.array([0.0, 0.0, 9.0]), lobe=matte).shape
    (362, 3)
    """

    factors: Float[Any, "b"]


def phong(exponent: RealNumber | Array) -> Lobe:
    """Phong's lobe (s + 1) / (2 pi) max(x, 0)^s of the exponent s >= 0; exact in every band.

    Works under jit, vmap and grad. Raises ValueError for what is no such number.

    >>> [round(float(k), 4) for k in gash_jax.phong(2.0).factors[:4]]
    [1.0, 0.75, 0.4, 0.125]
    """
    return Lobe(_phong_factors(_number(exponent, "exponent", math.inf)))


def ggx(roughness: RealNumber | Array) -> Lobe:
    """The lobe of GGX microfacets at normal view, alpha = roughness² as in glTF; roughness from 0, a mirror, to 1.

    Works under jit, vmap and grad. Raises ValueError for what is no such number.

    >>> [round(float(k), 3) for k in gash_jax.ggx(0.3).factors[:4]]
    [1.0, 0.949, 0.867, 0.778]
    """
    return Lobe(_ggx_factors(_number(roughness, "roughness", 1.0)))


@jax.jit
def _phong_factors(s: Float[Array, ""]) -> Float[Array, "b"]:
    factors = [jnp.ones_like(s), (s + 1) / (s + 2)]
    for band in range(MAX_BANDS - 2):
        factors.append(factors[band] * ((s - band) / (s + band + 3)))
    return jnp.stack(factors)


@jax.jit
def _ggx_factors(roughness: Float[Array, ""]) -> Float[Array, "b"]:
    square = jnp.maximum(roughness**4, _MIRROR)
    nodes, weights = (jnp.asarray(a / 2, jnp.float32) for a in np.polynomial.legendre.leggauss(_NODES))
    growth = jnp.log1p(1 / square)
    t = square * jnp.expm1((nodes + 0.5) * growth)
    cosine = (1 - t) / (1 + t)
    masking = 2 * cosine / (cosine + jnp.sqrt(square + (1 - square) * cosine**2))
    density = weights * jnp.exp(-(nodes + 0.5) * growth) * masking
    bands = jnp.stack(legendre_functions(cosine, jnp.ones_like(cosine), MAX_BANDS, 0))
    return jnp.sum(bands * density[None], axis=1) / jnp.sum(density)


def _number(value: object, name: str, most: float) -> Float[Array, ""]:
    """A number from 0 to `most` in float32, or one that JAX is tracing."""
    if isinstance(value, Tracer):
        return jnp.asarray(value)
    number = real_number(value)
    if number is None or not 0 <= number <= most:
        span = "of 0 or more" if most == math.inf else f"from 0 to {most:g}"
        raise ValueError(f"{name} is {shown(value)}: use a number {span}")
    return jnp.asarray(number, jnp.float32)
