"""Bakes that exist to be compared with: pseudo-random rays, and the plain bake by other programs' ray tracers.

Another tracer gets our rays and our integration, so its error is the plain bake's, and only its seconds are its own.
"""

import time
from collections.abc import Callable

import numpy as np

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.apps.frontier.tracers import TRACERS
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.frontier import Outcome
from gash_jax.prt.bake_job import make_job
from gash_jax.prt.integrands import direct, integrate_rays, to_world
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.scene import make_scene
from gash_jax.prt.tracing import trace_rows
from gash_jax.prt.visibility import ray_query

VERTICES_AT_ONCE = 1 << 14


class Unavailable(Exception):
    """A method cannot be run here; the message says why, and what to do about it."""


def pseudo_random_bake(mesh: Mesh, bands: int, rays: int, seed: int) -> Outcome:
    """The mean of V Y over directions drawn one by one, cosine-weighted: every ray a point set with its own shift."""
    started = time.perf_counter()
    scene = make_scene(mesh)
    query = ray_query(*scene.geometry[:2], "any")
    built = time.perf_counter() - started
    job = make_job(scene, query, rays, rays, seed, part=(0, len(mesh.vertices)))
    coefficients = np.zeros((len(mesh.vertices), bands**2), np.float32)
    if len(job.active):
        share = np.zeros(len(job.active), np.float32)
        local, _ = trace_rows(job.rows, direct(bands), 1, query, share=share)
        coefficients[job.active] = np.asarray(to_world(local.mean(1, keepdims=True), job.rows.frames))[:, 0]
    return Outcome(coefficients, built, float(rays))


def peer_bake(name: str, mesh: Mesh, bands: int, rays: int) -> Callable[[int], Outcome]:
    """The plain bake by the tracer of that name, in batches as large as those libraries like.

    Raises Unavailable where it is not installed.
    """
    try:
        build = TRACERS[name]()
    except (ImportError, OSError, RuntimeError) as reason:
        raise Unavailable(f"{' '.join(str(reason).split())}: pip install 'gash-jax[peers]'") from None

    def run(seed: int) -> Outcome:
        started = time.perf_counter()
        geometry = trace_geometry(mesh)
        free = build(geometry.vertices, geometry.faces)
        built = time.perf_counter() - started
        shifts = np.random.default_rng(seed).random((len(mesh.vertices), 1, 2), np.float32)
        active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
        frames = np.asarray(orthonormal_frame(mesh.normals))
        coefficients = np.zeros((len(mesh.vertices), bands**2), np.float32)
        for start in range(0, len(active), VERTICES_AT_ONCE):
            some = active[start : start + VERTICES_AT_ONCE]
            traced = sample_rays(geometry.origins[some], frames[some], shifts[some], rays)
            seen = free(*(np.asarray(array) for array in traced)).reshape(len(some), 1, rays)
            local = integrate_rays(seen, np.zeros(len(some), np.float32), shifts[some], bands)
            coefficients[some] = np.asarray(to_world(local, frames[some]))[:, 0]
        return Outcome(coefficients, built, float(rays))

    return run
