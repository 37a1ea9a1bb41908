"""What a bake with bounces needs, before anyone pays for it: rays, seconds, memory, bytes, from a sample of vertices.

The rays of at most `SAMPLE` vertices are traced against the whole scene, twice (the first time pays for compilation,
the second is timed), and reflected once. What all vertices take is in proportion; hits that do not fit into memory are
traced again for every bounce (`bounces`). A glossy bake traces as many rays again for its matrices (`glossy`).
"""

import operator
import time
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.bake_job import choose_replicates
from gash_jax.prt.bounces import MOST_BOUNCES, MOST_KEPT, Exchange, checked_albedo
from gash_jax.prt.glossy import bake_gloss, check_reflections
from gash_jax.prt.integrands import direct
from gash_jax.prt.plan import SAMPLE, transfer_bytes
from gash_jax.prt.rays import RayQuery, trace_geometry
from gash_jax.prt.tracing import Rows, active_rows
from gash_jax.prt.visibility import ray_query

MATRIX_BYTES = 22  # of an entry of a matrix, in a bake: mean and scatter, their half precision, and what this loses


class _Sample(NamedTuple):
    """Seconds that a sample took, for its rays, one bounce and its matrices; hits on fronts, and their bytes."""

    traced: float = 0.0
    bounced: float = 0.0
    gloss: float = 0.0
    hits: int = 0
    kept: int = 0


class BouncePlan(NamedTuple):
    """What a bake with bounces is expected to take."""

    bands: int
    bounces: int
    rays_per_vertex: int  # of a glossy bake both kinds
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
    glossy: bool = False,
    seed: WholeNumber = 0,
) -> BouncePlan:
    """Plan a bake of `rays` rays per vertex with bounces; `coloured` if the albedo has three colours, `glossy` for
    matrices too.

    Raises ValueError for options out of range, and for matrices off coloured surfaces.
    """
    check_reflections(glossy, coloured)
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
    some = (rows.take(chosen), bands, rays, query, active[chosen], mesh, albedo, glossy)
    first, then = (_sample(*some) if total else _Sample() for _ in range(2))
    needed = round(then.kept * factor)
    again = max(0.0, 1 - MOST_KEPT / max(needed, 1))
    arrays = 4 * total * replicates * bands**2 * (1 + 2 * colours) + MATRIX_BYTES * total * bands**4 * glossy
    seconds = then.traced * (1 + again * bounces) + then.bounced * bounces + then.gloss
    return BouncePlan(
        bands=bands,
        bounces=bounces,
        rays_per_vertex=rays * (1 + glossy),
        rays_total=round(total * rays * (1 + glossy + again * bounces)),
        reflected_rays=then.hits / (rays * len(chosen)) if total else 0.0,
        seconds=build + first.traced + first.bounced + first.gloss + factor * seconds,
        memory=arrays + min(needed, MOST_KEPT),
        bytes=transfer_bytes(mesh, bands, glossy, colours, bounced=True),
        sampled_vertices=len(chosen),
    )


def _sample(
    rows: Rows,
    bands: int,
    rays: int,
    query: RayQuery,
    active: Int[np.ndarray, "a"],
    mesh: Mesh,
    albedo: Float[np.ndarray, "s c"],
    glossy: bool,
) -> _Sample:
    """One bounce of some rows, with their matrices if wanted."""
    started = time.perf_counter()
    exchange = Exchange(rows, direct(bands), rays // rows.shifts.shape[1], query, active=active, surface=mesh)
    traced = time.perf_counter()
    reflected = exchange.bounced(albedo, 1).reflected
    bounced = time.perf_counter()
    if glossy:
        bake_gloss(rows, bands, rays, query, reflected=reflected)
    ended = time.perf_counter()
    seconds = (traced - started, bounced - traced, ended - bounced)
    return _Sample(*seconds, exchange.kept.hits, exchange.kept.used)
