"""The directions of rays: point sets in the unit square, turned into directions about the normal of a vertex.

A point set (a_i, b_i), i < n, is used many times over, each time under a random shift (s, w) of the unit square onto
itself (Cranley & Patterson 1976), so that every use gives an estimate without bias:

    u_i = frac(a_i + s),    azimuth_i = 2 pi (b_i + w),    cosine to the normal z_i = height(u_i).

`height` decides the density of the directions: `COSINE` (z/pi per steradian) or `UNIFORM` (1/2pi). One vertex with one
shift is a *row* of rays. The shift w only turns the row about the normal. So it goes into the row's frame, and sine and
cosine of the azimuth are computed once for each point and once for each row, never for each ray.

Two point sets: Hammersley's (the plain bake's), and Korobov's (v(i), frac(K v(i))), v(i) the binary digits of i
mirrored at the point. The first 2^m points of the latter, for every m up to 20, are a lattice (closed under addition
modulo 1), and so is, up to a shift, every aligned block of 2^m points: it can be doubled again and again, and keeps
the rays that were traced. K was chosen by the mean error of transfer behind random half-spaces and caps up to 2^11
points, and by the spectral test beyond.
"""

from collections.abc import Callable
from functools import cache, partial
from math import pi
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra.directions import hammersley, radical_inverse_2, turn_about_normal

ONE_MINUS = float(np.nextafter(np.float32(1), np.float32(0)))
KOROBOV = 951591


class Density(NamedTuple):
    """How directions are spread over the hemisphere; z is the cosine to the normal, r = sqrt(1 - z²)."""

    height: Callable[[Array], tuple[Array, Array]]  # uniform number in [0, 1) -> (z, r)
    pdf: Callable[[Array], Array]  # z -> density per steradian


def cosine_lobe(z: Float[Array, "*s"]) -> Float[Array, "*s"]:
    """z / pi: the weight of a direction in diffuse transfer, and the density of `COSINE`."""
    return z / pi


def _cosine_height(u: Float[Array, "*s"]) -> tuple[Array, Array]:
    return jnp.sqrt(1.0 - u), jnp.sqrt(u)


def _uniform_height(u: Float[Array, "*s"]) -> tuple[Array, Array]:
    return 1.0 - u, jnp.sqrt(u * (2.0 - u))


def _uniform_pdf(z: Float[Array, "*s"]) -> Float[Array, "*s"]:
    return jnp.full_like(z, 1 / (2 * pi))


COSINE = Density(_cosine_height, cosine_lobe)
UNIFORM = Density(_uniform_height, _uniform_pdf)


def korobov(index: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 2"]:
    """Points `index` of the lattice that can be doubled (module docstring)."""
    first = radical_inverse_2(index)
    second = first * KOROBOV
    return np.stack([first, second - np.floor(second)], -1)


LATTICES = {"hammersley": hammersley, "korobov": lambda n: korobov(np.arange(n))}


@cache
def lattice(n: int, name: str = "hammersley") -> Float[np.ndarray, "n 2"]:
    """A point set in order of azimuth: neighbouring rays then walk the same part of the tree (8 % faster)."""
    points = LATTICES[name](n)
    return points[np.argsort(points[:, 1], kind="stable")].astype(np.float32)


def heights(
    shift: Float[Array, "c r"], points: Float[np.ndarray, "n 2"], density: Density
) -> tuple[Float[Array, "c r n"], Float[Array, "c r n"]]:
    """(z, r) of every ray of every row."""
    u = jnp.asarray(points[:, 0])[None, None] + shift[..., None]
    return density.height(jnp.minimum(u - jnp.floor(u), ONE_MINUS))


@partial(jax.jit, static_argnames=("n", "name", "density"))
def sample_rays(
    origins: Float[Array | np.ndarray, "c 3"],
    frames: Float[Array | np.ndarray, "c 3 3"],
    shifts: Float[Array | np.ndarray, "c r 2"],
    n: int,
    name: str = "hammersley",
    density: Density = COSINE,
) -> tuple[Float[Array, "rays 3"], Float[Array, "rays 3"]]:
    """Origins and unit directions of c vertices x r rows x n points, in that order.

    `frames` have the columns tangent, bitangent, normal; azimuth 0 is at the tangent. `name` is one of `LATTICES`.
    """
    origins, frames, shifts = jnp.asarray(origins), jnp.asarray(frames), jnp.asarray(shifts)
    points = lattice(n, name)
    turned = turn_about_normal(frames[:, None], 2 * pi * shifts[..., 1])
    z, r = heights(shifts[..., 0], points, density)
    azimuth = 2 * pi * points[None, None, :, 1].astype(np.float64)
    x, y = r * np.cos(azimuth).astype(np.float32), r * np.sin(azimuth).astype(np.float32)
    directions = jnp.stack(
        [turned[..., i, 0:1] * x + turned[..., i, 1:2] * y + turned[..., i, 2:3] * z for i in range(3)], -1
    )
    starts = jnp.broadcast_to(origins[:, None, None], directions.shape)
    return starts.reshape(-1, 3), directions.reshape(-1, 3)
