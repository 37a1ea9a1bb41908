"""What a scene needs, before anyone pays for it: bands, rays and seconds, from a sample of at most `SAMPLE` vertices.

*Bands.* With a light, the fewest whose radiance, shadows included, is nearly that of all bands (`light_bands`).

*Rays.* `error_target` is run in full on the sample against the whole scene, twice: the first run pays for compilation,
the second is timed. Neighbours of sampled vertices are not sampled, so it does without the smoothing of the real bake,
which costs it a few rays more. A glossy bake traces as many rays again (`glossy`), in as much time.
"""

import time
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from gash_jax.algebra.arguments import RealNumber, WholeNumber, whole_number
from gash_jax.algebra.sh import radiance_coefficients, validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.error_target import check_error, run_rounds
from gash_jax.prt.light_bands import bands_for
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.tracing import active_rows
from gash_jax.prt.visibility import visibility

SAMPLE = 2000


class Plan(NamedTuple):
    """What baking a mesh to an error is expected to take."""

    bands: int
    # relative rms, over vertices and colours, of the radiance that the light's other bands would add, at two standard
    # errors above the estimate; None without a light
    radiance_left_out: float | None
    error: float
    occluded_share: float  # of sampled vertices, those with a blocked ray
    blocked_rays: float  # mean share of a vertex's rays that are blocked
    rays_per_vertex: float
    rays_total: int
    seconds: float
    bytes: int
    sampled_vertices: int

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return self._asdict()


def transfer_bytes(mesh: Mesh, bands: int, glossy: bool = False, colours: int = 1, bounced: bool = False) -> int:
    """Size of a transfer file with standard errors, but for a few kilobytes of metadata.

    A glossy one holds visibility with its errors, or matrices of light that bounced as well.
    """
    halves = (bands**4 if bounced else 2 * (2 * bands - 1) ** 2) * glossy
    return len(mesh.vertices) * (4 * (2 * bands**2 * colours + 6) + 2 * halves) + 12 * len(mesh.faces)


def plan_bake(
    mesh: MeshLike,
    error: RealNumber = 0.02,
    *,
    bands: WholeNumber = 3,
    light: Any = None,
    glossy: bool = False,
    seed: WholeNumber = 0,
) -> Plan:
    """Plan a bake to a relative error; with a light, the radiance that it makes decides the bands instead of `bands`.

    `light` is a Light or its coefficients (k, 3); all its bands count: give it as many as a bake may have. `glossy`
    plans visibility too: as many rays again, and its bytes. Raises ValueError for an error out of range.

    >>> plan = gash_jax.plan_bake("bunny.ply", 0.05, light=gash_jax.load_light("studio.hdr", bands=10))
    >>> plan.bands > 1, plan.rays_total > 0
    (True, True)
    """
    mesh, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    error, light = check_error(error), None if light is None else _light(light)
    started = time.perf_counter()
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces)
    build = time.perf_counter() - started
    rng = np.random.default_rng(seed)
    active, rows = active_rows(mesh, geometry, None, rng.random((len(mesh.vertices), 1, 2), np.float32))
    if not len(active):
        bands, left_out = (bands, None) if light is None else (1, 0.0)
        return Plan(bands, left_out, error, 0.0, 0.0, 0.0, 0, build, transfer_bytes(mesh, bands, glossy), 0)
    rows = rows.take(np.sort(rng.permutation(len(active))[:SAMPLE]))
    count, left_out = len(rows.origins), None
    if light is not None:
        bands, left_out = bands_for(light, rows, visible, rng)
    alone = sp.csr_matrix(sp.identity(count))
    started = time.perf_counter()
    run_rounds(rows, error, bands, visible, alone)
    compiled = time.perf_counter()
    state, _ = run_rounds(rows, error, bands, visible, alone)
    sample = time.perf_counter() - compiled
    compilation = max(0.0, compiled - started - sample)
    rays = float(state.rays.mean()) * (1 + glossy)
    return Plan(
        bands=bands,
        radiance_left_out=left_out,
        error=error,
        occluded_share=float(np.mean(state.share < 1)),
        blocked_rays=float(1 - state.share.mean()),
        rays_per_vertex=rays,
        rays_total=round(rays * len(active)),
        seconds=build + (compilation + sample * len(active) / count) * (1 + glossy),
        bytes=transfer_bytes(mesh, bands, glossy),
        sampled_vertices=count,
    )


def _light(light: Any) -> Float[np.ndarray, "k 3"]:
    """Coefficients of a light, which is a container or an array."""
    found = np.asarray(radiance_coefficients(getattr(light, "coefficients", light)))
    if not np.isfinite(found).all():
        raise ValueError("the light holds values that are not finite: project its map again")
    return found.astype(np.float32)
