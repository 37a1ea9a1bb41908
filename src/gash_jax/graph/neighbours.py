"""Neighbour tables and edge lists over vertices, on the host.

A *table* is (v, k) int32: row i holds the senders of the k edges that end at vertex i. An *edge list* is a pair
(senders, receivers), int32, sorted by receiver, then sender; it has no loops and no doubles.

Vertices that are not `valid` (not in any face) receive edges like all others but never send one. Nothing here
depends on the unit or the origin of the points. Ties in distance go to the lower index among the points found; which
of several equally far points is found last is up to the tree, always the same one for the same points.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.geometry.mesh import unique_edges

RING_SHARES = (8, 64, 256, None)
RING_DRAWS = 8

Table = Int[np.ndarray, "v k"]
Edges = tuple[Int[np.ndarray, "e"], Int[np.ndarray, "e"]]


def _serving(points: np.ndarray, valid: np.ndarray | None) -> np.ndarray:
    """Indices of the points that may serve as neighbours."""
    return np.arange(len(points)) if valid is None else np.flatnonzero(valid)


def _nearest(points: np.ndarray, serving: np.ndarray, k: int) -> Int[np.ndarray, "v k"]:
    """The k nearest of the serving points, self excluded, nearest first; repeated in turn where there are fewer."""
    everyone = np.arange(len(points), dtype=np.int32)[:, None]
    if len(serving) == 0:
        return np.repeat(everyone, k, axis=1)
    from scipy.spatial import KDTree  # slow to import, and not every graph searches

    count = min(k + 1, len(serving))
    distance, found = KDTree(points[serving]).query(points, count, workers=-1)
    # for one neighbour the tree drops the axis
    distance, found = np.reshape(distance, (-1, count)), serving[np.reshape(found, (-1, count))].astype(np.int32)
    # the receiver itself goes first, where it is skipped, also among points that coincide with it
    distance = np.where(found == everyone, -1.0, distance)
    tied = np.flatnonzero(np.any(distance[:, 1:] <= distance[:, :-1], axis=1))
    order = np.lexsort((found[tied], distance[tied]), axis=-1)
    found[tied] = np.take_along_axis(found[tied], order, axis=1)
    skip = (found[:, :1] == everyone) & (count > 1)
    column = np.arange(k) % np.minimum(count - skip, k) + skip
    return np.take_along_axis(found, column, axis=1)


def knn(points: Float[np.ndarray, "v 3"], k: int, valid: Bool[np.ndarray, "v"] | None = None) -> Int[np.ndarray, "v k"]:
    """The k nearest valid points of every point, nearest first.

    A point is never its own neighbour unless there is no other; with fewer than k others the row repeats them in turn.
    Raises ValueError if k < 1.
    """
    if k < 1:
        raise ValueError(f"k = {k} neighbours: ask for at least 1")
    return _nearest(np.asarray(points, np.float64), _serving(points, valid), k)


def mesh_edges(faces: Int[np.ndarray, "f 3"], n_vertices: int) -> tuple[Int[np.ndarray, "e"], Int[np.ndarray, "e"]]:
    """The mesh's own edges, both directions. Raises ValueError if a face names a vertex beyond n_vertices."""
    if faces.size and faces.max() >= n_vertices:
        raise ValueError(f"a face names vertex {faces.max()} of {n_vertices}: validate the mesh first")
    return _both_directions(unique_edges(faces))


def _both_directions(pairs: np.ndarray) -> tuple[Int[np.ndarray, "e"], Int[np.ndarray, "e"]]:
    both = np.concatenate([pairs, pairs[:, ::-1]]).astype(np.int32)
    both = both[np.lexsort((both[:, 0], both[:, 1]))]
    return both[:, 0].copy(), both[:, 1].copy()


def _draw(rng: np.random.Generator, rows: int, population: int, count: int) -> Int[np.ndarray, "v k"]:
    """`count` different numbers below `population` per row, every subset equally likely (Floyd 1987)."""
    drawn = np.empty((rows, count), np.int32)
    for i, last in enumerate(range(population - count, population)):
        candidate = rng.integers(0, last + 1, rows, np.int32)
        taken = np.any(drawn[:, :i] == candidate[:, None], axis=1)
        drawn[:, i] = np.where(taken, last, candidate)
    return drawn


def _ring(points: np.ndarray, serving: np.ndarray, share: int, each: int, rng: np.random.Generator) -> np.ndarray:
    """`each` of about the `share` nearest: drawn from the 2 `each` nearest of a subset thinned to match."""
    if share <= each:
        return _nearest(points, serving, each)
    pool = min(2 * each, share)
    thinned = np.sort(rng.choice(serving, -(-len(serving) * pool // share), replace=False))
    nearest = _nearest(points, thinned, pool)
    return np.take_along_axis(nearest, _draw(rng, len(points), pool, each), axis=1)


def _anywhere(n_points: int, serving: np.ndarray, each: int, rng: np.random.Generator) -> np.ndarray:
    """`each` of all serving points but the receiver itself."""
    others = len(serving) - 1
    if others < 1:
        return np.repeat(np.arange(n_points, dtype=np.int32)[:, None], each, axis=1)
    drawn = _draw(rng, n_points, others, min(each, others))
    # numbers from the receiver's own on are shifted by one: that leaves it out
    rank = np.searchsorted(serving, np.arange(n_points))[:, None]
    drawn += drawn >= rank
    return np.take(serving, drawn[:, np.arange(each) % drawn.shape[1]]).astype(np.int32)


def rings(
    points: Float[np.ndarray, "v 3"],
    seed: int,
    shares: Sequence[int | None] = RING_SHARES,
    each: int = RING_DRAWS,
    valid: Bool[np.ndarray, "v"] | None = None,
) -> Int[np.ndarray, "v k"]:
    """Neighbours on all scales: `each` from about the nearest 8, 64, 256 and from all, in that order of columns.

    A ring of the `share` nearest is drawn, seeded and without replacement, from the 2 `each` nearest members of a
    random subset that keeps one valid vertex in share / (2 each): searching whole rings of 256 would cost more than
    any network here. Where that leaves fewer than `each` vertices the ring repeats them. k = each * len(shares).

    Raises ValueError for a share below `each` (None means all vertices).
    """
    if any(share is not None and share < each for share in shares):
        raise ValueError(f"ring shares {tuple(shares)}: every ring must hold the {each} vertices drawn from it")
    points, serving, rng = (
        np.asarray(points, np.float64),
        _serving(points, valid),
        np.random.default_rng(seed),
    )
    # on a small mesh the outer rings are all of it
    limit = max(each, len(serving) - 1)
    shares = [None if share is None else min(share, limit) for share in shares]
    table = [
        _anywhere(len(points), serving, each, rng) if share is None else _ring(points, serving, share, each, rng)
        for share in shares
    ]
    return np.concatenate(table, axis=1)
