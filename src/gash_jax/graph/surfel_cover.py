"""How much of a vertex's view the faces right beside it cover, exactly: what their moments do not tell.

A surfel is a centre and moments, which is enough from afar. Where a face is closer to a vertex than it is wide, it
matters which side of it the vertex lies on and whether it reaches over it: a sheet a hair above a vertex hides all, and
a panel that hangs down beside it half, however far their middles are. Such faces are few on most meshes, and of each
the view that it covers has a closed form. With r_k the corners, seen from the vertex, of what of a triangle stands
above the horizon, and t_k the angle between r_k and r_(k+1),

    f = sum_k t_k (r_k x r_(k+1)) / |r_k x r_(k+1)| / 2

is the integral of directions over it (Lambert 1760; Arvo 1995, vector irradiance): f . n, over pi, is the share of the
light of an even sky that the triangle keeps from a vertex with normal n. In

    cover = sum_j q_j max(f_j . n / |f_j|, 0) f_j / pi

each face is a vector of that length, turned so that it points to the triangle. With j the importance of `surfel_walk`
and p the product of `open` over all surfels above the face, q = min(SOON p, 1) clip(j / CLOSE - 1, 0, 1) is 0 from afar
and continuous. A face counts by what stands highest in it, whether or not its middle is seen: where it crosses the
horizon, that is what covers. The faces of which a vertex is itself a corner are seen edge-on and cover nothing.
"""

from collections.abc import Sequence
from types import ModuleType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from gash_jax.files.cores import available_cores, in_threads
from gash_jax.graph.cover_kernels import add_cover, keep_others
from gash_jax.graph.surfel_pieces import PIECES
from gash_jax.graph.surfel_walk import CLOSE, Beside
from gash_jax.graph.surfels import SurfelTree

# a face that begins to stand for its parent in a list soon counts in full here: nothing else says what it covers
SOON = np.float32(4)
# relative to the radius of the surface: a face no farther than this from the vertex's own place is not above it
TOUCHING = np.float32(1e-5)
# and one none of whose corners is higher than this above the horizon lies in it: what is left is rounding
FLAT = np.float32(1e-6)
TINY = np.float32(1e-20)
# pairs that are worth a thread
SPAN = 4096


class ClosePairs(NamedTuple):
    """Pairs of a vertex and a leaf of the tree right beside it, and q of the module docstring."""

    vertex: Int[np.ndarray, "p"]
    leaf: Int[np.ndarray, "p"]
    weight: Float[np.ndarray, "p"]


NO_PAIRS = ClosePairs(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.float32))


def close_pairs(start: int, pairs: Beside) -> ClosePairs:
    """The leaves beside some vertices (`walk_tree`), which are counted from `start`."""
    share = np.minimum(pairs.importance * (1 / CLOSE) - 1, 1)
    share *= np.minimum(SOON * pairs.weight, 1)
    return ClosePairs(pairs.vertex + start, pairs.leaf, share)


def joined_pairs(parts: Sequence[ClosePairs]) -> ClosePairs:
    """All pairs of some parts."""
    return ClosePairs(*(np.concatenate(arrays) for arrays in zip(NO_PAIRS, *parts, strict=True)))


def without_own(
    pairs: ClosePairs, vertices: Int[np.ndarray, "n"], tree: SurfelTree, faces: Int[np.ndarray, "f 3"]
) -> ClosePairs:
    """Those whose leaf is no part of a face of the vertex; their vertex i is number `vertices[i]` of the mesh."""
    vertex, leaf, weight = (array.copy() for array in pairs)
    count = keep_others(vertex, leaf, weight, vertices, tree.face, faces)
    return ClosePairs(vertex[:count], leaf[:count], weight[:count])


def surfel_cover(
    pairs: ClosePairs,
    tree: SurfelTree,
    faces: Int[np.ndarray, "f 3"],
    positions: Float[Any, "v 3"],
    normals: Float[Any, "v 3"],
    xp: ModuleType = np,
) -> Float[Any, "v 3"]:
    """The cover of every vertex; NumPy, or with `xp` = jax.numpy under jit."""
    if xp is np:
        found = np.zeros((len(positions), 3), np.float32)
        # pairs are in the order of their vertices, and no two threads have the same one
        spans = min(available_cores(), 1 + len(pairs.vertex) // SPAN)
        starts = np.searchsorted(pairs.vertex, np.linspace(0, len(positions), spans + 1).astype(np.int64)).tolist()

        def add(span: tuple[int, int]) -> None:
            vertex, leaf, weight = (array[slice(*span)] for array in pairs)
            of_leaves = tree.face, tree.piece, PIECES, faces
            add_cover(vertex, leaf, weight, *of_leaves, positions, normals, FLAT, TOUCHING, found)

        in_threads(add, zip(starts[:-1], starts[1:], strict=True))
        return found
    points, place = [positions[:, i] for i in range(3)], pairs.vertex
    corner = np.take(faces, tree.face[pairs.leaf], axis=0)
    weights = PIECES[tree.piece[pairs.leaf]]
    own = [jnp.take(column, place) for column in points]
    up = [jnp.take(normals[:, i], place) for i in range(3)]
    far = [[jnp.take(column, corner[:, b]) - mine for column, mine in zip(points, own, strict=True)] for b in range(3)]
    r = [[sum(weights[:, a, b] * far[b][i] for b in range(3)) for i in range(3)] for a in range(3)]
    found = [pairs.weight * component for component in _covered(r, up)]
    return jnp.stack([jnp.zeros(len(positions), np.float32).at[place].add(f) for f in found], axis=-1)


def _covered(r: list[list[Any]], up: list[Any]) -> list[Any]:
    """(f . n / |f|) f / pi of what of triangles with these corners stands above the horizon."""
    height = [_dot(corner, up) for corner in r]
    total: list[Any] = [0, 0, 0]
    # where the outline goes below the horizon, and where it comes back
    gone, back = ([jnp.zeros_like(height[0])] * 3 for _ in range(2))
    for k in range(3):
        (a, above), (b, then) = ((r[i], height[i]) for i in (k, k - 2))
        crosses = (above >= 0) != (then >= 0)
        share = jnp.where(crosses, above / jnp.where(crosses, above - then, 1), 0)
        horizon = [x + share * (y - x) for x, y in zip(a, b, strict=True)]
        gone = [jnp.where(crosses & (above >= 0), h, g) for h, g in zip(horizon, gone, strict=True)]
        back = [jnp.where(crosses & (then >= 0), h, g) for h, g in zip(horizon, back, strict=True)]
        first, second = (
            [jnp.where(up >= 0, c, h) for c, h in zip(corner, horizon, strict=True)]
            for corner, up in ((a, above), (b, then))
        )
        total = _with_edge(total, first, second)
    total = _with_edge(total, gone, back)
    # twice the area vector; how far the plane is from the vertex, along it
    e, g = ([b - a for a, b in zip(r[0], r[k], strict=True)] for k in (1, 2))
    face = _cross(e, g)
    away = _dot(face, r[0]) / _length(face)
    # towards the triangle; nothing where the vertex lies in it
    towards = away / jnp.sqrt(away * away + TOUCHING * TOUCHING)
    scale = jnp.maximum(_dot(total, up) / _length(total) * towards, 0) * towards
    scale = jnp.where(jnp.maximum(jnp.maximum(height[0], height[1]), height[2]) > FLAT, scale, 0)
    return [scale * t for t in total]


def _with_edge(total: list[Any], a: list[Any], b: list[Any]) -> list[Any]:
    """And t a x b / |a x b| / 2 pi of an edge from a to b; 0 of one that is a point."""
    cross = _cross(a, b)
    sine = _length(cross)
    angle = jnp.arctan2(sine, _dot(a, b)) / (2 * np.float32(np.pi) * sine)
    return [t + angle * c for t, c in zip(total, cross, strict=True)]


def _cross(a: list[Any], b: list[Any]) -> list[Any]:
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def _dot(a: list[Any], b: list[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _length(a: list[Any]) -> Any:
    return jnp.sqrt(_dot(a, a) + TINY)
