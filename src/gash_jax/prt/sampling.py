"""The two kernels on either side of the ray tracer: directions out, coefficients back in.

A *row* is one vertex under one rotation of the point set. Its rays use the Hammersley points (a_i, b_i) shifted by
(s, w) modulo 1 (Cranley & Patterson 1976), mapped to the cosine-weighted hemisphere about the normal:

    u_i = frac(a_i + s),  r_i = sqrt(u_i),  z_i = sqrt(1 - u_i),  phi_i = 2 pi (b_i + w).

Shifting b turns the row's tangent frame, so sin and cos of phi are taken once per row and once per point, never per
ray. In that frame a harmonic separates, Y_lm = f_lm(z_i) times cos(m phi_i) or sin(|m| phi_i), so the sum over rays
is a handful of (rows, n) x (n, 2) matrix products; a row's coefficients are then turned by its shift about the
normal, and all rows of a vertex into the world by one rotation. With pdf cos/pi the estimate of the transfer is the
plain mean of V Y (DESIGN: "plain bake").
"""

from functools import cache, partial
from math import factorial, pi, sqrt

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from gash_jax.algebra.directions import hammersley, orthonormal_frame
from gash_jax.algebra.sh_rotation import rotate_coefficients

ONE_MINUS = float(np.nextafter(np.float32(1), np.float32(0)))


@cache
def lattice(n: int) -> Float[np.ndarray, "n 2"]:
    """Hammersley points in order of azimuth: neighbouring rays then walk the same part of the tree (8 % faster)."""
    points = hammersley(n)
    return points[np.argsort(points[:, 1], kind="stable")].astype(np.float32)


def _row_frames(normals: Float[Array, "c 3"], azimuth: Float[Array, "c r"]) -> Float[Array, "c r 3 3"]:
    """Frames (columns tangent, bitangent, normal) turned about the normal by 2 pi times the row's azimuth shift."""
    frame = orthonormal_frame(normals)
    cos, sin = jnp.cos(2 * pi * azimuth)[..., None], jnp.sin(2 * pi * azimuth)[..., None]
    tangent, bitangent = frame[:, None, :, 0], frame[:, None, :, 1]
    normal = jnp.broadcast_to(frame[:, None, :, 2], (*azimuth.shape, 3))
    return jnp.stack([cos * tangent + sin * bitangent, cos * bitangent - sin * tangent, normal], -1)


def _elevation(shift: Float[Array, "c r"], n: int) -> tuple[Float[Array, "c r n"], Float[Array, "c r n"]]:
    """(z, r) of every ray of every row."""
    u = jnp.asarray(lattice(n)[:, 0])[None, None] + shift[..., None]
    u = jnp.minimum(u - jnp.floor(u), ONE_MINUS)
    return jnp.sqrt(1.0 - u), jnp.sqrt(u)


@partial(jax.jit, static_argnames="n")
def sample_rays(
    origins: Float[Array | np.ndarray, "c 3"],
    normals: Float[Array | np.ndarray, "c 3"],
    shifts: Float[Array | np.ndarray, "c r 2"],
    n: int,
) -> tuple[Float[Array, "rays 3"], Float[Array, "rays 3"]]:
    """Origins and unit directions of c vertices x r rotations x n points, in that order."""
    origins, normals, shifts = jnp.asarray(origins), jnp.asarray(normals), jnp.asarray(shifts)
    frames = _row_frames(normals, shifts[..., 1])
    z, r = _elevation(shifts[..., 0], n)
    azimuth = 2 * pi * lattice(n)[None, None, :, 1].astype(np.float64)
    x, y = r * np.cos(azimuth).astype(np.float32), r * np.sin(azimuth).astype(np.float32)
    directions = jnp.stack(
        [frames[..., i, 0:1] * x + frames[..., i, 1:2] * y + frames[..., i, 2:3] * z for i in range(3)], -1
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


def _local_sums(visible: Float[Array, "c r n"], shifts: Float[Array, "c r 2"], bands: int) -> Float[Array, "c r k"]:
    """Mean of V Y over each row's rays, in the frame of the normal that all rows of a vertex share."""
    n = visible.shape[-1]
    z, r = _elevation(shifts[..., 0], n)
    azimuth = 2 * pi * lattice(n)[:, 1].astype(np.float64)
    columns: list = [None] * bands**2
    for m in range(bands):
        waves = np.stack([np.cos(m * azimuth), np.sin(m * azimuth)], -1)[:, : 2 if m else 1].astype(np.float32) / n
        seen = jnp.stack([visible * profile for profile in _profiles(z, r, bands, m)])
        sums = (seen.reshape(-1, n) @ waves).reshape(*seen.shape[:-1], -1)
        if m == 0:
            for order in range(bands):
                columns[order * order + order] = sums[order, ..., 0]
            continue
        cos, sin = (wave(2 * pi * m * shifts[..., 1])[None] for wave in (jnp.cos, jnp.sin))
        even, odd = sums[..., 0] * cos - sums[..., 1] * sin, sums[..., 1] * cos + sums[..., 0] * sin
        for order in range(m, bands):
            columns[order * order + order + m], columns[order * order + order - m] = even[order - m], odd[order - m]
    return jnp.stack(columns, -1)


@partial(jax.jit, static_argnames="bands")
def integrate_rays(
    visible: Bool[Array | np.ndarray, "c r n"],
    normals: Float[Array | np.ndarray, "c 3"],
    shifts: Float[Array | np.ndarray, "c r 2"],
    bands: int,
) -> Float[Array, "c r k"]:
    """Transfer coefficients of every row, in the world frame, from the visibility of the rays of `sample_rays`."""
    visible, normals, shifts = jnp.asarray(visible), jnp.asarray(normals), jnp.asarray(shifts)
    local = _local_sums(visible.astype(jnp.float32), shifts, bands)
    return rotate_coefficients(local, orthonormal_frame(normals)[:, None])
