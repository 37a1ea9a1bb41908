"""Which surfels a block of vertices looks at: a cut through the surfel tree, as fine as a fixed number allows.

Vertices are sorted along the same curve as the leaves and taken in blocks of BLOCK, which share one list of `count`
surfels. A surfel is opened into its children while it is important: large for its distance, with a part that may
stand above the tangent planes of the block. With s its size, d its distance and r the radius of the block,

    importance = s² / (d² + r² + s²) * min((c + sqrt(c² + (sigma / 2)²)) / 2, 1)
    c          = (n . offset + 1.5 s + 0.3 r) / (d + r)

c is the cosine to the block's mean normal n at which its upper end stands; the root is c where it is large, and takes
off softly below the horizon as far as the block's normals differ (sigma: sine of their spread). A surfel is not opened
below SMALLEST r: within the block finer ones would serve some of its vertices only. Of the steps of importance in
LADDER each block takes the finest at which its list still fits: it is coarser where there is more to see, and cut off
only where even the coarsest list is too long. What is below NEGLIGIBLE of the step is left out: every place that such a
surfel takes, about or below the horizon, makes the others coarser. On a convex body little is left. All of it is
relative: nothing changes when the mesh is moved, turned (up to ties) or scaled.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float, Int

from gash_jax.graph.surfels import FAN, VERTEX_BITS, SurfelTree, curve_order

BLOCK = 16
# float32 of short decimals, the same everywhere
LADDER = np.array(
    [
        *(0.1, 0.115, 0.13, 0.15, 0.17, 0.19, 0.21, 0.24, 0.27, 0.3, 0.33),
        *(0.37, 0.41, 0.46, 0.51, 0.57, 0.64, 0.71, 0.79, 0.88, 1.0),
    ],
    np.float32,
)
SMALLEST = 0.4
NEGLIGIBLE = np.float32(0.05)
# blocks per call: their candidates stay in the cache
CHUNK = 256


def vertex_blocks(
    positions: Float[np.ndarray, "v 3"], normals: Float[np.ndarray, "v 3"], axes: Float[np.ndarray, "3 3"]
) -> Int[np.ndarray, "b w"]:
    """Vertices in the order of the curve, BLOCK at a time."""
    order = curve_order(positions, normals, axes, VERTEX_BITS).astype(np.int32)
    missing = -len(order) % BLOCK
    return np.concatenate([order, np.repeat(order[-1:], missing)]).reshape(-1, BLOCK)


def sight_table(
    tree: SurfelTree,
    records: Float[np.ndarray, "s d"],
    positions: Float[np.ndarray, "b w 3"],
    normals: Float[np.ndarray, "b w 3"],
    count: int,
    workers: int = 1,
) -> Int[np.ndarray, "b n"]:
    """Rows of `records` that each block looks at, most important first; the empty last row fills what is left."""
    columns = [np.ascontiguousarray(records[:, i]) for i in (0, 1, 2, 7)]
    live = records[:, 6] > 0
    chunks = [slice(start, start + CHUNK) for start in range(0, len(positions), CHUNK)]
    work = lambda c: _look(tree, columns, live, positions[c], normals[c], count)  # noqa: E731
    if workers > 1 and len(chunks) > 1:
        with ThreadPoolExecutor(workers) as pool:
            tables = list(pool.map(work, chunks))
    else:
        tables = [work(chunk) for chunk in chunks]
    return np.concatenate(tables)


def _look(
    tree: SurfelTree,
    columns: list[np.ndarray],
    live: np.ndarray,
    positions: np.ndarray,
    normals: np.ndarray,
    count: int,
) -> Int[np.ndarray, "b n"]:
    blocks = len(positions)
    middle = positions.mean(axis=1)
    radius = np.sqrt(np.mean(np.sum((positions - middle[:, None]) ** 2, axis=-1), axis=1))
    axis = normals.mean(axis=1)
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-6)
    cosine = np.clip(np.mean(normals @ axis[:, :, None], axis=(1, 2)), 0, 1)
    sine = np.sqrt(1 - cosine**2)
    own = [np.ascontiguousarray(a, dtype=np.float32) for a in (*middle.T, *axis.T, radius, sine)]
    block = np.repeat(np.arange(blocks, dtype=np.int32), tree.level_sizes[0])
    node = np.tile(np.arange(tree.level_sizes[0], dtype=np.int32), blocks)
    below = np.full(len(block), len(LADDER), np.int8)
    seen = []
    while len(block):
        importance, small = _importance(columns, own, block, node)
        importance *= live[node]
        child = tree.first_child[node]
        # the surfel is in the cuts of the steps from `since` on, as long as its parent is opened: up to `below`
        since = np.searchsorted(LADDER, importance).astype(np.int8)
        opened = (since > 0) & (child >= 0) & ~small
        since[~opened] = 0
        # and as long as it is not negligible beside what is not opened
        last = np.minimum(below, np.searchsorted(LADDER, importance / NEGLIGIBLE).astype(np.int8))
        keep = since < last
        seen.append((block[keep], node[keep], importance[keep], since[keep], last[keep]))
        block = np.repeat(block[opened], FAN)
        below = np.repeat(np.minimum(since, below)[opened], FAN)
        node = (child[opened][:, None] + np.arange(FAN, dtype=np.int32)).reshape(-1)
    block, node, importance, since, below = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    steps = len(LADDER) + 1
    change = np.bincount(block * steps + since, minlength=blocks * steps)
    change -= np.bincount(block * steps + below, minlength=blocks * steps)
    fits = np.cumsum(change.reshape(blocks, steps), axis=1)[:, :-1] <= count
    step = np.where(fits.any(axis=1), fits.argmax(axis=1), len(LADDER) - 1)[block]
    chosen = (since <= step) & (step < below)
    block, node, importance = block[chosen], node[chosen], importance[chosen]
    order = np.argsort(block - importance.astype(np.float64), kind="stable")
    block, node = block[order], node[order]
    found = np.bincount(block, minlength=blocks)
    rank = np.arange(len(block)) - np.repeat(np.cumsum(found) - found, found)
    table = np.full((blocks, count), len(live) - 1, np.int32)
    within = rank < count
    table[block[within], rank[within]] = node[within]
    return table


def _importance(
    columns: list[np.ndarray], own: list[np.ndarray], block: np.ndarray, node: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Importance of every pair, below 1, and whether the surfel is too small to be opened for its block."""
    x, y, z, s = (np.take(column, node) for column in columns)
    mx, my, mz, ax, ay, az, r, sine = (np.take(column, block) for column in own)
    x -= mx
    y -= my
    z -= mz
    square = x * x + y * y + z * z
    d = np.sqrt(square)
    cosine = (ax * x + ay * y + az * z + 1.5 * s + 0.3 * r) / (d + r + np.float32(1e-12))
    up = np.minimum(0.5 * (cosine + np.sqrt(cosine * cosine + 0.25 * sine * sine)), 1)
    return (s * s / (square + r * r + s * s + np.float32(1e-12))) * up * np.float32(0.999), s <= SMALLEST * r
