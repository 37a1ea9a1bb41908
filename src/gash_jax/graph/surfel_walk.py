"""The cut of one vertex through the tree of surfels: a walk from the top, level by level.

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

Where the weights add up to a total of more than `full`, the walk is done again with importance times full / total.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.graph import walk_kernels
from gash_jax.graph.surfels import FAN, SurfelTree

OPENING, NEGLIGIBLE = np.float32(0.08), np.float32(0.01)
# leaves whose j is larger are beside the vertex (`surfel_cover`)
CLOSE = np.float32(0.03)
# no corner of a triangle is farther from its middle, along any axis, than the root of this times its variance along it
CORNERS = np.float32(8)
# of a surfel's size: how far above its middle it is looked at, and what is highest in it may stand
MIDDLE, TIPS = np.float32(0.6), np.float32(3)


class SurfelBlocks(NamedTuple):
    """A tree as the walk reads it: by families of FAN, each centre (3) and size, 0 where there is no area.

    Level i has the families from starts[i] to starts[i + 1]; member m of it has family starts[i + 1] + m as children.
    The top is filled up to whole families by `missing`. `spread`: xx, yy, zz, xy, xz, yz by row of the records.
    """

    families: Float[np.ndarray, "f 4 k"]
    spread: Float[np.ndarray, "s 6"]
    starts: Int[np.ndarray, "l"]
    missing: int


class Beside(NamedTuple):
    """Numbers of leaves beside vertices: j of each, and the product of `open` over all surfels above it."""

    vertex: Int[np.ndarray, "p"]
    leaf: Int[np.ndarray, "p"]
    weight: Float[np.ndarray, "p"]
    importance: Float[np.ndarray, "p"]


class Walked(NamedTuple):
    """What some vertices see, vertex by vertex and level by level: rows of the records; and the leaves beside them."""

    lengths: Int[np.ndarray, "n"]
    node: Int[np.ndarray, "p"]
    weight: Float[np.ndarray, "p"]
    beside: Beside


def surfel_blocks(tree: SurfelTree, records: Float[np.ndarray, "s d"]) -> SurfelBlocks:
    """The tree with the records of its surfels, made ready to be walked."""
    top, *others = tree.level_sizes
    missing = -top % FAN
    # without area nothing is important
    size = np.where(records[:-1, 6] > 0, records[:-1, 7], np.float32(0))
    columns = np.concatenate([records[:-1, :3], size[:, None]], axis=1)
    columns = np.concatenate([columns[:top], np.zeros((missing, 4), np.float32), columns[top:]])
    families = np.ascontiguousarray(columns.reshape(-1, FAN, 4).transpose(0, 2, 1))
    starts = np.cumsum([0, top + missing, *others]) // FAN
    return SurfelBlocks(families, np.ascontiguousarray(records[:, 14:20]), starts, missing)


def walk_tree(
    blocks: SurfelBlocks, own: Float[np.ndarray, "n 6"], full: float, most: int, moves: bool = False
) -> Walked:
    """What some vertices see, by their positions and normals; of more than `most` surfels the most important.

    What is wholly below the horizon is left out, though not of the total, unless the mesh `moves`.
    """
    rules = (OPENING, NEGLIGIBLE, CLOSE, CORNERS, MIDDLE, TIPS, np.float32(full))
    lengths = np.empty(len(own), np.int64)
    node, weight, *beside = walk_kernels.walk(*blocks, own, rules, most, moves, lengths)
    return Walked(lengths, node, weight, Beside(*beside))


def place_lists(
    found: Walked,
    begin: Int[np.ndarray, "n"],
    width: Int[np.ndarray, "n"],
    empty: int,
    table: Int[np.ndarray, "t"],
    weight: Float[np.ndarray, "t"],
) -> None:
    """Write lists into their places among those of all vertices, and fill them up with the row that is `empty`."""
    walk_kernels.place(found.node, found.weight, found.lengths, begin, width, np.int32(empty), table, weight)
