"""The row tracer: directions -> rays -> sums, for any integrand, in chunks that threads work off.

Rays of all vertices are cut into chunks of at most `RAYS_PER_CHUNK`, small enough for the level-2 cache, and of fewer
where that would leave too few chunks to keep all cores busy. Python threads work them off: directions (JAX) -> what the
rays meet (Embree, GIL released) -> the integrand's sums (JAX).

A row's result is the same to the last bit whichever rows are traced with it and however many threads there are. XLA may
sum in another order for arrays of another shape, so the shape of a chunk and the place of a row in it depend on the
whole mesh alone: rows first .. last are traced in the chunks of the whole, with the others left out.
"""

import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from typing import Any, Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Shaped

from gash_jax.algebra.arguments import as_array, is_real
from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.files.cores import available_cores
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.rays import Hits, RayQuery, TraceGeometry
from gash_jax.prt.sampling import Density, sample_rays

RAYS_PER_CHUNK = 1 << 17
LEAST_PER_CHUNK, MIDDLE_PER_CHUNK = 1 << 14, 1 << 16  # rays take an eighth longer in the least
CHUNKS = 8  # wanted at least
FRAME = 1e-3  # how far from orthonormal, and from the normal, frames may be that are given

ProgressFn = Callable[[int, int], None]


class Rows(NamedTuple):
    """Vertices to trace: where their rays start, their frames, and r shifts of the point set for each."""

    origins: Float[np.ndarray, "a 3"]
    frames: Float[np.ndarray, "a 3 3"]
    shifts: Float[np.ndarray, "a r 2"]

    def take(self, index: np.ndarray) -> "Rows":
        """Some of the vertices, in this order."""
        return Rows(self.origins[index], self.frames[index], self.shifts[index])


class Chunk(NamedTuple):
    """What an integrand sums: c vertices with r rows of n rays each, and what the rays found.

    Of the c vertices those at `inner` are the vertices `own` of all; the others fill the chunk up, untraced.
    """

    rows: Rows
    own: slice
    inner: slice
    lattice: str
    directions: Float[np.ndarray, "c r n 3"]
    answer: Bool[np.ndarray, "c r n"] | Hits  # True where a ray is free, or the nearest hits, each (c, r, n)
    share: Float[np.ndarray, "c"]  # p of the estimate (`integrands`)


class Integrand(NamedTuple):
    """What to integrate over the hemisphere of every vertex, and how densely its directions lie."""

    density: Density
    query: Literal["any", "closest"]  # whether a ray meets anything, or which face it meets first and where
    integrate: Callable[[Chunk], Array | np.ndarray]  # one array per row: "c r ..."


def active_rows(
    mesh: Mesh, geometry: TraceGeometry, frames: Float[np.ndarray, "v 3 3"] | None, shifts: np.ndarray
) -> tuple[np.ndarray, Rows]:
    """Indices of the vertices that have a normal, and their rows; `shifts` (v, r, 2) counts all vertices."""
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    chosen = (
        np.asarray(orthonormal_frame(mesh.normals[active])) if frames is None else checked_frames(frames, mesh, active)
    )
    return active, Rows(geometry.origins[active], chosen.astype(np.float32), shifts[active])


def checked_frames(frames: object, mesh: Mesh, active: np.ndarray) -> Float[np.ndarray, "a 3 3"]:
    """The frames of the active vertices. Raises ValueError unless they are orthonormal, the normal last."""
    given = np.asarray(as_array(frames))
    if given.shape != (len(mesh.vertices), 3, 3) or not is_real(given):
        raise ValueError(
            f"frames have shape {given.shape} {given.dtype}, not ({len(mesh.vertices)}, 3, 3): one frame per vertex"
        )
    chosen = given[active].astype(np.float64)
    square = np.einsum("aij,aik->ajk", chosen, chosen)
    upright = np.abs(chosen[..., 2] - mesh.normals[active]).max(axis=1) < FRAME
    good = (np.abs(square - np.eye(3)).max(axis=(1, 2)) < FRAME) & upright
    if not good.all():
        raise ValueError(
            f"{np.sum(~good)} of the frames (first: {active[np.argmin(good)]}) are not orthonormal, the normal last: "
            "give tangent, bitangent and normal as columns"
        )
    return chosen


def chunk_size(count: int, rays: int, two_shapes: bool = False) -> int:
    """Vertices in a chunk: a power of two, so that meshes of many sizes share few kernels; with `two_shapes`, two."""
    if two_shapes:
        return max(1, (MIDDLE_PER_CHUNK if count * rays >= CHUNKS // 2 * MIDDLE_PER_CHUNK else LEAST_PER_CHUNK) // rays)
    wanted = min(max(count * rays // CHUNKS, LEAST_PER_CHUNK), RAYS_PER_CHUNK)
    return 1 << max(0, min((wanted // rays).bit_length() - 1, (count - 1).bit_length()))


def chunks_of(count: int, rays: int, part: slice = slice(None), two_shapes: bool = False) -> list[slice]:
    """The vertices of each chunk, of `count` vertices with `rays` rays each or of a part of them."""
    first, last, _ = part.indices(count)
    size = chunk_size(count, rays, two_shapes)
    starts = range(first // size * size, last, size)
    return [slice(max(start, first), min(start + size, last)) for start in starts]


def trace_rows(
    rows: Rows,
    integrand: Integrand,
    n: int,
    query: RayQuery,
    *,
    share: Float[np.ndarray, "a"] | None = None,
    part: slice = slice(None),
    lattice: str = "hammersley",
    two_shapes: bool = False,
    progress: ProgressFn | None = None,
) -> tuple[Float[np.ndarray, "a r ..."], Float[np.ndarray, "a"]]:
    """Sums of every row, n rays each, and the share of each vertex's free rays; zeros outside `part`.

    `query` answers what the integrand asks. `share` is the p of the estimate; None takes each vertex's own. `part`
    are consecutive rows, at least one. `two_shapes` keeps to two sizes of chunks, so that next to nothing is compiled
    for a count of rows. `progress(done, total)` counts rows, from the threads.
    """
    count, rotations = rows.shifts.shape[:2]
    result, found = None, np.zeros(count, np.float32)
    chunks = chunks_of(count, rotations * n, part, two_shapes)
    lock, done = threading.Lock(), 0

    def work(own: slice) -> None:
        nonlocal result, done
        chunk, free = trace_chunk(rows, own, integrand.density, query, n, share, lattice, two_shapes)
        sums = np.asarray(integrand.integrate(chunk))
        with lock:
            result = np.zeros((count, *sums.shape[1:]), sums.dtype) if result is None else result
        result[own], found[own] = sums[chunk.inner], free[chunk.inner]
        with lock:
            done += own.stop - own.start
            if progress:
                progress(done, chunks[-1].stop - chunks[0].start)

    in_threads(work, chunks)
    assert result is not None
    return result, found


def trace_chunk(
    rows: Rows,
    own: slice,
    density: Density,
    query: RayQuery,
    n: int,
    share: Float[np.ndarray, "a"] | None = None,
    lattice: str = "hammersley",
    two_shapes: bool = False,
) -> tuple[Chunk, Float[np.ndarray, "c"]]:
    """What the rays of one of the chunks of `chunks_of` meet, and the free share of each of its vertices.

    Only the rays of the vertices `own` are traced.
    """
    count, rotations = rows.shifts.shape[:2]
    size = chunk_size(count, rotations * n, two_shapes)
    start = own.start // size * size
    # what a chunk lacks is filled with one of its own rows: one shape, one compilation
    index = np.clip(np.arange(start, start + size), own.start, own.stop - 1)
    inner, some, shape = slice(own.start - start, own.stop - start), rows.take(index), (size, rotations, n)
    origins, directions = (np.asarray(a) for a in sample_rays(*some, n, lattice, density))
    rays = slice(*(edge * rotations * n for edge in (inner.start, inner.stop)))
    answer = jax.tree.map(partial(_spread, rays, shape), query(origins[rays], directions[rays]))
    free = answer.face < 0 if isinstance(answer, Hits) else answer
    seen = np.count_nonzero(free, axis=(1, 2)).astype(np.float32) / np.float32(rotations * n)
    known = seen if share is None else share[index]
    return Chunk(some, own, inner, lattice, directions.reshape(*shape, 3), answer, known), seen


def _spread(
    rays: slice, shape: tuple[int, int, int], traced: Shaped[np.ndarray, "traced"]
) -> Shaped[np.ndarray, "c r n"]:
    """Answers of the traced rays in their places among all rays of a chunk."""
    if len(traced) == np.prod(shape):
        return traced.reshape(shape)
    everywhere = np.zeros(np.prod(shape), traced.dtype)
    everywhere[rays] = traced
    return everywhere.reshape(shape)


def in_threads(work: Callable[[Any], None], chunks: Sequence[Any]) -> None:
    """Call `work` for every chunk; the first exception ends it all, Ctrl-C in the main thread included."""
    threads = min(available_cores() + 1, len(chunks))  # one more than cores fills the gaps between kernels
    if threads < 2:
        for chunk in chunks:
            work(chunk)
        return
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work, chunk) for chunk in chunks]
        try:
            for future in as_completed(futures):
                future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
