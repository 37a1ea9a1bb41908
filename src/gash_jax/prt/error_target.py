"""Bake to an error instead of a number of rays: rounds of rays that go where the estimated error is.

Every vertex has one randomly shifted Korobov lattice, which can be doubled and keeps the rays that were traced
(`sampling`). The first `PILOT` rays of a lattice fall into four interleaved quarters; doubling joins them two by two
and adds two. Each quarter gives an estimate, blended with the closed form by the share of free rays known so far
(`integrands`), so a vertex whose rays are all free *is* the closed form.

Error of a vertex with N rays. The quarters q of one lattice are no independent replicates: a lattice is better than its
parts, put together by chance, would be. So their spread is scaled by what one lattice is worth,

    standard_error² = KAPPA(N) * var(q) / 4,

with KAPPA measured on generated shapes (`experiments/lattice_error`). It has the floor of `bake`; where all N rays
agree it is MISSED times that floor, the rms error found among such vertices in the same experiment: most are exact.

A round doubles the rays of the vertices that `allocation` chooses; the bake ends when the estimated error of the whole
mesh is at most CAUTION times the one asked for.
"""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import RealNumber, WholeNumber, real_number, shown, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.prt.allocation import PILOT, choose_doublings, neighbour_mean
from gash_jax.prt.bake import free_and_dark
from gash_jax.prt.error_bars import standard_error_floor
from gash_jax.prt.few_rays import MOST_RAYS, block_shifts
from gash_jax.prt.integrands import direct, to_world
from gash_jax.prt.rays import VisibilityFn
from gash_jax.prt.scene import as_occluders, as_points, make_scene
from gash_jax.prt.tracing import ProgressFn, Rows, active_rows, trace_rows
from gash_jax.prt.transfer import Transfer, make_metadata
from gash_jax.prt.visibility import visibility

if TYPE_CHECKING:
    from jax import Array

    from gash_jax.algebra.arguments import ArrayLike

# what is aimed at, of the error asked for: meshes of planes and straight edges come out up to a quarter worse
CAUTION = 0.95
LOWEST_ERROR, HIGHEST_ERROR = 1e-3, 1.0
ROWS_AT_ONCE = 1 << 18
# rms error of vertices whose rays all agree, over the floor: measured with KAPPA
MISSED = 0.25
# variance of lattices of 8, 16, 32 ... rays over a quarter of the variance among their quarters
KAPPA = (0.89, 0.43, 0.24, 0.44, 0.43, 0.43, 0.40, 0.40, 0.50)


class State(NamedTuple):
    """What is known of each active vertex: rays, free share, quarters in its own frame."""

    rays: Int[np.ndarray, "a"]
    share: Float[np.ndarray, "a"]
    quarters: Float[np.ndarray, "a 4 k"]


def check_error(error: RealNumber) -> float:
    """The error that a bake aims at as a Python float. Raises ValueError for one that none should aim at."""
    number = real_number(error)
    if number is None or not LOWEST_ERROR <= number <= HIGHEST_ERROR:
        raise ValueError(f"error must be from {LOWEST_ERROR:g} to {HIGHEST_ERROR:g}, not {shown(error)}")
    return number


def kappa(rays: Int[np.ndarray, "a"]) -> Float[np.ndarray, "a"]:
    """Scale of the quarters' variance for lattices of `rays` points; the last entry serves all larger ones."""
    level = np.log2(rays / PILOT).round().astype(int)
    return np.array(KAPPA, np.float32)[np.minimum(level, len(KAPPA) - 1)]


def trace_points(rows: Rows, share: np.ndarray | None, start: int, end: int, bands: int, visible: VisibilityFn):
    """Lattice points start .. end of some vertices, as the (a, parts, k) estimates of equal parts and the free share.

    Two ray kernels serve all rounds, so that little is compiled: 4 rows of 2 rays, and from 32 rays on rows of 16.
    """
    size, group = (2, 4) if end - start < 32 else (16, 1)
    units = (end - start) // (size * group)
    parts = 4 if start == 0 else 2
    slab = max(1, ROWS_AT_ONCE // (units * group))
    estimates, free = [], []
    for first in range(0, len(rows.origins), slab):
        some = rows.take(np.arange(first, min(first + slab, len(rows.origins))))
        count = len(some.origins)
        shifts = block_shifts(some.shifts[:, 0], start, units * group, size).reshape(count * units, group, 2)
        repeated = some.take(np.repeat(np.arange(count), units))._replace(shifts=shifts)
        known = None if share is None else np.repeat(share[first : first + count], units)
        local, found = trace_rows(repeated, direct(bands), size, visible, share=known, lattice="korobov")
        estimates.append(local.reshape(count, parts, -1, bands**2).mean(2))
        free.append(found.reshape(count, units).mean(1))
    return np.concatenate(estimates), np.concatenate(free)


def double_rays(state: State, chosen: np.ndarray, rows: Rows, bands: int, visible: VisibilityFn) -> None:
    """Double the rays of the chosen vertices, in place."""
    before = state.rays.copy()
    for rays in np.unique(before[chosen]):
        index = np.flatnonzero(chosen & (before == rays))
        new, free = trace_points(rows.take(index), state.share[index], int(rays), 2 * int(rays), bands, visible)
        old = state.quarters[index]
        state.quarters[index] = np.concatenate([(old[:, 0::2] + old[:, 1::2]) / 2, new], axis=1)
        state.share[index] = (state.share[index] + free) / 2
        state.rays[index] *= 2


def standard_error(state: State, quarters: Float[np.ndarray, "a 4 k"], bands: int) -> Float[np.ndarray, "a k"]:
    """Standard errors of the mean of the quarters (module docstring)."""
    difference = quarters - quarters.mean(1, keepdims=True)
    variance = kappa(state.rays)[:, None] * np.einsum("aqk,aqk->ak", difference, difference) / 12
    agree = (state.share == 0) | (state.share == 1)
    floor = standard_error_floor(bands, state.rays, state.share) * np.where(agree, MISSED, 1.0)[:, None]
    return np.maximum(np.sqrt(variance), floor).astype(np.float32)


def bake_to_error(
    mesh: MeshLike,
    error: RealNumber,
    bands: WholeNumber = 3,
    *,
    points: "ArrayLike | Array | None" = None,
    normals: "ArrayLike | Array | None" = None,
    occluders: Sequence[MeshLike] = (),
    seed: WholeNumber = 0,
    backend: str = "embree",
    progress: ProgressFn | None = None,
) -> Transfer:
    """Bake shadowed diffuse transfer to a relative RMS error over the mesh (relrmse).

    `standard_error` is calibrated for irregular scenes; read it with Student's t at 3 degrees of freedom. The
    metadata's `modelled` says which share of the vertices stayed with a formula and how many rays each round took;
    `estimated_error` is what the bake believes it reached. `progress(done, total)` counts rays, the total as
    expected so far. Vertices stop at 2^15 rays each. `points` with `normals` and `occluders` are those of
    `bake_transfer`. Raises ValueError for options out of range.

    >>> transfer = gash_jax.bake_to_error("bunny.ply", 0.05)
    >>> transfer.metadata["estimated_error"] <= 0.05
    True
    """
    mesh, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    error, given, blockers = check_error(error), as_points(points, normals), as_occluders(occluders)
    started = time.perf_counter()
    scene = make_scene(mesh, given, blockers).receivers_alone()
    receivers = mesh if given is None else given
    visible = visibility(scene.geometry.vertices, scene.geometry.faces, backend)
    built = time.perf_counter()
    shifts = np.random.default_rng(seed).random((len(receivers.vertices), 1, 2), np.float32)
    active, rows = active_rows(receivers, scene.geometry, None, shifts)
    coefficients, errors = (np.zeros((len(receivers.vertices), bands**2), np.float32) for _ in range(2))
    report: dict[str, Any] = {"rounds": [], "estimated_error": 0.0, "modelled": {}}
    rays_total = 0
    if len(active):
        smooth = neighbour_mean(receivers, active)
        state, report = run_rounds(rows, error, bands, visible, smooth, progress)
        rays_total = int(state.rays.sum())
        quarters = np.asarray(to_world(state.quarters, rows.frames))
        coefficients[active] = quarters.mean(1)
        errors[active] = standard_error(state, quarters, bands)
    finished = time.perf_counter()
    metadata = make_metadata(
        bands,
        "bake to error",
        {"error": error, "seed": seed, "backend": backend, **({"occluders": len(blockers)} if blockers else {})},
        rays_total=rays_total,
        **report,
        ray_offset=scene.geometry.offset,
        seconds={"build": built - started, "trace": finished - built, "total": finished - started},
    )
    return Transfer(coefficients, errors, *receivers, metadata)


def run_rounds(
    rows: Rows,
    error: float,
    bands: int,
    visible: VisibilityFn,
    smooth: sp.csr_matrix,
    progress: ProgressFn | None = None,
) -> tuple[State, dict[str, Any]]:
    """Trace until the estimated relative error is at most `error`; also what there is to say about it."""
    count = len(rows.origins)
    quarters, share = trace_points(rows, None, 0, PILOT, bands, visible)
    state = State(np.full(count, PILOT), share.astype(np.float32), quarters)
    rounds = [{"vertices": count, "rays": PILOT * count}]
    variance, energies = np.zeros(count), np.zeros(count)
    chosen = np.ones(count, bool)
    while True:
        new = State(*(array[chosen] for array in state))
        variance[chosen] = np.sum(standard_error(new, new.quarters, bands).astype(np.float64) ** 2, axis=1)
        energies[chosen] = np.sum(new.quarters.mean(1).astype(np.float64) ** 2, axis=1)
        energy = float(energies.sum())
        budget = (CAUTION * error) ** 2 * energy
        if variance.sum() <= budget or energy == 0:  # no ray is free: zero is the formula
            break
        chosen, expected = choose_doublings(state.rays, variance, smooth, budget)
        chosen &= state.rays < MOST_RAYS
        if not chosen.any():
            break
        if progress:
            progress(int(state.rays.sum()), int(expected))
        rounds.append({"vertices": int(chosen.sum()), "rays": int(state.rays[chosen].sum())})
        double_rays(state, chosen, rows, bands, visible)
    if progress:
        progress(int(state.rays.sum()), int(state.rays.sum()))
    estimated = float(np.sqrt(variance.sum() / energy)) if energy > 0 else 0.0
    return state, {"rounds": rounds, "estimated_error": estimated, "modelled": free_and_dark(state.share)}
