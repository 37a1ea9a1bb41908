"""Which surfels a vertex is shown, and with what weight: large or far ones as a whole, near ones in their parts.

Every vertex has a list of its own, and so what is predicted for it does not depend on which other vertices there are. A
list is a cut through the tree with soft edges (`surfel_walk`).

Deep in narrow gaps lists would be long. Where the weights add up to a total of more than FULL, the list is made anew
with importance times FULL / total: it is coarser, and as the total is continuous, so are its weights.

The leaves right beside a vertex are told apart (`surfel_cover`).

Lists are padded to one of WIDTHS with surfels of weight 0, and vertices with lists of one width lie together. What the
network is given at a time is about CALL pairs; vertices that would be but a part of that go to the next width. A list
of more than the last width keeps its most important.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.files.cores import available_cores
from gash_jax.graph.surfel_cover import ClosePairs, close_pairs, joined_pairs
from gash_jax.graph.surfel_walk import Pairs, families, walk_tree
from gash_jax.graph.surfels import SurfelTree

FULL = 128.0
WIDTHS = (24, 48, 96, 144, 256)
# pairs that the network is given at a time, which stay in the cache together
CALL = 16384
# vertices at a time: fewer, and calls cost more than loops; more, and arrays leave the cache
CHUNK = 1024


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
    moves: bool = False,
) -> tuple[tuple[SurfelList, ...], ClosePairs]:
    """The lists of all vertices, one entry for each of WIDTHS, and the leaves that are close.

    The empty last row of `records` fills what is left of a list. What is below the horizon now is kept if the mesh
    `moves`.
    """
    levels = families(tree, records)
    spreads = [np.ascontiguousarray(records[:, i]) for i in range(14, 20)]
    own = np.ascontiguousarray(np.concatenate([positions, normals], axis=1, dtype=np.float32).T)
    workers, count = available_cores(), own.shape[1]
    shares = workers * max(-(-count // (workers * CHUNK)), 1)
    size = max(-(-count // shares), 1)
    starts = range(0, count, size)
    with ThreadPoolExecutor(workers) as pool:  # no vertex knows of another, and NumPy lets go of the interpreter
        found = list(pool.map(lambda start: _lists(levels, own[:, start : start + size], spreads, moves), starts))
        lengths = np.concatenate([lengths for lengths, _, _ in found] or [np.zeros(0, np.int64)])
        bucket = _buckets(lengths)
        width = np.array(WIDTHS)[bucket]
        order = np.argsort(bucket, kind="stable")
        begin = np.empty(count, np.int64)
        begin[order] = np.cumsum(width[order]) - width[order]
        table = np.full(int(width.sum()), len(records) - 1, np.int32)
        weight = np.zeros(len(table), np.float32)

        def place(start: int, pairs: list[Pairs]) -> None:
            _place(pairs, begin[start : start + size], lengths[start : start + size], table, weight)

        list(pool.map(place, starts, [pairs for _, pairs, _ in found]))
    close = [close_pairs(start, pairs) for start, (_, _, pairs) in zip(starts, found, strict=True)]
    sizes = np.bincount(bucket, minlength=len(WIDTHS))
    ends, rows = np.cumsum(sizes * np.array(WIDTHS)), np.cumsum(sizes)
    lists = tuple(
        SurfelList(
            order[row - size : row].astype(np.int32),
            table[end - size * w : end].reshape(size, w),
            weight[end - size * w : end].reshape(size, w),
        )
        for size, w, end, row in zip(sizes.tolist(), WIDTHS, ends.tolist(), rows.tolist(), strict=True)
    )
    return lists, joined_pairs(close)


def call_size(width: int) -> int:
    """Vertices with lists of this width that the network is given at a time."""
    return CALL // width // 8 * 8


def _buckets(lengths: np.ndarray) -> np.ndarray:
    """For every vertex the number of its width."""
    order = np.argsort(lengths.astype(np.int16), kind="stable")  # of short integers NumPy counts, and does not compare
    ends = np.searchsorted(lengths[order], WIDTHS, side="right").tolist()
    ends[-1] = len(lengths)
    bucket, start = np.zeros(len(lengths), np.int64), 0
    for number, (width, end) in enumerate(zip(WIDTHS, ends, strict=True)):
        rest = (end - start) % call_size(width)
        # half a call and more is worth one
        moves_on = rest < call_size(width) // 2 and end < len(lengths)
        stop = end - rest if moves_on else end
        bucket[order[start:stop]] = number
        start = stop
    return bucket


def _lists(
    levels: list[list[np.ndarray]], own: np.ndarray, spreads: list[np.ndarray], moves: bool
) -> tuple[np.ndarray, list[Pairs], Pairs]:
    """Lengths of the lists of some vertices, level by level what is in them, and the leaves beside them."""
    found, close, total = walk_tree(levels, own, spreads, moves)
    crowded = np.flatnonzero(total > FULL)
    if len(crowded):
        # what is beside a vertex stays
        scale = (FULL / total[crowded]).astype(np.float32)
        again, _, _ = walk_tree(levels, own[:, crowded], spreads, moves, scale)
        calm = [level.some(np.flatnonzero(np.take(total, level.vertex) <= FULL)) for level in found]
        found = [*calm, *(level._replace(vertex=np.take(crowded, level.vertex)) for level in again)]
    return np.sum([np.bincount(level.vertex, minlength=own.shape[1]) for level in found], axis=0), found, close


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
    own = [np.flatnonzero(np.take(overlong, level.vertex)) for level in levels]
    vertex = np.concatenate([np.take(level.vertex, part) for level, part in zip(levels, own, strict=True)])
    importance = np.concatenate([np.take(level.importance, part) for level, part in zip(levels, own, strict=True)])
    order = np.lexsort((-importance, vertex))
    found = np.bincount(vertex, minlength=len(lengths))
    rank = np.arange(len(vertex)) - np.repeat(np.cumsum(found) - found, found)
    left_out = np.zeros(len(vertex), bool)
    left_out[order[rank >= WIDTHS[-1]]] = True
    parts = np.split(left_out, np.cumsum([len(part) for part in own])[:-1])
    return [
        Pairs(*(np.delete(array, part[mask]) for array in level))
        for level, part, mask in zip(levels, own, parts, strict=True)
    ]
