"""Which surfels a vertex is shown, and with what weight: large or far ones as a whole, near ones in their parts.

Every vertex has a list of its own, and so what is predicted for it does not depend on which other vertices there are. A
list is a cut through the tree with soft edges. With s the surfel's size, d its distance from the vertex and n the
normal there,

    importance i = s² / (d² + s²) * min(h, 1)      how much of the view it fills, times how high it stands
    h            = max((n . offset + 1.5 s) / sqrt(d² + s²), 0)      how high its upper end is; 0 below the horizon
    open         = clip(i / OPENING - 1, 0, 1)     how far its children stand for it; 0 of a leaf
    seen         = clip(i / NEGLIGIBLE - 1, 0, 1)

    weight       = (product of `open` over all surfels above it in the tree) * (1 - open) * seen

At the top of the tree the product is 1. A surfel enters and leaves with weight 0, and while it gives way to its
children their weights and its own add up to 1: the weights are a continuous function of position and normal. Importance
is a ratio of lengths: moving, turning or scaling the mesh changes nothing.

Deep in narrow gaps lists would be long. Where the weights add up to a total of more than FULL, the list is made anew
with importance times FULL / total: it is coarser, and as the total is continuous, so are its weights.

Lists are padded to one of WIDTHS with surfels of weight 0, and vertices with lists of one width lie together. A list of
more than the last of them keeps its most important.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.files.cores import available_cores
from gash_jax.graph.surfels import FAN, SurfelTree

OPENING = np.float32(0.11)
NEGLIGIBLE = np.float32(0.01)
FULL = 128.0
WIDTHS = (48, 80, 128, 256)
TINY = np.float32(1e-12)
FAN_BITS = FAN.bit_length() - 1
# vertices at a time: fewer, and threads wait for the interpreter between short loops; more, and pairs leave the cache
CHUNK = 4096

Pairs = tuple[np.ndarray, ...]


class SurfelList(NamedTuple):
    """Vertices with lists of one width: rows of the records, and their weights."""

    vertices: Int[np.ndarray, "n"]
    table: Int[np.ndarray, "n w"]
    weight: Float[np.ndarray, "n w"]


def list_surfels(
    tree: SurfelTree,
    records: Float[np.ndarray, "s d"],
    positions: Float[np.ndarray, "v 3"],
    normals: Float[np.ndarray, "v 3"],
) -> tuple[SurfelList, ...]:
    """The lists of all vertices, one entry for each of WIDTHS; the empty last row of `records` fills what is left."""
    families = _families(tree, records)
    own = np.ascontiguousarray(np.concatenate([positions, normals], axis=1, dtype=np.float32).T)
    workers, count = available_cores(), own.shape[1]
    shares = workers * max(-(-count // (workers * CHUNK)), 1)
    size = max(-(-count // shares), 1)
    starts = range(0, count, size)
    with ThreadPoolExecutor(workers) as pool:  # no vertex knows of another, and NumPy lets go of the interpreter
        found = list(pool.map(lambda start: _lists(families, own[:, start : start + size]), starts))
        lengths = np.concatenate([lengths for lengths, _ in found] or [np.zeros(0, np.int64)])
        bucket = np.minimum(np.searchsorted(WIDTHS, lengths), len(WIDTHS) - 1)
        width = np.array(WIDTHS)[bucket]
        order = np.argsort(bucket, kind="stable")
        begin = np.empty(count, np.int64)
        begin[order] = np.cumsum(width[order]) - width[order]
        table = np.full(int(width.sum()), len(records) - 1, np.int32)
        weight = np.zeros(len(table), np.float32)

        def place(start: int, levels: list[Pairs]) -> None:
            _place(levels, begin[start : start + size], lengths[start : start + size], table, weight)

        list(pool.map(place, starts, [levels for _, levels in found]))
    sizes = np.bincount(bucket, minlength=len(WIDTHS))
    ends, rows = np.cumsum(sizes * np.array(WIDTHS)), np.cumsum(sizes)
    return tuple(
        SurfelList(
            order[row - size : row].astype(np.int32),
            table[end - size * w : end].reshape(size, w),
            weight[end - size * w : end].reshape(size, w),
        )
        for size, w, end, row in zip(sizes.tolist(), WIDTHS, ends.tolist(), rows.tolist(), strict=True)
    )


def _families(tree: SurfelTree, records: np.ndarray) -> list[list[np.ndarray]]:
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


def _lists(levels: list[list[np.ndarray]], own: np.ndarray) -> tuple[np.ndarray, list[Pairs]]:
    """Lengths of the lists of some vertices, and level by level what is in them: vertex, surfel, weight, importance."""
    count = own.shape[1]
    lengths, found = _walk(levels, own, np.ones(count, np.float32))
    total = np.sum([np.bincount(vertex, weight, count) for vertex, _, weight, _ in found], axis=0)
    crowded = np.flatnonzero(total > FULL)
    if not len(crowded):
        return lengths, found
    shorter, again = _walk(levels, own[:, crowded], (FULL / total[crowded]).astype(np.float32))
    lengths[crowded] = shorter
    calm = [np.flatnonzero(np.take(total, level[0]) <= FULL) for level in found]
    kept = [tuple(np.take(array, own) for array in level) for level, own in zip(found, calm, strict=True)]
    return lengths, [*kept, *((np.take(crowded, level[0]), *level[1:]) for level in again)]


def _walk(levels: list[list[np.ndarray]], own: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, list[Pairs]]:
    """The same with importance multiplied by `scale`, of every vertex its own."""
    count, found, lengths, start = own.shape[1], [], np.zeros(own.shape[1], np.int64), 0
    # indices as wide as NumPy's own, or it would convert them at every use
    vertex, family, reached = np.arange(count), np.zeros(count, np.int64), None
    for number, columns in enumerate(levels):
        width = columns[0].shape[1]
        if number == 0:
            importance = _importance(columns, [column[:, None] for column in own])
        else:  # loops over long rows are faster than over families
            near = [np.take(column, family, axis=0).reshape(-1) for column in columns]
            importance = _importance(near, [np.repeat(np.take(column, vertex), FAN) for column in own])
            importance = importance.reshape(-1, FAN)
        importance *= np.take(scale, vertex)[:, None]
        weight = importance * (1 / NEGLIGIBLE)
        weight -= 1
        np.clip(weight, 0, 1, out=weight)
        if number + 1 < len(levels):  # leaves have no children
            opened = importance * (1 / OPENING)
            opened -= 1
            np.clip(opened, 0, 1, out=opened)
            weight *= 1 - opened
        else:
            opened = np.zeros((0, width), np.float32)
        if reached is not None:
            weight *= reached[:, None]
            opened *= reached[: len(opened), None]
        kept = np.flatnonzero(weight > 0)
        row, place = _row_and_place(kept, width)
        node = np.take(family, row) * width + place + start
        level = (np.take(vertex, row), node, np.take(weight, kept), np.take(importance, kept))
        found.append(level)
        lengths += np.bincount(level[0], minlength=count)
        parents = np.flatnonzero(opened > 0)
        row, place = _row_and_place(parents, width)
        # surfel i of a level has family i of the next as its children
        vertex, family = np.take(vertex, row), np.take(family, row) * width + place
        reached, start = np.take(opened, parents), start + columns[0].size
    return lengths, found


def _row_and_place(index: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Quotient and rest; of families by bits, as NumPy's division takes longer than all the rest."""
    return (index >> FAN_BITS, index & (FAN - 1)) if width == FAN else np.divmod(index, width)


def _importance(surfel: list[np.ndarray], own: list[np.ndarray]) -> np.ndarray:
    """The formula above, below 1."""
    x, y, z = (a - b for a, b in zip(surfel[:3], own[:3], strict=True))
    s = surfel[3]
    up = own[3] * x
    up += own[4] * y
    up += own[5] * z
    up += np.float32(1.5) * s
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
    return up


def _place(levels: list[Pairs], begin: np.ndarray, lengths: np.ndarray, table: np.ndarray, weight: np.ndarray) -> None:
    """Put the pairs of some vertices where their lists begin; of lists that are too long the most important."""
    if lengths.size and lengths.max() > WIDTHS[-1]:
        levels = _shortened(levels, lengths)
    filled = begin.copy()
    for vertex, node, share, _ in levels:
        found = np.bincount(vertex, minlength=len(filled))
        # pairs of one level are in the order of the vertices
        place = np.repeat(filled - (np.cumsum(found) - found), found)
        place += np.arange(len(vertex))
        table[place], weight[place] = node, share
        filled += found


def _shortened(levels: list[Pairs], lengths: np.ndarray) -> list[Pairs]:
    """The levels, of every vertex no more pairs than the last of WIDTHS."""
    overlong = lengths > WIDTHS[-1]
    own = [np.flatnonzero(np.take(overlong, level[0])) for level in levels]
    vertex, importance = (
        np.concatenate([np.take(level[i], part) for level, part in zip(levels, own, strict=True)]) for i in (0, 3)
    )
    order = np.lexsort((-importance, vertex))
    found = np.bincount(vertex, minlength=len(lengths))
    rank = np.arange(len(vertex)) - np.repeat(np.cumsum(found) - found, found)
    left_out = np.zeros(len(vertex), bool)
    left_out[order[rank >= WIDTHS[-1]]] = True
    parts = np.split(left_out, np.cumsum([len(part) for part in own])[:-1])
    return [
        tuple(np.delete(array, part[mask]) for array in level)
        for level, part, mask in zip(levels, own, parts, strict=True)
    ]
