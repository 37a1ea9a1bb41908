"""Normals of a pose on the device: those of `geometry.mesh.angle_weighted_normals` in one fused program.

A scatter from faces to vertices, and XLA's arctan2, took half of the time, and kept the rest from being fused. So each
vertex sums over its own corners, the first `CORNERS` of them from tables that are fixed with the faces, those of the
few vertices that have more by a scatter; and an angle is a polynomial.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra.numerics import safe_normalize
from gash_jax.geometry.carried_normals import CarriedNormals, vertex_frames

FLAT = 1e-6  # sine of the angle at which two edges of a face are one in float32
CORNERS = 6  # of a vertex within a regular mesh; with 5 or 8 the program took a seventh to a third longer
# arctan x = x (c0 + c1 x² + c2 x⁴ + ...) for 0 <= x <= 1, to 2e-8 (Abramowitz & Stegun 1964, 4.4.49)
ARCTAN = (
    *(1.0, -0.3333314528, 0.1999355085, -0.1420889944, 0.1065626393, -0.0752896400, 0.0429096138),
    *(-0.0161657367, 0.0028662257),
)


class Corners(NamedTuple):
    """Where the two other corners of the faces at a vertex are; the vertex itself where it has fewer."""

    following: Int[np.ndarray, "c v"]
    before: Int[np.ndarray, "c v"]
    more: Int[np.ndarray, "m 3"]  # of vertices with more faces: vertex, the one after, the one before


def corners_of(faces: Int[np.ndarray, "f 3"], vertices: int) -> Corners:
    """The tables of a mesh."""
    each = np.stack([np.stack([faces[:, i], faces[:, (i + 1) % 3], faces[:, (i + 2) % 3]], axis=1) for i in range(3)])
    each = each.reshape(-1, 3)
    each = each[np.argsort(each[:, 0], kind="stable")]
    place = np.arange(len(each)) - np.searchsorted(each[:, 0], each[:, 0])
    tables = np.tile(np.arange(vertices, dtype=np.int32), (2, CORNERS, 1))
    few = place < CORNERS
    tables[:, place[few], each[few, 0]] = each[few, 1:].T
    return Corners(tables[0], tables[1], each[~few])


def angle_of(sine: Float[Array, "..."], cosine: Float[Array, "..."]) -> Float[Array, "..."]:
    """The angle, 0 to pi, of a vector with sine >= 0, to 3e-7; not for (0, 0)."""
    run = jnp.abs(cosine)
    tangent = jnp.minimum(sine, run) / jnp.maximum(sine, run)
    found, square = jnp.full_like(tangent, ARCTAN[-1]), tangent * tangent
    for number in ARCTAN[-2::-1]:
        found = found * square + np.float32(number)
    found = jnp.where(sine > run, np.float32(np.pi / 2) - found * tangent, found * tangent)
    return jnp.where(cosine < 0, np.float32(np.pi) - found, found)


def _weighted(corner: list[Array], following: list[Array], before: list[Array]) -> list[Array]:
    """Unit normals of faces times their angles at a corner; of each vector x, y and z apart, as all fuse then."""
    first, second = ([a - b for a, b in zip(end, corner, strict=True)] for end in (following, before))
    (ax, ay, az), (bx, by, bz) = first, second
    cross = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
    square = _product(cross, cross)
    # of two equal edges a fused product leaves rounding, which has a direction, and (0, 0) has no gradient
    flat = square <= np.float32(FLAT**2) * _product(first, first) * _product(second, second)
    area = jnp.sqrt(jnp.where(flat, 1.0, square))
    angle = angle_of(area, jnp.where(flat, 1.0, _product(first, second)))
    return [part * jnp.where(flat, 0.0, angle / area) for part in cross]


def _product(a: list[Array], b: list[Array]) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def vertex_normals(positions: Float[Array, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[Array, "v 3"]:
    """Angle-weighted normals, differentiable; 0 without a face that has an area."""
    corners, parts = corners_of(faces, len(positions)), [positions[:, i] for i in range(3)]
    sums = [jnp.zeros_like(part) for part in parts]
    for ends in zip(corners.following, corners.before, strict=True):
        found = _weighted(parts, *([part[end] for part in parts] for end in ends))
        sums = [a + b for a, b in zip(sums, found, strict=True)]
    if len(corners.more):
        vertex = corners.more[:, 0]
        found = _weighted(*([part[end] for part in parts] for end in corners.more.T))
        sums = [a.at[vertex].add(b) for a, b in zip(sums, found, strict=True)]
    return safe_normalize(jnp.stack(sums, axis=1))


def normals_of_pose(
    positions: Float[Array, "v 3"], faces: Int[np.ndarray, "f 3"], carried: CarriedNormals
) -> Float[Array, "v 3"]:
    """Unit normals of a pose, differentiable; 0 where the pose has made a frame vanish."""
    frames = vertex_frames(positions, vertex_normals(positions, faces), carried.neighbour, safe_normalize)
    return safe_normalize(jnp.einsum("vij,vi->vj", frames, carried.local)) + carried.fixed
