"""Bake the transfer of a mesh: the plain bake, and the default bake with replicates and a standard error.

Rays of all vertices are cut into chunks of about `RAYS_PER_CHUNK`, small enough for the level-2 cache, and worked
off by Python threads: directions (JAX) -> visibility (Embree, GIL released) -> coefficients (JAX).
Each vertex's random shift is drawn up front from the seed, so the result does not depend on threads or chunks.

With `replicates` R > 1 the rays of a vertex are split into R independently shifted point sets of N/R; the estimate
is their mean and its standard error sd / sqrt(R), to be read with Student's t at R - 1 degrees of freedom. Where
all replicates agree the error is not zero: one ray in 2N could still have fallen the other way, which moves a
coefficient of band l by sqrt((2l+1)/4pi) / 2N in rms over directions. That is the floor.
"""

import itertools
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.sh import band_index, validate_bands
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.rays import VisibilityFn, trace_geometry
from gash_jax.prt.sampling import integrate_rays, sample_rays
from gash_jax.prt.transfer import Transfer, make_metadata
from gash_jax.prt.visibility import visibility

RAYS_PER_CHUNK = 1 << 17
MAX_RAYS = 1 << 20

ProgressFn = Callable[[int, int], None]


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


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


def standard_error_floor(bands: int, rays: int) -> Float[np.ndarray, "k"]:
    """Smallest standard error that N rays can claim for each coefficient (module docstring)."""
    return (np.sqrt((2 * band_index(bands) + 1) / (4 * np.pi)) / (2 * rays)).astype(np.float32)


def trace_rows(
    normals: Float[np.ndarray, "a 3"],
    origins: Float[np.ndarray, "a 3"],
    shifts: Float[np.ndarray, "a r 2"],
    n: int,
    bands: int,
    visible: VisibilityFn,
    progress: ProgressFn | None,
) -> Float[np.ndarray, "a r k"]:
    """Coefficients of every row (vertex x rotation), n rays each, in the world frame."""
    count, rotations = shifts.shape[:2]
    # a power of two, so that meshes of many sizes share few compiled kernels
    chunk = 1 << max(0, min((RAYS_PER_CHUNK // (rotations * n)).bit_length() - 1, (count - 1).bit_length()))
    starts = range(0, count, chunk)
    result = np.zeros((count, rotations, bands**2), np.float32)
    ticket, lock, done, failed = itertools.count(), threading.Lock(), 0, threading.Event()

    def work() -> None:
        nonlocal done
        while not failed.is_set():
            with lock:
                index = next(ticket)
            if index >= len(starts):
                return
            # the last chunk is filled up with its own last vertex: one shape, one compilation
            rows = np.minimum(np.arange(starts[index], starts[index] + chunk), count - 1)
            part = min(chunk, count - starts[index])
            try:
                rays = sample_rays(origins[rows], normals[rows], shifts[rows], n)
                free = visible(np.asarray(rays[0]), np.asarray(rays[1])).reshape(chunk, rotations, n)
                coefficients = integrate_rays(free, normals[rows], shifts[rows], bands)
                result[starts[index] : starts[index] + part] = np.asarray(coefficients)[:part]
            except BaseException:
                failed.set()
                raise
            with lock:
                done += part
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
    return result


def bake_transfer(
    mesh: Mesh,
    bands: int = 3,
    rays: int = 256,
    *,
    replicates: int | None = None,
    seed: int = 0,
    backend: str = "embree",
    progress: ProgressFn | None = None,
) -> Transfer:
    """Bake shadowed diffuse transfer with `rays` rays per vertex.

    `replicates=1` is the plain bake (one rotation, no standard error); `None` means 4, or 1 below 16 rays.
    `progress(done, total)` is called with counts of vertices, from worker threads. Vertices without a usable
    normal get transfer 0. Raises ValueError for options out of range.
    """
    validate_bands(bands)
    count = choose_replicates(rays, replicates)
    started = time.perf_counter()
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces, backend)
    built = time.perf_counter()
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    shifts = np.random.default_rng(seed).random((len(mesh.vertices), count, 2), np.float32)[active]
    normals, origins = mesh.normals[active], geometry.origins[active]
    coefficients = np.zeros((len(mesh.vertices), bands**2), np.float32)
    error = np.zeros_like(coefficients) if count > 1 else None
    if len(active):
        rows = trace_rows(normals, origins, shifts, rays // count, bands, visible, progress)
        coefficients[active] = rows.mean(1)
        if error is not None:
            difference = rows - coefficients[active][:, None]
            variance = np.einsum("ark,ark->ak", difference, difference) / np.float32(count * (count - 1))
            error[active] = np.maximum(np.sqrt(variance), standard_error_floor(bands, rays))
    finished = time.perf_counter()
    metadata = make_metadata(
        bands,
        "bake",
        {"rays": rays, "replicates": count, "seed": seed, "backend": backend},
        rays_total=rays * len(active),
        ray_offset=geometry.offset,
        seconds={"build": built - started, "trace": finished - built, "total": finished - started},
    )
    return Transfer(coefficients, error, mesh.vertices, mesh.normals, mesh.faces, metadata)
