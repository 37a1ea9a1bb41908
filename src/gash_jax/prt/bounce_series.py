"""Transfer bounce by bounce: what each bounce adds off white surfaces, from which any grey albedo follows.

With D and W of `bounces`, the transfer with n bounces off surfaces of one grey albedo a is a polynomial in it,

    t^n = sum_i a^i W^i D,    i = 0 .. n,

so one bake of the terms W^i D serves all of them. All are plain means of rays, without the blend with the closed form
that a bake of several replicates has: the labels of a network should be right on average for every vertex.
"""

import operator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.algebra.sh import band_index, validate_bands
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.bake_job import Job, choose_replicates, make_job
from gash_jax.prt.bounces import MOST_BOUNCES, Exchange
from gash_jax.prt.integrands import direct, to_world
from gash_jax.prt.scene import make_scene
from gash_jax.prt.tracing import trace_rows
from gash_jax.prt.visibility import ray_query


class Series(NamedTuple):
    """Terms of the transfer, and how far the first of them is known."""

    terms: Float[np.ndarray, "i v k"]  # the direct transfer, and what each bounce adds off white surfaces
    # squared standard error of the first term, the mean over the coefficients of a band; None of one replicate
    spread: Float[np.ndarray, "v b"] | None


def bake_series(
    mesh: Mesh,
    bands: WholeNumber,
    rays: WholeNumber,
    bounces: WholeNumber,
    *,
    seed: WholeNumber = 0,
    replicates: WholeNumber = 2,
    backend: str = "embree",
) -> Series:
    """Direct transfer and what each of `bounces` bounces adds off white surfaces, with `rays` rays a vertex in all.

    Vertices without a normal get 0. The spread of two replicates is a noisy estimate, to be averaged over vertices.
    Raises ValueError for options out of range.
    """
    bands, seed = validate_bands(bands), whole_number(seed, "seed", 0)
    count, rays = choose_replicates(rays, replicates), operator.index(rays)
    bounces = whole_number(bounces, "bounces", 0, MOST_BOUNCES)
    scene = make_scene(mesh)
    query = ray_query(*scene.geometry[:2], "closest" if bounces else "any", backend)
    job = make_job(scene, query, rays, count, seed, part=(0, len(mesh.vertices)), everywhere=True)
    terms = np.zeros((bounces + 1, job.size, bands**2), np.float32)
    spread = np.zeros((job.size, bands), np.float32) if count > 1 else None
    if len(job.active):
        replicas = _replicas(job, bands, bounces)
        terms[:, job.active] = replicas.mean(2)
        if spread is not None:
            squared = replicas[0].var(axis=1, ddof=1) / count
            band = band_index(bands)
            spread[job.active] = np.stack([squared[:, band == order].mean(1) for order in range(bands)], 1)
    return Series(terms, spread)


def _replicas(job: Job, bands: int, bounces: int) -> Float[np.ndarray, "i a r k"]:
    """Every term of every replicate, of the vertices that have a normal."""
    arguments = (job.rows, direct(bands), job.rays // job.replicates, job.query)
    plain = np.zeros(len(job.active), np.float32)
    if not bounces:
        local, _ = trace_rows(*arguments, share=plain)
        return np.asarray(to_world(local, job.rows.frames))[None]
    exchange = Exchange(*arguments, active=job.active, surface=job.scene.surface, share=plain)
    white = np.ones((len(job.scene.surface.vertices), 1), np.float32)
    sums = [exchange.first]
    for _ in range(bounces):
        sums.append(exchange.bounce(sums[-1], white))
    return np.diff(np.stack(sums)[..., 0], axis=0, prepend=0)


def summed(terms: Float[np.ndarray, "i v k"], albedo: float) -> Float[np.ndarray, "v k"]:
    """The transfer with as many bounces as there are terms after the first, off surfaces of one grey albedo."""
    return np.tensordot(np.float32(albedo) ** np.arange(len(terms), dtype=np.float32), terms, 1)
