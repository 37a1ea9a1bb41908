"""Which surfels a block of vertices is shown: large or far ones as a whole, near ones in their parts.

Vertices are sorted along the same space-filling curve as the leaves of the tree and taken in blocks of BLOCK; a block
shares one list of `count` surfels. The list is a cut through the tree: it starts at the top, and a surfel is replaced
by its children while its *importance* for the block is above a threshold. With s the surfel's size, d its distance from
the block's middle, r the block's radius and n its mean normal,

    importance = s² / (d² + r² + s²) * min(h, 1)         how much of the view it fills, times how high it stands
    h          = (c + sqrt(c² + (sigma / 2)²)) / 2        c if c is large, near 0 if c is below the horizon
    c          = (n . offset + 1.5 s + 0.3 r) / (d + r)   cosine between n and the surfel's upper end

where sigma, the sine of the spread of the block's normals, softens the horizon: some vertices of the block see a little
below that of the mean normal. Surfels smaller than SMALLEST r stay whole, as their children would serve single
vertices.

The threshold is chosen block by block: the lowest in LADDER at which the list has room. A block with more around it
gets coarser surfels; only if even the highest threshold gives too many are the least important cut off. Surfels below
NEGLIGIBLE times the threshold are left out, since every place they take makes the others coarser. Around a convex body
little is left. Importance is a ratio of lengths: moving, turning (up to ties) or scaling the mesh changes nothing.

LADDER has eight thresholds an octave, the float32 whose mantissa is 0 after its first three bits. Finding the one below
an importance is then an addition and a shift of its bits; a search took a fifth of all time.
"""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float, Int

from gash_jax.files.cores import available_cores
from gash_jax.graph.surfels import FAN, VERTEX_BITS, SurfelTree, curve_order

BLOCK = 16
# from 0.11 to 1; a step of the ladder is 2^20 in the bits of a float32
STEP_BITS, STEPS = 20, 27
TOP_STEP = int(np.float32(1).view(np.int32)) >> STEP_BITS
LADDER = ((TOP_STEP - np.arange(STEPS, dtype=np.int32)[::-1]) << STEP_BITS).astype(np.int32).view(np.float32)
SMALLEST = 0.4
# four octaves of eight steps
NEGLIGIBLE_STEPS = 32
NEGLIGIBLE = np.float32(2.0**-4)
TINY = np.float32(1e-12)
# blocks at a time: their candidates stay in the cache
CHUNK = 256


def vertex_blocks(
    positions: Float[np.ndarray, "v 3"], normals: Float[np.ndarray, "v 3"], axes: Float[np.ndarray, "3 3"]
) -> Int[np.ndarray, "b w"]:
    """Vertices in the order of the curve, BLOCK at a time."""
    order = curve_order(positions, normals, axes, VERTEX_BITS).astype(np.int32)
    missing = -len(order) % BLOCK
    return np.concatenate([order, np.repeat(order[-1:], missing)]).reshape(-1, BLOCK)


def select_surfels(
    tree: SurfelTree,
    records: Float[np.ndarray, "s d"],
    positions: Float[np.ndarray, "b w 3"],
    normals: Float[np.ndarray, "b w 3"],
    count: int,
) -> Int[np.ndarray, "b n"]:
    """Rows of `records` that each block looks at, most important first; the empty last row fills what is left."""
    columns = [np.ascontiguousarray(records[:, i]) for i in (0, 1, 2, 7)]
    # without size nothing is important
    columns[3] = np.where(records[:, 6] > 0, columns[3], np.float32(0))
    workers = available_cores()
    shares = workers * -(-len(positions) // (workers * CHUNK))
    size = -(-len(positions) // shares)
    chunks = [slice(start, start + size) for start in range(0, len(positions), size)]
    with ThreadPoolExecutor(workers) as pool:  # no block knows of another, and NumPy lets go of the interpreter
        found = pool.map(lambda c: _select(tree, columns, positions[c], normals[c], count), chunks)
        return np.concatenate(list(found))


def _select(
    tree: SurfelTree, columns: list[np.ndarray], positions: np.ndarray, normals: np.ndarray, count: int
) -> Int[np.ndarray, "b n"]:
    blocks = len(positions)
    # indices as wide as NumPy's own, or it would convert them at every use
    block = np.repeat(np.arange(blocks), tree.level_sizes[0])
    node = np.tile(np.arange(tree.level_sizes[0]), blocks)
    own, below = _summaries(positions, normals), np.full(len(block), STEPS, np.int8)
    seen = []
    while len(block):
        importance, small = _importance(columns, own, block, node)
        child = np.take(tree.first_child, node)
        step = _steps_below(importance)
        # the surfel is in the cuts of the steps from `since` on, as long as its parent is opened: up to `below`
        since = np.clip(step, 0, STEPS).astype(np.int8)
        opened = (since > 0) & (child >= 0) & ~small
        since[~opened] = 0
        # and as long as it is not negligible beside what is not opened
        last = np.minimum(below, np.clip(step + NEGLIGIBLE_STEPS, 0, STEPS).astype(np.int8))
        keep, opened = np.flatnonzero(since < last), np.flatnonzero(opened)
        seen.append((block[keep], node[keep], importance[keep], since[keep], last[keep]))
        block = np.repeat(block[opened], FAN)
        below = np.repeat(np.minimum(since, below)[opened], FAN)
        node = (child[opened].astype(np.int64)[:, None] + np.arange(FAN)).reshape(-1)
    block, node, importance, since, below = (np.concatenate(parts) for parts in zip(*seen, strict=True))
    change = np.bincount(block * (STEPS + 1) + since, minlength=blocks * (STEPS + 1))
    change -= np.bincount(block * (STEPS + 1) + below, minlength=blocks * (STEPS + 1))
    fits = np.cumsum(change.reshape(blocks, STEPS + 1), axis=1)[:, :-1] <= count
    step = np.where(fits.any(axis=1), fits.argmax(axis=1), STEPS - 1)[block]
    chosen = np.flatnonzero((since <= step) & (step < below))
    block, node, importance = block[chosen], node[chosen], importance[chosen]
    order = np.argsort(block - importance.astype(np.float64), kind="stable")
    block, node = block[order], node[order]
    found = np.bincount(block, minlength=blocks)
    rank = np.arange(len(block)) - np.repeat(np.cumsum(found) - found, found)
    table = np.full((blocks, count), len(columns[0]) - 1, np.int32)
    within = rank < count
    table[block[within], rank[within]] = node[within]
    return table


def _summaries(positions: np.ndarray, normals: np.ndarray) -> list[np.ndarray]:
    """Of every block: middle (3), mean normal (3), radius, a quarter of the squared sine of the normals' spread."""
    middle, axis = positions.mean(axis=1), normals.mean(axis=1)
    radius = np.sqrt(np.mean(np.sum((positions - middle[:, None]) ** 2, axis=-1), axis=1))
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-6)
    cosine = np.clip(np.mean(normals @ axis[:, :, None], axis=(1, 2)), 0, 1)
    return [np.ascontiguousarray(a, dtype=np.float32) for a in (*middle.T, *axis.T, radius, 0.25 * (1 - cosine**2))]


def _steps_below(importance: np.ndarray) -> np.ndarray:
    """How many steps of the ladder are smaller, as if it went on in both directions."""
    return ((importance.view(np.int32) + np.int32((1 << STEP_BITS) - 1)) >> STEP_BITS) - np.int32(TOP_STEP - STEPS + 1)


def _importance(
    columns: list[np.ndarray], own: list[np.ndarray], block: np.ndarray, node: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Importance of every pair, below 1, and whether the surfel is too small to be opened for its block.

    In place: a new array for every step costs time.
    """
    x, y, z, s = (np.take(column, node) for column in columns)
    mx, my, mz, ax, ay, az, r, spread = (np.take(column, block) for column in own)
    x -= mx
    y -= my
    z -= mz
    up = np.multiply(ax, x, out=ax)
    up += np.multiply(ay, y, out=ay)
    up += np.multiply(az, z, out=az)
    up += np.multiply(s, np.float32(1.5), out=mx)
    up += np.multiply(r, np.float32(0.3), out=mx)
    small = s <= np.multiply(r, np.float32(SMALLEST), out=mx)
    square = np.multiply(x, x, out=x)
    square += np.multiply(y, y, out=y)
    square += np.multiply(z, z, out=z)
    distance = np.sqrt(square, out=my)
    distance += r
    distance += TINY
    up /= distance
    spread += np.multiply(up, up, out=mx)
    up += np.sqrt(spread, out=spread)
    up *= np.float32(0.5)
    np.minimum(up, 1, out=up)
    s *= s
    square += np.multiply(r, r, out=r)
    square += s
    square += TINY
    s /= square
    s *= up
    s *= np.float32(0.999)
    return s, small
