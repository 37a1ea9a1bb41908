"""What the surfel network knows of a pair of vertex and surfel: geometry alone, nothing learnt (`nn.surfel_net`)."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.numerics import safe_normalize
from gash_jax.nn.pooling import total_of

EVEN = 0.1
# sums of so little are rounding: whatever is in them, the corner decides
FAINT = 1e-6
# radians: of a symmetric surface the direction is often just opposite to a corner, and their sum could vanish
ASIDE = 0.3
# squared lengths are at least this (radius of the surface = 1): what coincides has no direction
FLOOR = 1e-12
TINY = 1e-20
# of lengths: what is no higher than this above a tangent plane is in it
ROUNDING = 1e-6
# its inverse square, in gradients, is a float32
SMALLEST_AREA = 1e-18
# a surfel whose middle is the vertex reaches infinitely far for its distance
FARTHEST = 4.0
# a surfel seen edge-on still covers this part of its area: below, float32 does not tell how much it covers
EDGE_ON = 0.03

# pairs of vertex v and surfel n: surfels are what is contiguous, so that loops are over whole vectors
Pair = Float[Array, "v n"]
# corners of a vertex's own faces, vertices contiguous
Corner = Float[Array, "m v"]
Vector = list[Array]
# parts of a graph; what the network reads of one, by name (module docstring)
Part = Mapping[str, Array | np.ndarray]
Parts = Sequence[Part]


class Look(NamedTuple):
    """Of v vertices of a part: features of their pairs with n surfels and m near corners, and what pairs weigh."""

    features: list[Pair]
    near: list[Corner]
    above: Pair  # q w c of the module docstring of `surfel_net`
    partly: Pair  # q w clip(n . u + r, 0, 1)
    frames: Float[Array, "v 3 3"]
    rise: Float[Array, "v"]  # how far the near corners stand above the tangent plane
    edge: Float[Array, "v"]  # mean distance of the near corners
    cover: list[Float[Array, "v"]]  # what the faces right beside the vertex cover, along the axes of its frame


def _dot(a: Vector, b: Vector) -> Array:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _quadratic(form: Vector, u: Vector) -> Array:
    """u' S u of S = (xx, yy, zz, xy, xz, yz)."""
    x, y, z = u
    return (
        form[0] * x * x + form[1] * y * y + form[2] * z * z + 2 * (form[3] * x * y + form[4] * x * z + form[5] * y * z)
    )


def look(part: Part) -> Look:
    """Everything that is known of the pairs of a part."""
    # one array a component
    surfel = jnp.asarray(part["surfel"]).transpose(2, 0, 1)
    position, normal = (list(jnp.asarray(part[name]).T[..., None]) for name in ("position", "normal"))
    share = jnp.asarray(part["weight"])
    offset = [surfel[i] - position[i] for i in range(3)]
    square = _dot(offset, offset) + FLOOR
    distance = jnp.sqrt(square)
    inverse = 1 / distance
    u = [o * inverse for o in offset]
    vector, area, size = list(surfel[3:6]), surfel[6], surfel[7]
    floor = jnp.square(area * np.float32(EDGE_ON / (4 * np.pi))) + SMALLEST_AREA**2
    projected = 4 * np.float32(np.pi) * jnp.sqrt(jnp.maximum(_quadratic(list(surfel[8:14]), u), 0) + floor)
    covered = jnp.minimum(projected, area)
    angle = covered / (covered + square)
    height = _dot(u, normal)
    counted = share * angle
    above = counted * jnp.maximum(height - ROUNDING * inverse, 0)
    reach = jnp.sqrt(jnp.maximum(_quadratic(list(surfel[14:20]), normal), 0) + TINY) * inverse
    reach = jnp.minimum(reach, FARTHEST)
    partly = counted * jnp.clip(height + reach, 0, 1)
    corners = jnp.asarray(part["near"]).reshape(len(share), part["near"].shape[1] // 6, 6).transpose(2, 1, 0)
    away = jnp.sqrt(_dot(list(corners[:3]), list(corners[:3])) + FLOOR)
    v = [c / away for c in corners[:3]]
    frame = _frames([n[:, 0] for n in normal], u, above + 1e-3 * partly, [c[0] for c in v])
    axes = [[component[:, None] for component in axis] for axis in frame]
    x, y = _dot(u, axes[0]), _dot(u, axes[1])
    flux = jnp.clip(-_dot(u, vector) / jnp.maximum(covered, SMALLEST_AREA), -2, 2)
    unit = 1 / jnp.maximum(area, SMALLEST_AREA)
    facing = [_dot(vector, axis) * unit for axis in axes]
    features = [x, y, height, x * y, y * height, 1.5 * height * height - 0.5, x * height, 0.5 * (x * x - y * y)]
    features += [jnp.sqrt(jnp.maximum(angle, TINY)), flux, reach, size / (size + distance)]
    features += [facing[2], facing[0], facing[1], fourth_root(distance)]
    near = _near_features(list(corners[3:]), v, away, [[c[None] for c in axis] for axis in frame])
    rise = jnp.maximum(_dot(v, [n[None, :, 0] for n in normal]) - ROUNDING / away, 0)
    frames = jnp.stack([jnp.stack(axis, axis=-1) for axis in frame], axis=-1)
    covered = list(jnp.asarray(part["cover"]).T)
    cover = [_dot(covered, axis) for axis in frame]
    return Look(features, near, above, partly, frames, jnp.mean(rise, axis=0), jnp.mean(away, axis=0), cover)


def fourth_root(distance: Array) -> Array:
    """The fourth root: as good as a logarithm over the distances of a mesh, and finite at 0."""
    return jnp.sqrt(jnp.sqrt(jnp.maximum(distance, TINY)))


def _frames(normal: Vector, u: Vector, weight: Pair, corner: Vector) -> list[list[Float[Array, "v"]]]:
    """Axes of frames whose first looks where most is hidden, components of each."""
    first = _tangential([total_of(weight * a) for a in u], normal)
    enough = EVEN * total_of(weight) + FAINT
    missing = jnp.maximum(enough - jnp.sqrt(_dot(first, first) + TINY), 0)
    other = safe_normalize(jnp.stack(_tangential(corner, normal), axis=-1)).T
    across = [normal[i - 2] * other[i - 1] - normal[i - 1] * other[i - 2] for i in range(3)]
    other = [np.float32(np.cos(ASIDE)) * o + np.float32(np.sin(ASIDE)) * a for o, a in zip(other, across, strict=True)]
    first = [f + missing * o for f, o in zip(first, other, strict=True)]
    known = _dot(first, first) > 1e-16
    any_frame = orthonormal_frame(jnp.stack(normal, axis=-1))[..., 0].T
    first = list(
        safe_normalize(jnp.stack([jnp.where(known, f, o) for f, o in zip(first, any_frame, strict=True)], -1)).T
    )
    second = [normal[i - 2] * first[i - 1] - normal[i - 1] * first[i - 2] for i in range(3)]
    return [first, second, normal]


def _tangential(x: Vector, normal: Vector) -> Vector:
    upward = _dot(x, normal)
    return [a - upward * n for a, n in zip(x, normal, strict=True)]


def _near_features(normal: Vector, v: Vector, away: Corner, axes: list[Vector]) -> list[Corner]:
    """What is said of the corners of a vertex's own faces: direction, normal, distance in units of their mean."""
    x, y, z = (_dot(v, axis) for axis in axes)
    turned = [_dot(normal, axis) for axis in axes]
    relative = away / (jnp.sum(away, axis=0) / len(away) + 1e-9)[None]
    features = [x, y, z, x * y, y * z, x * z, 0.5 * (x * x - y * y), z * z, *turned, _dot(normal, v), relative]
    return [*features, fourth_root(away)]
