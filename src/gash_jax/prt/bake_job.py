"""What a bake traces, and for whom: rays, the rows of all starts, and those of them that get coefficients."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import WholeNumber, shown, whole_number
from gash_jax.prt.rays import RayQuery
from gash_jax.prt.scene import Scene, frames_of_all
from gash_jax.prt.tracing import Rows, active_rows

MAX_RAYS = 1 << 20


class Job(NamedTuple):
    """The rays of a bake. Of the starts of the scene those in `wanted` get coefficients; rays are drawn for those in
    `drawn`, `wanted` alone or all."""

    scene: Scene
    query: RayQuery
    rays: int  # a row, of all replicates
    seed: int
    wanted: slice
    drawn: slice
    active: Int[np.ndarray, "a"]  # the starts that have a normal
    rows: Rows  # theirs
    part: slice  # those of them that are wanted

    @property
    def replicates(self) -> int:
        """Point sets that the rays of a row are split into."""
        return self.rows.shifts.shape[1]

    @property
    def size(self) -> int:
        """How many vertices or points get coefficients."""
        return self.wanted.stop - self.wanted.start

    @property
    def own(self) -> Int[np.ndarray, "p"]:
        """Places of the rows `part` among them."""
        return self.active[self.part] - self.wanted.start

    def other_shifts(self) -> Float[np.ndarray, "a r 2"]:
        """Shifts of all rows for a second, independent set of rays."""
        seed, count = np.random.SeedSequence(self.seed, spawn_key=(1,)), len(self.scene.starts.vertices)
        return draw_shifts(seed, count, self.replicates, self.drawn.start, self.drawn.stop)[self.active]


def make_job(
    scene: Scene,
    query: RayQuery,
    rays: int,
    replicates: int,
    seed: int,
    *,
    frames: object = None,
    part: tuple[int, int],
    everywhere: bool = False,
) -> Job:
    """Rays for the receivers `part`, from the first to before the last; `everywhere`, rays for all starts of the scene.

    Raises ValueError for frames that do not fit.
    """
    count = len(scene.starts.vertices)
    wanted = slice(scene.receivers.start + part[0], scene.receivers.start + part[1])
    drawn = slice(0, count) if everywhere else wanted
    shifts = draw_shifts(seed, count, replicates, drawn.start, drawn.stop)
    active, rows = active_rows(scene.starts, scene.geometry, frames_of_all(frames, scene), shifts)
    some = slice(*np.searchsorted(active, [wanted.start, wanted.stop]).tolist())
    return Job(scene, query, rays, seed, wanted, drawn, active, rows, some)


def choose_replicates(rays: WholeNumber, replicates: WholeNumber | None) -> int:
    """4 unless told otherwise; fewer than 16 rays are not worth splitting. Raises ValueError on what does not fit."""
    rays = whole_number(rays, "rays", 1, MAX_RAYS)
    count = (4 if rays >= 16 else 1) if replicates is None else whole_number(replicates, "replicates", 1)
    if count > rays:
        raise ValueError(f"replicates must be from 1 to rays ({rays}), not {count}")
    if rays % count:
        lower = rays // count * count
        raise ValueError(f"rays ({rays}) must be a multiple of replicates ({count}): use {lower} or {lower + count}")
    return count


def draw_shifts(
    seed: int | np.random.SeedSequence, count: int, replicates: int, first: int, last: int
) -> Float[np.ndarray, "v r 2"]:
    """Random shifts of `count` vertices, drawn for the vertices first .. last alone; zeros elsewhere.

    A vertex has the same shifts whichever are drawn: the generator is set forward over the others' (64 random bits,
    one step of PCG64, make the two float32 of a shift).
    """
    bits = np.random.PCG64(seed)
    bits.advance(first * replicates)
    shifts = np.zeros((count, replicates, 2), np.float32)
    shifts[first:last] = np.random.Generator(bits).random((last - first, replicates, 2), np.float32)
    return shifts


def range_of(rows: slice | None, count: int) -> tuple[int, int]:
    """First and last of the rows of `count` that a slice names. Raises ValueError unless they are consecutive."""
    try:
        first, last, step = slice(None).indices(count) if rows is None else rows.indices(count)
    except (AttributeError, TypeError):  # no slice, or not of whole numbers
        first = last = step = 0
    if step != 1 or first >= last:
        raise ValueError(f"rows {shown(rows)} are no consecutive vertices of a mesh of {count}: use slice(first, last)")
    return first, last
