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

from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.files.cores import available_cores, in_threads
from gash_jax.graph.surfel_cover import ClosePairs, close_pairs, joined_pairs
from gash_jax.graph.surfel_walk import Walked, place_lists, surfel_blocks, walk_tree
from gash_jax.graph.surfels import SurfelTree

FULL = 128.0
WIDTHS = (24, 48, 96, 144, 256)
# pairs that the network is given at a time, which stay in the cache together
CALL = 16384
# vertices at a time: enough that calls cost nothing, few enough that all threads have some
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
    blocks = surfel_blocks(tree, records)
    own = np.concatenate([positions, normals], axis=1, dtype=np.float32)
    workers, count = available_cores(), len(own)
    shares = workers * max(-(-count // (workers * CHUNK)), 1)  # as many for every thread
    size = max(-(-count // shares), 1)
    starts = range(0, count, size)
    walk = partial(walk_tree, blocks, full=FULL, most=WIDTHS[-1], moves=moves)
    found = in_threads(lambda start: walk(own[start : start + size]), starts, workers)
    lengths = np.concatenate([part.lengths for part in found] or [np.zeros(0, np.int64)])
    bucket = _buckets(lengths)
    width = np.array(WIDTHS)[bucket]
    order = np.argsort(bucket, kind="stable")
    begin = np.empty(count, np.int64)
    begin[order] = np.cumsum(width[order]) - width[order]
    table = np.empty(int(width.sum()), np.int32)
    weight = np.empty(len(table), np.float32)

    def place(start: int, part: Walked) -> None:
        chosen = slice(start, start + size)
        place_lists(part, begin[chosen], width[chosen], len(records) - 1, table, weight)

    in_threads(lambda pair: place(*pair), zip(starts, found, strict=True), workers)
    close = [close_pairs(start, part.beside) for start, part in zip(starts, found, strict=True)]
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
