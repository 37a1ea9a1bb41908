"""Bake the transfer of a mesh with a given number of rays: the plain bake, and the default bake with error bars.

One rotation of the point set (R = 1) is the plain bake, mean of V Y without blending: the yardstick that anyone can
rebuild.

With `replicates` R > 1 the N rays of a vertex are split into R independently shifted point sets of N/R. Each gives an
estimate, blended with the closed form by the share p of the N rays that are free (`integrands`); the result is their
mean, its standard error their standard deviation / sqrt(R), to be read with Student's t at R - 1 degrees of freedom.

Replicates may agree by chance, all rays or their count, and would then claim an error of 0. But no vertex is known to
better than half a ray, and a ray weighs at most sqrt((2l+1)/4pi) / N in band l, the bound of its harmonics. Half of
that is the floor of the standard error of a vertex whose N rays all agree, and of t_00, which does nothing but count
free rays, everywhere; of all other coefficients the floor is a fifth of it.

A glossy bake (`glossy`) traces as many rays again for the visibility, uniform and with shifts of their own, so that the
diffuse coefficients are what they are without it. Their estimates and errors are formed in the same way; a ray weighs
2 pi times as much.
"""

import operator
import time

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import WholeNumber, shown, whole_number
from gash_jax.algebra.sh import band_index, bands_of, validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.prt.glossy import RAY_WEIGHT, visibility_entries, visibility_sums
from gash_jax.prt.integrands import direct, to_world
from gash_jax.prt.rays import RayQuery, trace_geometry
from gash_jax.prt.tracing import ProgressFn, Rows, active_rows, trace_rows
from gash_jax.prt.transfer import Transfer, make_metadata
from gash_jax.prt.visibility import ray_query

MAX_RAYS = 1 << 20


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


def standard_error_floor(
    bands: int, rays: np.ndarray | int, share: Float[np.ndarray, "a"], weight: float = 1.0
) -> Float[np.ndarray, "a k"]:
    """Smallest standard error that N rays of which `share` are free can claim (module docstring).

    `weight` is the most that a ray weighs, times N.
    """
    band = band_index(bands)
    one_ray = weight * np.sqrt((2 * band + 1) / (4 * np.pi)) / 2
    agree = (share == 0) | (share == 1)
    part = np.where(agree[:, None] | (band == 0)[None], 1.0, 0.2)
    return (part * one_ray[None] / np.broadcast_to(rays, share.shape)[:, None]).astype(np.float32)


def free_and_dark(share: Float[np.ndarray, "a"]) -> dict[str, float]:
    """Share of the vertices that stayed with a formula: those with all rays free, and those with none; for metadata."""
    count = max(len(share), 1)
    return {"all_rays_free": float(np.sum(share == 1)) / count, "no_ray_free": float(np.sum(share == 0)) / count}


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


def replicate_error(
    replicas: Float[np.ndarray, "a r k"], mean: Float[np.ndarray, "a k"], rays: int, share: Float[np.ndarray, "a"]
) -> Float[np.ndarray, "a k"]:
    """Standard error of the mean of r > 1 replicates, not below the floor."""
    count, difference = replicas.shape[1], replicas - mean[:, None]
    variance = np.einsum("ark,ark->ak", difference, difference) / np.float32(count * (count - 1))
    return np.maximum(np.sqrt(variance), standard_error_floor(bands_of(mean.shape[1]), rays, share))


def bake_visibility(
    rows: Rows, bands: int, rays: int, query: RayQuery, part: slice = slice(None), progress: ProgressFn | None = None
) -> tuple[Float[np.ndarray, "a j"], Float[np.ndarray, "a j"] | None]:
    """Visibility of the rows `part` in 2 bands - 1 bands, N = `rays` uniform rays in all, and its standard error.

    One replicate is the plain mean, without an error.
    """
    total, count = rows.shifts.shape[:2]
    if not len(range(total)[part]):
        nothing = np.zeros((0, (2 * bands - 1) ** 2), np.float32)
        return nothing, nothing if count > 1 else None
    plain, integrand = np.zeros(total, np.float32) if count == 1 else None, visibility_sums(bands)
    sums, share = trace_rows(rows, integrand, rays // count, query, share=plain, part=part, progress=progress)
    mean, scatter = np.moveaxis(sums[part], 1, 0)
    if count == 1:
        return mean, None
    return mean, np.maximum(scatter, standard_error_floor(2 * bands - 1, rays, share[part], RAY_WEIGHT))


def _stage(progress: ProgressFn | None, index: int, stages: int) -> ProgressFn | None:
    """The progress of one of several equal stages."""
    return progress and (lambda done, total: progress(index * total + done, stages * total))


def _range_of(rows: slice | None, count: int) -> tuple[int, int]:
    try:
        first, last, step = slice(None).indices(count) if rows is None else rows.indices(count)
    except (AttributeError, TypeError):  # no slice, or not of whole numbers
        first = last = step = 0
    if step != 1 or first >= last:
        raise ValueError(f"rows {shown(rows)} are no consecutive vertices of a mesh of {count}: use slice(first, last)")
    return first, last


def bake_transfer(
    mesh: MeshLike,
    bands: WholeNumber = 3,
    rays: WholeNumber = 256,
    *,
    replicates: WholeNumber | None = None,
    seed: WholeNumber = 0,
    backend: str = "embree",
    frames: Float[np.ndarray, "v 3 3"] | None = None,
    rows: slice | None = None,
    glossy: bool = False,
    progress: ProgressFn | None = None,
) -> Transfer:
    """Bake shadowed diffuse transfer with `rays` rays per vertex.

    `mesh` is a path, arrays (vertices, faces[, normals]), a trimesh or a `Mesh`. `replicates=1` is the plain bake (one
    rotation, no blending, no standard error); `None` means 4, or 1 below 16 rays. `frames` (columns tangent, bitangent,
    normal; in place of a choice by the normal alone) carries the rays along with a mesh that is turned.
    `rows=slice(a, b)` bakes vertices a .. b - 1 alone, in the shadow of the whole mesh, and returns them as points
    without faces: to the last bit those of the whole bake. `glossy` traces as many rays again for the `visibility` of
    which `glossy_matrices` and `shade` with a lobe make glossy transfer, in float16, its errors in `metadata`.
    `progress(done, total)` is called with counts of vertices, from worker threads. Vertices without a usable normal get
    transfer 0. Raises ValueError for options out of range, MeshError for what is no mesh.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", bands=3, rays=64)
    >>> transfer.coefficients.shape, transfer.standard_error.shape
    ((362, 9), (362, 9))
    """
    mesh, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    integrand, count, rays = direct(bands), choose_replicates(rays, replicates), operator.index(rays)
    first, last = _range_of(rows, len(mesh.vertices))
    started = time.perf_counter()
    geometry = trace_geometry(mesh)
    query = ray_query(geometry.vertices, geometry.faces, integrand.query, backend)
    built = time.perf_counter()
    shifts = draw_shifts(seed, len(mesh.vertices), count, first, last)
    active, all_rows = active_rows(mesh, geometry, frames, shifts)
    part = slice(*np.searchsorted(active, [first, last]).tolist())
    own, share = active[part] - first, np.zeros(0, np.float32)
    coefficients = np.zeros((last - first, bands**2), np.float32)
    error = np.zeros_like(coefficients) if count > 1 else None
    if len(own):
        plain = np.zeros(len(active), np.float32) if count == 1 else None
        update = _stage(progress, 0, 1 + glossy)
        local, share = trace_rows(all_rows, integrand, rays // count, query, share=plain, part=part, progress=update)
        # the turn into the world, too, has the shape of the whole mesh, on which its last bits depend
        replicas, share = np.asarray(to_world(local, all_rows.frames))[part], share[part]
        coefficients[own] = mean = replicas.mean(1)
        if error is not None:
            error[own] = replicate_error(replicas, mean, rays, share)
    visibility, entries = None, {}
    if glossy:
        others = draw_shifts(np.random.SeedSequence(seed, spawn_key=(1,)), len(mesh.vertices), count, first, last)
        uniform = all_rows._replace(shifts=others[active])
        found, found_error = bake_visibility(uniform, bands, rays, query, part, _stage(progress, 1, 2))
        visibility = np.zeros((last - first, found.shape[1]), np.float16)
        visibility[own] = found
        entries = {"visibility": visibility_entries(found, found_error)}
    seconds = {"build": built - started, "trace": time.perf_counter() - built, "total": time.perf_counter() - started}
    parameters = {"rays": rays, "replicates": count, "seed": seed, "backend": backend}
    metadata = make_metadata(
        bands,
        "bake",
        parameters if rows is None else {**parameters, "rows": [first, last]},
        rays_total=rays * len(own) * (1 + glossy),
        modelled={**free_and_dark(share), "blended_with_closed_form": count > 1},
        ray_offset=geometry.offset,
        seconds=seconds,
        **entries,
    )
    faces = mesh.faces if rows is None else mesh.faces[:0]
    surface = (mesh.vertices[first:last], mesh.normals[first:last], faces)
    return Transfer(coefficients, error, *surface, metadata, visibility=visibility)
