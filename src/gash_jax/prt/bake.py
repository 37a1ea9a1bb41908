"""Bake the transfer of a mesh with a given number of rays: the plain bake, and the default bake with error bars.

One rotation of the point set (R = 1) is the plain bake, mean of V Y without blending: the yardstick that anyone can
rebuild.

With `replicates` R > 1 the N rays of a vertex are split into R independently shifted point sets of N/R. Each gives an
estimate, blended with the closed form by the share p of the N rays that are free (`integrands`); the result is their
mean, its standard error their standard deviation / sqrt(R), to be read with Student's t at R - 1 degrees of freedom
(`error_bars`).

A glossy bake (`glossy`) traces as many rays again for the visibility, uniform and with shifts of their own, so that the
diffuse coefficients are what they are without it. Its estimates and errors are formed in the same way.
"""

import operator
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.prt.bake_job import Job, choose_replicates, make_job, range_of
from gash_jax.prt.bounces import MOST_BOUNCES, Estimate, Exchange, checked_albedo, describe_albedo
from gash_jax.prt.error_bars import replicate_error
from gash_jax.prt.glossy import bake_gloss, check_reflections, gloss_entries
from gash_jax.prt.integrands import direct, to_world
from gash_jax.prt.reflection import Reflected
from gash_jax.prt.scene import as_occluders, as_points, make_scene
from gash_jax.prt.tracing import ProgressFn, trace_rows
from gash_jax.prt.transfer import Transfer, make_metadata
from gash_jax.prt.visibility import ray_query

if TYPE_CHECKING:
    from jax import Array

    from gash_jax.algebra.arguments import ArrayLike


def free_and_dark(share: Float[np.ndarray, "a"]) -> dict[str, float]:
    """Share of the vertices that stayed with a formula: those with all rays free, and those with none; for metadata."""
    count = max(len(share), 1)
    return {"all_rays_free": float(np.sum(share == 1)) / count, "no_ray_free": float(np.sum(share == 0)) / count}


def bake_transfer(
    mesh: MeshLike,
    bands: WholeNumber = 3,
    rays: WholeNumber = 256,
    *,
    bounces: WholeNumber = 0,
    albedo: "ArrayLike | Array | None" = None,
    points: "ArrayLike | Array | None" = None,
    normals: "ArrayLike | Array | None" = None,
    occluders: Sequence[MeshLike] = (),
    replicates: WholeNumber | None = None,
    seed: WholeNumber = 0,
    backend: str = "embree",
    frames: Float[np.ndarray, "v 3 3"] | None = None,
    rows: slice | None = None,
    glossy: bool = False,
    progress: ProgressFn | None = None,
) -> Transfer:
    """Bake shadowed diffuse transfer with `rays` rays per vertex, with light that bounces up to `bounces` times.

    `mesh` is a path, arrays (vertices, faces[, normals]), a trimesh or a `Mesh`. `replicates=1` is the plain bake (one
    rotation, no blending, no standard error); `None` means 4, or 1 below 16 rays. `frames` (columns tangent, bitangent,
    normal; in place of a choice by the normal alone) carries the rays along with a mesh that is turned.
    `rows=slice(a, b)` bakes vertices a .. b - 1 alone, in the shadow of the whole mesh, and returns them as points
    without faces: to the last bit those of the whole bake. `progress(done, total)` is called with counts of vertices,
    from worker threads. Vertices without a usable normal get transfer 0. Raises ValueError for options out of range,
    MeshError for what is no mesh.

    `glossy` traces as many rays again for the `visibility` of which `glossy_matrices` and `shade` with a lobe make
    glossy transfer, in float16, with its standard error; with bounces, off grey surfaces, for `matrices` in its place,
    their error in `metadata`.

    `points` (p, 3) with unit `normals` (p, 3), 0 where a point has none, receive light in place of the mesh's vertices.
    `occluders`, a list of meshes, cast shadows and bounce light, and get no coefficients. `albedo` is a number, a
    colour (3,), or one of these for every vertex of the mesh and then of the occluders; colours give coefficients
    (v, k, 3).
    What bounces mean is in `prt.bounces`; with them `rows` saves nothing, as light comes from everywhere.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", bands=3, rays=64)
    >>> transfer.coefficients.shape, transfer.standard_error.shape
    ((362, 9), (362, 9))
    >>> gash_jax.bake_transfer("bunny.ply", rays=64, bounces=2, albedo=[0.8, 0.5, 0.3]).coefficients.shape
    (362, 9, 3)
    """
    mesh, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    count, rays = choose_replicates(rays, replicates), operator.index(rays)
    bounces = whole_number(bounces, "bounces", 0, MOST_BOUNCES)
    receivers, blockers = as_points(points, normals), as_occluders(occluders)
    part = range_of(rows, len((receivers or mesh).vertices))
    started = time.perf_counter()
    scene = make_scene(mesh, receivers, blockers)
    colours = checked_albedo(1 if albedo is None and not bounces else albedo, len(scene.surface.vertices))
    check_reflections(glossy, coloured=bounces > 0 and colours.shape[1] == 3)
    scene = scene if bounces else scene.receivers_alone()  # light that bounces comes from all surfaces
    query = ray_query(*scene.geometry[:2], "closest" if bounces else "any", backend)
    built = time.perf_counter()
    job = make_job(scene, query, rays, count, seed, frames=frames, part=part, everywhere=bounces > 0)
    estimate = _estimate(job, bands, colours, bounces, _stage(progress, 0, 1 + glossy))
    held = _averages(job, estimate)
    told = dict(estimate.told)
    if glossy:
        gloss, entries = _gloss(job, bands, bounces > 0, estimate.reflected, _stage(progress, 1, 2))
        held, told = held | gloss, told | entries
    seconds = {"build": built - started, "trace": time.perf_counter() - built, "total": time.perf_counter() - started}
    asked = {"rows": None if rows is None else list(part), "occluders": len(blockers) or None}
    asked |= {"bounces": bounces, "albedo": describe_albedo(albedo)} if bounces else {}
    parameters = {"rays": rays, "replicates": count, "seed": seed, "backend": backend}
    parameters |= {name: value for name, value in asked.items() if value is not None}
    metadata = make_metadata(
        bands,
        "bake",
        parameters,
        rays_total=rays * ((len(job.active) if bounces else len(job.own)) + glossy * len(job.own)),
        modelled={**free_and_dark(estimate.share[job.part]), "blended_with_closed_form": count > 1},
        ray_offset=scene.geometry.offset,
        seconds=seconds,
        **told,
    )
    vertices, normals = (array[job.wanted] for array in scene.starts[:2])
    faces = mesh.faces if rows is None and receivers is None else mesh.faces[:0]
    return Transfer(vertices=vertices, normals=normals, faces=faces, metadata=metadata, **held)


def _stage(progress: ProgressFn | None, index: int, stages: int) -> ProgressFn | None:
    """The progress of one of several equal stages."""
    return progress and (lambda done, total: progress(index * total + done, stages * total))


def _estimate(
    job: Job, bands: int, albedo: Float[np.ndarray, "s c"], bounces: int, progress: ProgressFn | None
) -> Estimate:
    """Replicates of the transfer, of the rows that are wanted at least; of none where none of these has a normal."""
    integrand, count = direct(bands), job.replicates
    if job.part.start >= job.part.stop:
        shape = (bands**2, 3) if bounces and albedo.shape[1] == 3 else (bands**2,)
        return Estimate(np.zeros((0, count, *shape), np.float32), np.zeros(0, np.float32), {})
    share = np.zeros(len(job.active), np.float32) if count == 1 else None  # the plain mean
    arguments = (job.rows, integrand, job.rays // count, job.query)
    if bounces:
        update = _stage(progress, 0, bounces + 1)
        exchange = Exchange(*arguments, active=job.active, surface=job.scene.surface, share=share, progress=update)
        return exchange.bounced(albedo, bounces, progress)
    local, free = trace_rows(*arguments, share=share, part=job.part, progress=progress)
    # the turn into the world, too, has the shape of the whole mesh, on which its last bits depend
    return Estimate(np.asarray(to_world(local, job.rows.frames)), free, {})


def _averages(job: Job, estimate: Estimate) -> dict[str, np.ndarray | None]:
    """Coefficients and their standard errors, 0 where there is no normal; of one replicate no errors."""
    replicas = estimate.replicas[job.part]
    coefficients = np.zeros((job.size, *replicas.shape[2:]), np.float32)
    coefficients[job.own] = mean = replicas.mean(1)
    if job.replicates == 1:
        return {"coefficients": coefficients, "standard_error": None}
    error = np.zeros_like(coefficients)
    error[job.own] = replicate_error(replicas, mean, job.rays, estimate.share[job.part])
    return {"coefficients": coefficients, "standard_error": error}


def _gloss(
    job: Job, bands: int, bounced: bool, reflected: Reflected | None, progress: ProgressFn | None
) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Visibility, or matrices of light that bounced as well, in float16 by name, and what metadata says of it."""
    name, shape = ("matrices", (bands**2,) * 2) if bounced else ("visibility", ((2 * bands - 1) ** 2,))
    held, own = {name: np.zeros((job.size, *shape), np.float16)}, job.own
    if job.replicates > 1 and not bounced:
        held["visibility_error"] = np.zeros_like(held[name])
    if not len(own):
        return held, {}
    uniform = job.rows._replace(shifts=job.other_shifts())
    found, error = bake_gloss(uniform, bands, job.rays, job.query, job.part, reflected, progress)
    held[name][own] = found.reshape(-1, *shape)
    if "visibility_error" in held:
        held["visibility_error"][own] = error
    return held, {name: gloss_entries(found, error)}
