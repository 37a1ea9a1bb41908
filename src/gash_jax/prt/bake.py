"""Bake the transfer of a mesh with a given number of rays: the plain bake, and the default bake with error bars.

Rays of all vertices are cut into chunks of about `RAYS_PER_CHUNK`, small enough for the level-2 cache, and worked
off by Python threads: directions (JAX) -> visibility (Embree, GIL released) -> coefficients (JAX).
Each vertex's random shift is drawn up front from the seed, so the result does not depend on threads or chunks.

With `replicates` R > 1 the rays of a vertex are split into R independently shifted point sets of N/R, each estimate
blended with the closed form by the share p of the N rays that are free (`sampling`); the result is their mean and
its standard error sd / sqrt(R), to be read with Student's t at R - 1 degrees of freedom. Replicates can agree by
chance, all rays or their count, yet one ray in 2N could have fallen the other way, which moves a coefficient of
band l by sqrt((2l+1)/4pi) / 2N in rms over directions. That is the floor of the standard error where all N rays of a
vertex agree, and of t_00, which is a count of rays, everywhere; elsewhere it is a fifth of it.

One rotation (R = 1) is the plain bake, mean of V Y without blending: the yardstick that anyone can rebuild.
"""

import itertools
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.sh import band_index, validate_bands
from gash_jax.files.cores import available_cores
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.rays import TraceGeometry, VisibilityFn, trace_geometry
from gash_jax.prt.sampling import integrate_rays, sample_rays, to_world
from gash_jax.prt.transfer import Transfer, make_metadata
from gash_jax.prt.visibility import visibility

RAYS_PER_CHUNK = 1 << 17
MAX_RAYS = 1 << 20

ProgressFn = Callable[[int, int], None]


def choose_replicates(rays: int, replicates: int | None) -> int:
    """4 unless told otherwise; fewer than 16 rays are not worth splitting. Raises ValueError on what does not fit."""
    if not 1 <= rays <= MAX_RAYS:
        raise ValueError(f"rays must be from 1 to {MAX_RAYS}, not {rays}")
    count = (4 if rays >= 16 else 1) if replicates is None else replicates
    if not 1 <= count <= rays:
        raise ValueError(f"replicates must be from 1 to rays ({rays}), not {count}")
    if rays % count:
        lower = rays // count * count
        raise ValueError(f"rays ({rays}) must be a multiple of replicates ({count}): use {lower} or {lower + count}")
    return count


def standard_error_floor(bands: int, rays: np.ndarray | int, share: Float[np.ndarray, "a"]) -> Float[np.ndarray, "a k"]:
    """Smallest standard error that N rays of which `share` are free can claim (module docstring)."""
    band = band_index(bands)
    one_ray = np.sqrt((2 * band + 1) / (4 * np.pi)) / 2
    agree = (share == 0) | (share == 1)
    part = np.where(agree[:, None] | (band == 0)[None], 1.0, 0.2)
    return (part * one_ray[None] / np.broadcast_to(rays, share.shape)[:, None]).astype(np.float32)


class Rows(NamedTuple):
    """Vertices to trace: where their rays start, their frames, and r shifts of the point set for each."""

    origins: Float[np.ndarray, "a 3"]
    frames: Float[np.ndarray, "a 3 3"]
    shifts: Float[np.ndarray, "a r 2"]

    def take(self, index: np.ndarray) -> "Rows":
        """Some of the vertices, in this order."""
        return Rows(self.origins[index], self.frames[index], self.shifts[index])


def trace_rows(
    rows: Rows,
    share: Float[np.ndarray, "a"] | None,
    n: int,
    bands: int,
    visible: VisibilityFn,
    progress: ProgressFn | None = None,
    lattice: str = "hammersley",
) -> tuple[Float[np.ndarray, "a r k"], Float[np.ndarray, "a"]]:
    """Coefficients of every row in the frame of its vertex, n rays each, and the share of each vertex's free rays.

    `share` is the p that blends in the closed form; None takes each vertex's own.
    """
    count, rotations = rows.shifts.shape[:2]
    # a power of two, so that meshes of many sizes share few compiled kernels
    chunk = 1 << max(0, min((RAYS_PER_CHUNK // (rotations * n)).bit_length() - 1, (count - 1).bit_length()))
    starts = range(0, count, chunk)
    result, found = np.empty((count, rotations, bands**2), np.float32), np.empty(count, np.float32)
    ticket, lock, done, failed = itertools.count(), threading.Lock(), 0, threading.Event()

    def work() -> None:
        nonlocal done
        while not failed.is_set():
            with lock:
                number = next(ticket)
            if number >= len(starts):
                return
            # the last chunk is filled up with its own last vertex: one shape, one compilation
            part = slice(starts[number], min(starts[number] + chunk, count))
            index = np.minimum(np.arange(part.start, part.start + chunk), count - 1)
            try:
                some = rows.take(index)
                rays = sample_rays(*some, n, lattice)
                free = visible(np.asarray(rays[0]), np.asarray(rays[1])).reshape(chunk, rotations, n)
                own = np.count_nonzero(free, axis=(1, 2)).astype(np.float32) / np.float32(rotations * n)
                local = integrate_rays(free, own if share is None else share[index], some.shifts, bands, lattice)
                result[part] = np.asarray(local)[: part.stop - part.start]
                found[part] = own[: part.stop - part.start]
            except BaseException:
                failed.set()
                raise
            with lock:
                done += part.stop - part.start
                if progress:
                    progress(done, count)

    threads = min(available_cores() + 1, len(starts))  # one more than cores fills the gaps between kernels
    with ThreadPoolExecutor(threads) as pool:
        futures = [pool.submit(work) for _ in range(threads)]
        try:
            for future in futures:
                future.result()
        except BaseException:
            failed.set()
            raise
    return result, found


def active_rows(
    mesh: Mesh, geometry: TraceGeometry, frames: Float[np.ndarray, "v 3 3"] | None, shifts: np.ndarray
) -> tuple[np.ndarray, Rows]:
    """Indices of the vertices that have a normal, and their rows; `shifts` (v, r, 2) counts all vertices."""
    if frames is not None and frames.shape != (len(mesh.vertices), 3, 3):
        raise ValueError(f"frames have shape {frames.shape}, not ({len(mesh.vertices)}, 3, 3): one frame per vertex")
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    chosen = np.asarray(orthonormal_frame(mesh.normals[active])) if frames is None else frames[active]
    return active, Rows(geometry.origins[active], chosen.astype(np.float32), shifts[active])


def bake_transfer(
    mesh: Mesh,
    bands: int = 3,
    rays: int = 256,
    *,
    replicates: int | None = None,
    seed: int = 0,
    backend: str = "embree",
    frames: Float[np.ndarray, "v 3 3"] | None = None,
    progress: ProgressFn | None = None,
) -> Transfer:
    """Bake shadowed diffuse transfer with `rays` rays per vertex.

    `replicates=1` is the plain bake (one rotation, no blending, no standard error); `None` means 4, or 1 below 16
    rays. `frames` (columns tangent, bitangent, normal; in place of a choice by the normal alone) carries the rays
    along with a mesh that is turned. `progress(done, total)` is called with counts of vertices, from worker threads.
    Vertices without a usable normal get transfer 0. Raises ValueError for options out of range.
    """
    validate_bands(bands)
    count = choose_replicates(rays, replicates)
    started = time.perf_counter()
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces, backend)
    built = time.perf_counter()
    shifts = np.random.default_rng(seed).random((len(mesh.vertices), count, 2), np.float32)
    active, rows = active_rows(mesh, geometry, frames, shifts)
    coefficients = np.zeros((len(mesh.vertices), bands**2), np.float32)
    error = np.zeros_like(coefficients) if count > 1 else None
    free = dark = 0.0
    if len(active):
        plain = np.zeros(len(active), np.float32) if count == 1 else None
        local, share = trace_rows(rows, plain, rays // count, bands, visible, progress)
        replicas = np.asarray(to_world(local, rows.frames))
        coefficients[active] = replicas.mean(1)
        free, dark = float(np.mean(share == 1)), float(np.mean(share == 0))
        if error is not None:
            difference = replicas - coefficients[active][:, None]
            variance = np.einsum("ark,ark->ak", difference, difference) / np.float32(count * (count - 1))
            error[active] = np.maximum(np.sqrt(variance), standard_error_floor(bands, rays, share))
    finished = time.perf_counter()
    metadata = make_metadata(
        bands,
        "bake",
        {"rays": rays, "replicates": count, "seed": seed, "backend": backend},
        rays_total=rays * len(active),
        modelled={"all_rays_free": free, "no_ray_free": dark, "blended_with_closed_form": count > 1},
        ray_offset=geometry.offset,
        seconds={"build": built - started, "trace": finished - built, "total": finished - started},
    )
    return Transfer(coefficients, error, mesh.vertices, mesh.normals, mesh.faces, metadata)
