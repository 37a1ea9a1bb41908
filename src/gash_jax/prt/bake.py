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
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import WholeNumber, shown, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.prt.bounces import MOST_BOUNCES, Estimate, bounced_transfer, checked_albedo, describe_albedo
from gash_jax.prt.error_bars import replicate_error
from gash_jax.prt.glossy import Reflected, bake_gloss, gloss_entries
from gash_jax.prt.integrands import direct, to_world
from gash_jax.prt.rays import RayQuery
from gash_jax.prt.reflection import reflector
from gash_jax.prt.scene import as_occluders, as_points, frames_of_all, make_scene
from gash_jax.prt.tracing import Integrand, ProgressFn, Rows, active_rows, trace_rows
from gash_jax.prt.transfer import Transfer, make_metadata
from gash_jax.prt.visibility import ray_query

if TYPE_CHECKING:
    from jax import Array

    from gash_jax.algebra.arguments import ArrayLike

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
    glossy transfer, in float16, its errors in `metadata`; with bounces, off grey surfaces, for `matrices` in its place.

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
    first, last = _range_of(rows, len((receivers or mesh).vertices))
    started = time.perf_counter()
    scene = make_scene(mesh, receivers, blockers)
    colours = checked_albedo(1 if albedo is None and not bounces else albedo, len(scene.surface.vertices))
    if glossy and bounces and colours.shape[1] == 3:
        raise ValueError(
            "glossy transfer has no room for coloured reflections: give a grey albedo, one number a vertex"
        )
    scene = scene if bounces else scene.receivers_alone()  # light that bounces comes from all surfaces
    query = ray_query(*scene.geometry[:2], "closest" if bounces else "any", backend)
    built = time.perf_counter()
    wanted = slice(scene.receivers.start + first, scene.receivers.start + last)
    drawn = slice(0, len(scene.starts.vertices)) if bounces else wanted
    shifts = draw_shifts(seed, len(scene.starts.vertices), count, drawn.start, drawn.stop)
    active, all_rows = active_rows(scene.starts, scene.geometry, frames_of_all(frames, scene), shifts)
    part = slice(*np.searchsorted(active, [wanted.start, wanted.stop]).tolist())
    shape = (bands**2, 3) if bounces and colours.shape[1] == 3 else (bands**2,)
    estimate = Estimate(np.zeros((0, count, *shape), np.float32), np.zeros(0, np.float32), {})
    if part.start < part.stop:
        trace = partial(_direct_light, part=part)
        if bounces:
            trace = partial(bounced_transfer, active=active, surface=scene.surface, albedo=colours, bounces=bounces)
        plain = np.zeros(len(active), np.float32) if count == 1 else None
        update = _stage(progress, 0, 1 + glossy)
        estimate = trace(all_rows, direct(bands), rays // count, query, share=plain, progress=update)
    own, replicas, share = active[part] - wanted.start, estimate.replicas[part], estimate.share[part]
    coefficients = np.zeros((last - first, *shape), np.float32)
    error = np.zeros_like(coefficients) if count > 1 else None
    coefficients[own] = mean = replicas.mean(1)
    if error is not None:
        error[own] = replicate_error(replicas, mean, rays, share)
    name = "matrices" if bounces else "visibility"
    gloss = np.zeros((last - first, *((bands**2,) * 2 if bounces else ((2 * bands - 1) ** 2,))), np.float16)
    told = dict(estimate.told)
    if glossy and len(own):
        others = draw_shifts(np.random.SeedSequence(seed, spawn_key=(1,)), len(shifts), count, drawn.start, drawn.stop)
        reflected = None if estimate.sent is None else Reflected(reflector(scene.surface), estimate.sent)
        uniform = all_rows._replace(shifts=others[active])
        found, found_error = bake_gloss(uniform, bands, rays, query, part, reflected, _stage(progress, 1, 2))
        gloss[own] = found.reshape(-1, *gloss.shape[1:])
        told[name] = gloss_entries(found, found_error)
    seconds = {"build": built - started, "trace": time.perf_counter() - built, "total": time.perf_counter() - started}
    asked = {"rows": None if rows is None else [first, last], "occluders": len(blockers) or None}
    asked |= {"bounces": bounces, "albedo": describe_albedo(albedo)} if bounces else {}
    parameters = {"rays": rays, "replicates": count, "seed": seed, "backend": backend}
    parameters |= {name: value for name, value in asked.items() if value is not None}
    metadata = make_metadata(
        bands,
        "bake",
        parameters,
        rays_total=rays * ((len(active) if bounces else len(own)) + glossy * len(own)),
        modelled={**free_and_dark(share), "blended_with_closed_form": count > 1},
        ray_offset=scene.geometry.offset,
        seconds=seconds,
        **told,
    )
    vertices, normals = (array[wanted] for array in scene.starts[:2])
    faces = mesh.faces if rows is None and receivers is None else mesh.faces[:0]
    held = {name: gloss} if glossy else {}
    return Transfer(coefficients, error, vertices, normals, faces, metadata, **held)


def _direct_light(
    rows: Rows,
    integrand: Integrand,
    n: int,
    query: RayQuery,
    *,
    part: slice,
    share: Float[np.ndarray, "a"] | None,
    progress: ProgressFn | None,
) -> Estimate:
    """Replicates of the direct transfer of some rows; zeros for the others."""
    local, free = trace_rows(rows, integrand, n, query, share=share, part=part, progress=progress)
    # the turn into the world, too, has the shape of the whole mesh, on which its last bits depend
    return Estimate(np.asarray(to_world(local, rows.frames)), free, {})
