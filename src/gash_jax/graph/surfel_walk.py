"""The cut of one vertex through the tree of surfels: a walk from the top, level by level, for many vertices at a time.

With s the surfel's size, d its distance from the vertex and n the normal there,

    r       = sqrt(d² + s²)
    g       = s² / r²                                     how much of the view it fills
    i       = g clip((n . offset + MIDDLE s) / r, 0, 1)   its importance: and how high it stands; 0 below the horizon
    j       = g clip((n . offset + TIPS s) / r, 0, 1)     the same of the highest that may be in it

    open    = clip(j / OPENING - 1, 0, 1)                 how far its children stand for it; 0 of a leaf
    seen    = clip(i / NEGLIGIBLE - 1, 0, 1)

    weight  = (product of `open` over all surfels above it in the tree) * (1 - open) * seen

At the top of the tree the product is 1. A surfel enters and leaves with weight 0, and while it gives way to its
children their weights and its own add up to 1: the weights are a continuous function of position and normal. Importance
is a ratio of lengths: moving, turning or scaling the mesh changes nothing.

A surfel is opened for what may stand highest in it: at the tip of a nose or between two toes most of the surface around
lies behind the vertex, and the middle of a surfel tells nothing of the small part of it that stands above. Much of what
is found still lies wholly below the horizon: with C the covariance of its surface, n . offset + sqrt(n' C n) <= 0. The
network gives it the weight 0 in all sums, so that to leave it out changes nothing - unless the mesh deforms, and what
lies in the tangent plane rises out of it: there it stays, and its `seen` is made of j.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.graph.surfels import FAN, SurfelTree

OPENING = np.float32(0.1)
NEGLIGIBLE = np.float32(0.01)
# leaves whose j is larger are beside the vertex (`surfel_cover`)
CLOSE = np.float32(0.03)
# no corner of a triangle is farther from its middle, along any axis, than the root of this times its variance along it
CORNERS = 8.0
# of a surfel's size: how far above its middle it is looked at, and what is highest in it may stand
MIDDLE, TIPS = np.float32(0.6), np.float32(2.25)
TINY = np.float32(1e-12)
FAN_BITS = FAN.bit_length() - 1
# of squared extents: what rounding might still bring above the horizon is left in
ROUNDING = 1e-4


class Pairs(NamedTuple):
    """Pairs of a vertex and a surfel of one level of the tree, in the order of the vertices."""

    vertex: Int[np.ndarray, "p"]
    node: Int[np.ndarray, "p"]
    weight: Float[np.ndarray, "p"]
    importance: Float[np.ndarray, "p"]

    def some(self, chosen: np.ndarray) -> "Pairs":
        """Some of them, by their numbers."""
        return Pairs(*(np.take(array, chosen) for array in self))


NO_PAIRS = Pairs(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0, np.float32), np.zeros(0, np.float32))


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
    spreads: list[np.ndarray],
    moves: bool = False,
    scale: np.ndarray | None = None,
) -> tuple[list[Pairs], Pairs, Float[np.ndarray, "n"]]:
    """Level by level what some vertices see, the leaves beside them, and the sum of the weights of what they see.

    `own` (6, n): positions and normals. Of leaves beside a vertex the weight is the product of `open` above them alone,
    and the importance is j. `spreads`: the covariances of all surfels, xx, yy, zz, xy, xz, yz. What is wholly below the
    horizon is left out, though not of the sum, unless the mesh `moves`. Where there is a `scale`, of every vertex its
    own, importance is multiplied by it.
    """
    count, found, start, close = own.shape[1], [], 0, NO_PAIRS
    total = np.zeros(count)
    fourfold = np.repeat(own, FAN, axis=1).reshape(6, count, FAN)
    # indices as wide as NumPy's own, or it would convert them at every use
    vertex, family, reached = np.arange(count), np.zeros(count, np.int64), None
    for number, columns in enumerate(levels):
        width, is_last = columns[0].shape[1], number + 1 == len(levels)
        if number == 0:
            looked = _importance(columns, [column[:, None] for column in own])
        else:  # loops over long rows are faster than over families
            near = [np.take(column, family, axis=0).reshape(-1) for column in columns]
            looked = _importance(near, [np.take(column, vertex, axis=0).reshape(-1) for column in fourfold])
        importance, highest, height = (array.reshape(-1) for array in looked)
        if scale is not None:
            times = np.repeat(np.take(scale, vertex), width)
            importance *= times
            highest *= times
        level = _Level(vertex, family, width, height, own, [spread[start:] for spread in spreads])
        # passes over all are cheap and picking is not: nothing is picked before all is known of it
        opened = _ramp(highest, OPENING)
        share = np.ones(len(highest), np.float32) if reached is None else np.repeat(reached, width)
        left = share if is_last else share * (1 - opened)  # leaves have no children
        pairs, above = level.picked(_ramp(importance, NEGLIGIBLE) * left, importance)
        total += np.bincount(pairs.vertex, pairs.weight, count)
        seen = [pairs.some(np.flatnonzero(above))]
        if moves:
            pairs, above = level.picked(_ramp(highest, NEGLIGIBLE) * left, highest)
            seen.append(pairs.some(np.flatnonzero(~above)))
        found += [pairs._replace(node=pairs.node + start) for pairs in seen]
        if is_last:
            pairs, above = level.picked(np.where(highest > CLOSE, share, np.float32(0)), highest, CORNERS)
            close = pairs if moves else pairs.some(np.flatnonzero(above))
            break
        start += columns[0].size
        parents = np.flatnonzero(opened > 0)
        reached = np.take(opened, parents) * np.take(share, parents)
        # surfel i of a level has family i of the next as its children
        vertex, family = level.numbers(parents)
    return found, close, total


def _ramp(importance: np.ndarray, start: np.float32) -> np.ndarray:
    """0 up to `start`, 1 from twice that on."""
    found = importance * (1 / start)
    found -= 1
    return np.clip(found, 0, 1, out=found)


class _Level(NamedTuple):
    """Families of one level, each of its vertex, with what is known of their members in one array."""

    vertex: np.ndarray
    family: np.ndarray
    width: int
    height: np.ndarray  # n . offset
    own: np.ndarray
    spreads: list[np.ndarray]  # of the level's surfels

    def numbers(self, index: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of some members the vertex, and the surfel's number in the level."""
        # by bits, as NumPy's division takes longer than all the rest
        row, place = (index >> FAN_BITS, index & (FAN - 1)) if self.width == FAN else np.divmod(index, self.width)
        node = np.take(self.family, row)
        node *= self.width
        node += place
        return np.take(self.vertex, row), node

    def picked(self, weight: np.ndarray, importance: np.ndarray, reach: float = 1.0) -> tuple[Pairs, np.ndarray]:
        """What has weight; and what of it reaches above the horizon, by `reach` times the mean square extent."""
        kept = np.flatnonzero(weight > 0)
        pairs = Pairs(*self.numbers(kept), np.take(weight, kept), np.take(importance, kept))
        height = np.take(self.height, kept)
        above = height > 0
        low = np.flatnonzero(~above)
        vertex, node, depth = np.take(pairs.vertex, low), np.take(pairs.node, low), np.take(height, low)
        x, y, z = (np.take(self.own[i], vertex) for i in (3, 4, 5))
        xx, yy, zz, xy, xz, yz = (np.take(spread, node) for spread in self.spreads)
        # n' C n, as n . (C n)
        extent = x * (xx * x + 2 * (xy * y + xz * z)) + y * (yy * y + 2 * yz * z) + zz * z * z
        depth *= depth
        above[low] = depth <= extent * np.float32(reach * (1 + ROUNDING))
        return pairs, above


def _importance(surfel: list[np.ndarray], own: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """i and j of the formula above, below 1; and n . offset."""
    x, y, z = (a - b for a, b in zip(surfel[:3], own[:3], strict=True))
    s = surfel[3]
    height = own[3] * x
    height += own[4] * y
    height += own[5] * z
    x *= x
    y *= y
    z *= z
    x += y
    x += z
    square = s * s
    x += square
    x += TINY
    filled = square / x
    far = np.sqrt(x, out=x)
    looked = []
    for rise in (MIDDLE, TIPS):
        up = rise * s + height
        up /= far
        np.clip(up, 0, 1, out=up)
        up *= filled
        looked.append(up)
    return looked[0], looked[1], height
