"""Few rays a vertex, differently placed on neighbours, to which more can be added: what `models.guided` reconstructs.

Every vertex has one Korobov lattice (`sampling`), shifted. Along a curve that visits neighbours one after the other the
shift goes on where the lattice of the vertex before ended: the lattices of neighbours that see the same are one finer
lattice, and their mean is better than that of independent ones (a sixth of the variance less at 8 rays). One random
shift moves them all, so that each estimate is right on average, as that of any bake is.

Rays only ever double. A vertex keeps what it has: the next aligned block of a lattice is the lattice again, shifted.
Neighbours whose shifts follow one another every 8 rays have the very same directions once they have 64, and their
errors no longer cancel (a tenth to a quarter more error after averaging); so where rays are to be added, the shifts
differ in what 64 rays leave open, too.

The two halves of a vertex's rays are estimates of the same. How far they lie apart says, summed over the vertices of a
mesh, how good its rays are (`models.guided_error`).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.prt.integrands import direct
from gash_jax.prt.rays import VisibilityFn
from gash_jax.prt.sampling import ONE_MINUS, korobov
from gash_jax.prt.tracing import ProgressFn, Rows, chunks_of, in_threads, trace_chunk, trace_rows

LEAST_RAYS, MOST_RAYS = 4, 1 << 15
LARGEST_ROW = 64  # rays of one row: larger blocks are several, so that few kernels are compiled
MOST_POINTS = 1 << 20
HALVES = 9  # coefficients in which the halves of the rays are compared


class FewRays(NamedTuple):
    """Rays of each active vertex, their free share, the estimate in the vertex's own frame, and the squared distance
    of either half of the rays to it, over the first three bands; 0 where there are fewer than 8 rays."""

    rays: Int[np.ndarray, "a"]
    share: Float[np.ndarray, "a"]
    local: Float[np.ndarray, "a k"]
    halves: Float[np.ndarray, "a"]

    def take(self, index: np.ndarray) -> "FewRays":
        """Some of the vertices, in this order."""
        return FewRays(*(array[index] for array in self))


def check_few_rays(rays: WholeNumber) -> int:
    """A number of rays that such a bake can have, a power of two from 4. Raises ValueError for another."""
    rays = whole_number(rays, "rays", LEAST_RAYS, MOST_RAYS)
    if rays & (rays - 1):
        below = 1 << (rays.bit_length() - 1)
        raise ValueError(f"rays of a guided bake must be a power of two, not {rays}: use {below} or {2 * below}")
    return rays


def continued_shifts(
    order: Int[np.ndarray, "a"], rays: int, seed: int, later: int | None = None
) -> Float[np.ndarray, "a 1 2"]:
    """Shifts of the vertices' lattices of `rays` points (a power of two), continued in this `order` of the vertices.

    With `later`, a larger power of two, lattices differ once they have grown to so many points.
    """
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    point = place * rays if later is None else place * later + place % (later // rays) * rays
    shifts = np.random.default_rng(seed).random(2) + korobov(point % MOST_POINTS)
    return np.minimum(shifts - np.floor(shifts), ONE_MINUS).astype(np.float32)[:, None]


def trace_first(
    rows: Rows, rays: int, bands: int, visible: VisibilityFn, progress: ProgressFn | None = None
) -> FewRays:
    """The first `rays` of every vertex (a power of two up to `LARGEST_ROW`), blended by their own free share."""
    parts = 2 if rays > LEAST_RAYS else 1  # each half a row of its own
    halved = rows._replace(shifts=block_shifts(rows.shifts[:, 0], 0, parts, rays // parts))
    kept = {"lattice": "korobov", "two_shapes": True}
    found, share = trace_rows(halved, direct(bands), rays // parts, visible, **kept, progress=progress)
    return FewRays(np.full(len(share), rays), share, found.mean(axis=1), _squared(found[:, 0] - found[:, -1]) / 4)


def block_shifts(
    shifts: Float[np.ndarray, "c 2"], start: int, parts: int, size: int
) -> Float[np.ndarray, "c {parts} 2"]:
    """Shifts with which the first `size` points of a lattice become `parts` blocks of it, from point `start` on."""
    moved = shifts[:, None] + korobov(start + size * np.arange(parts))[None]
    return np.minimum(moved - np.floor(moved), ONE_MINUS).astype(np.float32)


def _squared(apart: Float[np.ndarray, "c k"]) -> Float[np.ndarray, "c"]:
    return np.einsum("ck,ck->c", apart[:, :HALVES], apart[:, :HALVES])


class _Block(NamedTuple):
    """Lattice points size .. 2 size - 1 of the vertices `whose`, in rows of up to `LARGEST_ROW`, and what is found."""

    whose: Int[np.ndarray, "c"]
    size: int
    row: int
    rows: Rows
    share: Float[np.ndarray, "u"]
    local: Float[np.ndarray, "u k"]
    free: Float[np.ndarray, "u"]


def trace_up_to(known: FewRays, wanted: Int[np.ndarray, "a"], rows: Rows, bands: int, visible: VisibilityFn) -> FewRays:
    """Double the rays of each vertex until it has those that are wanted, powers of two.

    All new rays are blended by the free share of the rays before, and traced in one go.
    """
    blocks, integrand, size = [], direct(bands), int(known.rays.min())
    while size < wanted.max():
        index = np.flatnonzero((known.rays <= size) & (wanted > size))
        if len(index):
            blocks.append(_block(rows.take(index), known.share[index], index, size, bands))
        size *= 2

    def work(task: tuple[_Block, slice]) -> None:
        block, own = task
        arguments = block.rows, own, integrand.density, visible, block.row, block.share, "korobov", True
        chunk, free = trace_chunk(*arguments)
        sums = np.asarray(integrand.integrate(chunk))
        block.local[own], block.free[own] = sums[chunk.inner, 0], free[chunk.inner]

    in_threads(work, [(b, own) for b in blocks for own in chunks_of(len(b.free), b.row, two_shapes=True)])
    rays, share, local, halves = (array.copy() for array in known)
    for block in blocks:
        whose, count = block.whose, len(block.whose)
        added = block.local.reshape(count, -1, bands**2).mean(axis=1)
        apart = (added - local[whose]) / 2  # of half of the rays to all
        local[whose] += apart
        halves[whose] = _squared(apart)
        share[whose] = (share[whose] + block.free.reshape(count, -1).mean(axis=1)) / 2
        rays[whose] += block.size
    return FewRays(rays, share, local, halves)


def _block(rows: Rows, share: Float[np.ndarray, "c"], index: Int[np.ndarray, "c"], size: int, bands: int) -> _Block:
    row = min(size, LARGEST_ROW)
    units = size // row
    shifts = block_shifts(rows.shifts[:, 0], size, units, row).reshape(-1, 1, 2)
    repeated = rows.take(np.repeat(np.arange(len(index)), units))._replace(shifts=shifts)
    found = np.zeros((len(shifts), bands**2), np.float32), np.zeros(len(shifts), np.float32)
    return _Block(index, size, row, repeated, np.repeat(share, units), *found)
