"""The kernels on either side of the ray tracer: directions out, coefficients back in.

A *row* is one vertex under one shift of a point set. Its rays use the points (a_i, b_i) of a lattice, shifted by
(s, w) modulo 1 (Cranley & Patterson 1976) and mapped to the cosine-weighted hemisphere about the normal:

    u_i = frac(a_i + s),  r_i = sqrt(u_i),  z_i = sqrt(1 - u_i),  phi_i = 2 pi (b_i + w).

Shifting b turns the row's tangent frame, so sin and cos of phi are taken once per row and once per point, never per
ray. In that frame a harmonic separates, Y_lm = f_lm(z_i) times cos(m phi_i) or sin(|m| phi_i), so the sum over rays
is a handful of (rows, n) x (n, 2) matrix products; a row's coefficients are then turned by its shift about the
normal, and all rows of a vertex into the world by one rotation. The estimate of a row is

    p c + mean of (V - p) Y,      c = A_l Y(normal) / pi the closed form without shadows,

which is right on average for every p that does not look at these rays: p = 0 is the plain bake, mean of V Y; p = 1
the occlusion form, c - mean of (1 - V) Y. With p the visible share of the rays the two are blended as their
variances ask: a vertex that sees everything keeps the formula exactly, one that sees nothing gets exactly zero.

Two lattices: Hammersley's points (DESIGN: "plain bake"), and Korobov's (v(i), frac(K v(i))), v the radical inverse
in base 2, whose first 2^m points are a rank-1 lattice for every m up to 20 and whose every aligned block of 2^m
points is that lattice shifted: it can be extended without wasting what was traced. K was chosen by the mean error of
blended coefficients of random half-spaces and caps up to 2^11 points, and by the spectral test beyond.
"""

from functools import cache, partial
from math import factorial, pi, sqrt

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.directions import hammersley, radical_inverse_2
from gash_jax.algebra.sh_rotation import rotate_coefficients

ONE_MINUS = float(np.nextafter(np.float32(1), np.float32(0)))
KOROBOV = 951591


def korobov(index: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 2"]:
    """Points `index` of the extensible rank-1 lattice (module docstring)."""
    first = radical_inverse_2(index)
    second = first * KOROBOV
    return np.stack([first, second - np.floor(second)], -1)


LATTICES = {"hammersley": hammersley, "korobov": lambda n: korobov(np.arange(n))}


@cache
def lattice(n: int, name: str = "hammersley") -> Float[np.ndarray, "n 2"]:
    """A lattice's points in order of azimuth: neighbouring rays then walk the same part of the tree (8 % faster)."""
    points = LATTICES[name](n)
    return points[np.argsort(points[:, 1], kind="stable")].astype(np.float32)


def _row_frames(frames: Float[Array, "c 3 3"], azimuth: Float[Array, "c r"]) -> Float[Array, "c r 3 3"]:
    """Frames (columns tangent, bitangent, normal) turned about the normal by 2 pi times the row's azimuth shift."""
    cos, sin = jnp.cos(2 * pi * azimuth)[..., None], jnp.sin(2 * pi * azimuth)[..., None]
    tangent, bitangent = frames[:, None, :, 0], frames[:, None, :, 1]
    normal = jnp.broadcast_to(frames[:, None, :, 2], (*azimuth.shape, 3))
    return jnp.stack([cos * tangent + sin * bitangent, cos * bitangent - sin * tangent, normal], -1)


def _elevation(shift: Float[Array, "c r"], points: Float[np.ndarray, "n 2"]) -> tuple[Array, Array]:
    """(z, r) of every ray of every row, each (c, r, n)."""
    u = jnp.asarray(points[:, 0])[None, None] + shift[..., None]
    u = jnp.minimum(u - jnp.floor(u), ONE_MINUS)
    return jnp.sqrt(1.0 - u), jnp.sqrt(u)


@partial(jax.jit, static_argnames=("n", "name"))
def sample_rays(
    origins: Float[Array | np.ndarray, "c 3"],
    frames: Float[Array | np.ndarray, "c 3 3"],
    shifts: Float[Array | np.ndarray, "c r 2"],
    n: int,
    name: str = "hammersley",
) -> tuple[Float[Array, "rays 3"], Float[Array, "rays 3"]]:
    """Origins and unit directions of c vertices x r rows x n points, in that order.

    `frames` have the columns tangent, bitangent, normal; the tangent is where azimuth 0 of the lattice points.
    """
    origins, frames, shifts = jnp.asarray(origins), jnp.asarray(frames), jnp.asarray(shifts)
    points = lattice(n, name)
    turned = _row_frames(frames, shifts[..., 1])
    z, r = _elevation(shifts[..., 0], points)
    azimuth = 2 * pi * points[None, None, :, 1].astype(np.float64)
    x, y = r * np.cos(azimuth).astype(np.float32), r * np.sin(azimuth).astype(np.float32)
    directions = jnp.stack(
        [turned[..., i, 0:1] * x + turned[..., i, 1:2] * y + turned[..., i, 2:3] * z for i in range(3)], -1
    )
    starts = jnp.broadcast_to(origins[:, None, None], directions.shape)
    return starts.reshape(-1, 3), directions.reshape(-1, 3)


def _profiles(z: Float[Array, "*s"], r: Float[Array, "*s"], bands: int, m: int) -> list[Float[Array, "*s"]]:
    """f_lm(z) = K_lm P_lm for l = m .. bands-1, without the Condon–Shortley sign (r = sqrt(1 - z²))."""
    previous, current = jnp.zeros_like(z), float(np.prod(np.arange(1, 2 * m, 2))) * r**m
    profiles = []
    for order in range(m, bands):
        norm = sqrt((2 * order + 1) / (4 * pi) * factorial(order - m) / factorial(order + m)) * (sqrt(2) if m else 1)
        profiles.append(norm * current)
        following = ((2 * order + 1) * z * current - (order + m) * previous) / (order - m + 1)
        previous, current = current, following
    return profiles


@partial(jax.jit, static_argnames=("bands", "name"))
def integrate_rays(
    visible: Bool[Array | np.ndarray, "c r n"],
    share: Float[Array | np.ndarray, "c"],
    shifts: Float[Array | np.ndarray, "c r 2"],
    bands: int,
    name: str = "hammersley",
) -> Float[Array, "c r k"]:
    """Transfer of every row in the frame of its vertex, from the visibility of the rays of `sample_rays`.

    `share` is p of the module docstring, one for all rows of a vertex. `to_world` turns the result.
    """
    visible, share, shifts = jnp.asarray(visible), jnp.asarray(share), jnp.asarray(shifts)
    points = lattice(visible.shape[-1], name)
    z, r = _elevation(shifts[..., 0], points)
    azimuth = 2 * pi * points[:, 1].astype(np.float64)
    weight = visible.astype(jnp.float32) - share[:, None, None]
    closed = clamped_cosine_coefficients(bands) / pi
    columns: list = [None] * bands**2
    for m in range(bands):
        waves = np.stack([np.cos(m * azimuth), np.sin(m * azimuth)], -1)[:, : 2 if m else 1].astype(np.float32)
        seen = jnp.stack([weight * profile for profile in _profiles(z, r, bands, m)])
        sums = (seen.reshape(-1, len(points)) @ (waves / len(points))).reshape(*seen.shape[:-1], -1)
        if m == 0:
            for order in range(bands):
                zonal = float(closed[order * order] * sqrt((2 * order + 1) / (4 * pi)))
                columns[order * order + order] = sums[order, ..., 0] + share[:, None] * zonal
            continue
        cos, sin = (wave(2 * pi * m * shifts[..., 1])[None] for wave in (jnp.cos, jnp.sin))
        even, odd = sums[..., 0] * cos - sums[..., 1] * sin, sums[..., 1] * cos + sums[..., 0] * sin
        for order in range(m, bands):
            columns[order * order + order + m], columns[order * order + order - m] = even[order - m], odd[order - m]
    return jnp.stack(columns, -1)


@jax.jit
def to_world(
    local: Float[Array | np.ndarray, "c r k"], frames: Float[Array | np.ndarray, "c 3 3"]
) -> Float[Array, "c r k"]:
    """Coefficients in the frames of their vertices -> world."""
    return rotate_coefficients(jnp.asarray(local), jnp.asarray(frames)[:, None])
