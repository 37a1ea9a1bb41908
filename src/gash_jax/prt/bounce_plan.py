"""What a bake with bounces needs, before anyone pays for it: rays, seconds, memory, bytes, from a sample of vertices.

The rays of at most `SAMPLE` vertices are traced against the whole scene, twice (the first time pays for compilation,
the second is timed), and reflected once. What all vertices take is in proportion; hits that do not fit into memory are
traced again for every bounce (`bounces`).
"""

import operator
import time
from typing import Any, NamedTuple

import numpy as np

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.prt.bake_job import choose_replicates
from gash_jax.prt.bounces import MOST_BOUNCES, MOST_KEPT, Exchange, checked_albedo
from gash_jax.prt.integrands import direct
from gash_jax.prt.plan import SAMPLE, transfer_bytes
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.tracing import active_rows
from gash_jax.prt.visibility import ray_query


class BouncePlan(NamedTuple):
    """What a bake with bounces is expected to take."""

    bands: int
    bounces: int
    rays_per_vertex: int
    rays_total: int  # those that are traced again included
    reflected_rays: float  # mean share of a vertex's rays that meet the front of a face
    seconds: float
    memory: int  # bytes that the bake holds at once, beside the mesh
    bytes: int
    sampled_vertices: int

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return self._asdict()


def plan_bounces(
    mesh: MeshLike,
    bounces: WholeNumber,
    rays: WholeNumber = 256,
    *,
    bands: WholeNumber = 3,
    coloured: bool = False,
    seed: WholeNumber = 0,
) -> BouncePlan:
    """Plan a bake of `rays` rays per vertex with bounces; `coloured` if the albedo has three colours.

    Raises ValueError for options out of range.
    """
    mesh, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    bounces = whole_number(bounces, "bounces", 1, MOST_BOUNCES)
    replicates, rays, colours = choose_replicates(rays, None), operator.index(rays), 3 if coloured else 1
    started = time.perf_counter()
    geometry = trace_geometry(mesh)
    query = ray_query(geometry.vertices, geometry.faces, "closest")
    build, rng = time.perf_counter() - started, np.random.default_rng(seed)
    active, rows = active_rows(mesh, geometry, None, rng.random((len(mesh.vertices), replicates, 2), np.float32))
    total = len(active)
    chosen = np.sort(rng.permutation(total)[:SAMPLE])
    factor = total / max(len(chosen), 1)
    albedo = checked_albedo(np.full(colours, 0.5) if coloured else 0.5, len(mesh.vertices))
    laps, hits, kept = [0.0, 0.0, 0.0, 0.0], 0, 0
    for lap in (0, 2) if total else ():
        options = {"active": active[chosen], "surface": mesh}
        started = time.perf_counter()
        sample = Exchange(rows.take(chosen), direct(bands), rays // replicates, query, **options)
        traced = time.perf_counter()
        sample.bounce(sample.first, albedo)
        laps[lap : lap + 2] = traced - started, time.perf_counter() - traced
        hits, kept = sample.kept.hits, sample.kept.used
    needed = round(kept * factor)
    again = max(0.0, 1 - MOST_KEPT / max(needed, 1))
    arrays = 4 * total * replicates * bands**2 * (1 + 2 * colours)
    return BouncePlan(
        bands=bands,
        bounces=bounces,
        rays_per_vertex=rays,
        rays_total=round(total * rays * (1 + again * bounces)),
        reflected_rays=hits / (rays * len(chosen)) if total else 0.0,
        seconds=build + laps[0] + laps[2] * factor * (1 + again * bounces) + laps[3] * factor * bounces,
        memory=arrays + min(needed, MOST_KEPT),
        bytes=transfer_bytes(mesh, bands, colours=colours),
        sampled_vertices=len(chosen),
    )
