"""The cut of one vertex through the tree of surfels: a walk from the top, level by level, for many vertices at a time.

With s the surfel's size, d its distance from the vertex and n the normal there,

    importance i = s² / (d² + s²) * min(h, 1)      how much of the view it fills, times how high it stands
    h            = max((n . offset + 1.5 s) / sqrt(d² + s²), 0)      how high its upper end is; 0 below the horizon
    open         = clip(i / OPENING - 1, 0, 1)     how far its children stand for it; 0 of a leaf
    seen         = clip(i / NEGLIGIBLE - 1, 0, 1)

    weight       = (product of `open` over all surfels above it in the tree) * (1 - open) * seen

At the top of the tree the product is 1. A surfel enters and leaves with weight 0, and while it gives way to its
children their weights and its own add up to 1: the weights are a continuous function of position and normal. Importance
is a ratio of lengths: moving, turning or scaling the mesh changes nothing.

The 1.5 s let children be found that stand higher than their parent's middle. Much of what is found, of smooth bodies
half, still lies wholly below the horizon: with C the covariance of its surface, n . offset + sqrt(n' C n) <= 0. The
network gives it the weight 0 in all sums, so that to leave it out changes nothing (`_above_horizon`) - unless the mesh
deforms, and what lies in the tangent plane rises out of it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.graph.surfels import FAN, SurfelTree

OPENING = np.float32(0.11)
NEGLIGIBLE = np.float32(0.01)
TINY = np.float32(1e-12)
FAN_BITS = FAN.bit_length() - 1
# of squared extents: what rounding might still bring above the horizon is left in
ROUNDING = np.float32(1e-4)


class Pairs(NamedTuple):
    """Pairs of a vertex and a surfel of one level of the tree, in the order of the vertices."""

    vertex: Int[np.ndarray, "p"]
    node: Int[np.ndarray, "p"]
    weight: Float[np.ndarray, "p"]
    importance: Float[np.ndarray, "p"]

    def some(self, chosen: np.ndarray) -> "Pairs":
        """Some of them, by their numbers."""
        return Pairs(*(np.take(array, chosen) for array in self))


def families(tree: SurfelTree, records: np.ndarray) -> list[list[np.ndarray]]:
    """Of every level centre (3) and size as columns, (n, FAN) by family; the top is one family of any size.

    A take of a whole family costs hardly more than that of one surfel.
    """
    columns = [np.ascontiguousarray(records[:, i]) for i in (0, 1, 2, 7)]
    # without area nothing is important
    columns[3] = np.where(records[:, 6] > 0, columns[3], np.float32(0))
    ends = np.cumsum([0, *tree.level_sizes])
    widths = [tree.level_sizes[0], *(FAN for _ in tree.level_sizes[1:])]
    spans = [slice(start, stop) for start, stop in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)]
    return [[c[span].reshape(-1, width) for c in columns] for span, width in zip(spans, widths, strict=True)]


def walk_tree(
    levels: list[list[np.ndarray]],
    own: np.ndarray,
    spreads: list[np.ndarray] | None = None,
    scale: np.ndarray | None = None,
) -> tuple[list[Pairs], Float[np.ndarray, "n"]]:
    """Level by level what some vertices see, and the sum of its weights; `own` (6, n): their positions and normals.

    With the covariances of all surfels (`spreads`: xx, yy, zz, xy, xz, yz), what is wholly below the horizon is left
    out, though not of the sum. Where there is a `scale`, of every vertex its own, importance is multiplied by it.
    """
    count, found, start = own.shape[1], [], 0
    total = np.zeros(count)
    # indices as wide as NumPy's own, or it would convert them at every use
    vertex, family, reached = np.arange(count), np.zeros(count, np.int64), None
    for number, columns in enumerate(levels):
        width = columns[0].shape[1]
        if number == 0:
            importance, height = _importance(columns, [column[:, None] for column in own])
        else:  # loops over long rows are faster than over families
            near = [np.take(column, family, axis=0).reshape(-1) for column in columns]
            importance, height = _importance(near, [np.repeat(np.take(column, vertex), FAN) for column in own])
        importance = importance.reshape(-1)
        if scale is not None:
            importance *= np.repeat(np.take(scale, vertex), width)
        # two thirds are not worth another look
        kept = np.flatnonzero(importance > NEGLIGIBLE)
        row, place = _row_and_place(kept, width)
        who, node, important = np.take(vertex, row), np.take(family, row), np.take(importance, kept)
        node *= width
        node += place
        weight = important * (1 / NEGLIGIBLE)
        weight -= 1
        np.minimum(weight, 1, out=weight)
        opened = important[:0]  # leaves have no children
        if number + 1 < len(levels):
            opened = important * (1 / OPENING)
            opened -= 1
            np.clip(opened, 0, 1, out=opened)
            weight *= 1 - opened
        if reached is not None:
            above = np.take(reached, row)
            weight *= above
            opened *= above[: len(opened)]
        total += np.bincount(who, weight, count)
        parents = np.flatnonzero(opened > 0)
        # surfel i of a level has family i of the next as its children
        vertex, family, reached = np.take(who, parents), np.take(node, parents), np.take(opened, parents)
        node += start
        start += columns[0].size
        seen = weight > 0
        if spreads is not None:
            seen &= _above_horizon(who, node, np.take(height.reshape(-1), kept), own, spreads)
        found.append(Pairs(who, node, weight, important).some(np.flatnonzero(seen)))
    return found, total


def _row_and_place(index: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Quotient and rest; of families by bits, as NumPy's division takes longer than all the rest."""
    return (index >> FAN_BITS, index & (FAN - 1)) if width == FAN else np.divmod(index, width)


def _importance(surfel: list[np.ndarray], own: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """The formula above, below 1; and n . offset."""
    x, y, z = (a - b for a, b in zip(surfel[:3], own[:3], strict=True))
    s = surfel[3]
    height = own[3] * x
    height += own[4] * y
    height += own[5] * z
    up = np.float32(1.5) * s + height
    np.maximum(up, 0, out=up)
    x *= x
    y *= y
    z *= z
    x += y
    x += z
    square = s * s
    x += square
    x += TINY
    up /= np.sqrt(x, out=y)
    np.minimum(up, 1, out=up)
    up *= square
    up /= x
    return up, height


def _above_horizon(
    vertex: np.ndarray, node: np.ndarray, height: np.ndarray, own: np.ndarray, spreads: list[np.ndarray]
) -> np.ndarray:
    """Whether surfels reach above the horizon of vertices above which their middles stand so high."""
    seen = height > 0
    low = np.flatnonzero(~seen)
    vertex, node, depth = np.take(vertex, low), np.take(node, low), np.take(height, low)
    x, y, z = (np.take(own[i], vertex) for i in (3, 4, 5))
    xx, yy, zz, xy, xz, yz = (np.take(spread, node) for spread in spreads)
    # n' C n, as n . (C n)
    extent = x * (xx * x + 2 * (xy * y + xz * z)) + y * (yy * y + 2 * yz * z) + zz * z * z
    depth *= depth
    seen[low] = depth <= extent * (1 + ROUNDING)
    return seen
