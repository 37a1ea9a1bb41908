"""What a scene needs, before anyone pays for it: bands from the light, rays and seconds from a sample of vertices.

*Bands.* Unshadowed irradiance has the coefficients A_l L_lm (Ramamoorthi & Hanrahan 2001), so band l holds the share
sum_m (A_l L_lm)² of its energy. A band that holds nothing of it is one that this light cannot excite on an unshadowed
surface; `bands` is the fewest that hold `HELD` of the energy.

*Rays.* `error_target` is run in full on at most `SAMPLE` vertices against the whole scene, twice: the first run pays
for compilation, the second is timed. Neighbours of sampled vertices are not sampled, so it does without the smoothing
of the real bake, which costs it a few rays more.
"""

import time
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.sh import band_index, bands_of
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.error_target import check_error, run_rounds
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.tracing import active_rows
from gash_jax.prt.visibility import visibility

HELD = 0.999
SAMPLE = 2000


class Plan(NamedTuple):
    """What baking a mesh to an error is expected to take."""

    bands: int
    irradiance_held: float | None  # share of the light's irradiance in these bands; None without a light
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


def irradiance_bands(light: Float[np.ndarray, "k 3"]) -> tuple[int, float]:
    """Fewest bands that hold `HELD` of the irradiance of a light, and the share that they hold."""
    bands = bands_of(len(light))
    energy = np.sum((clamped_cosine_coefficients(bands)[:, None] * light.astype(np.float64)) ** 2, axis=1)
    per_band = np.bincount(band_index(bands), energy)
    if not per_band.any():
        return 1, 1.0
    held = np.cumsum(per_band) / per_band.sum()
    needed = int(np.argmax(held >= HELD)) + 1
    return needed, float(held[needed - 1])


def transfer_bytes(mesh: Mesh, bands: int) -> int:
    """Size of a transfer file with standard errors, but for a few kilobytes of metadata."""
    return 4 * (len(mesh.vertices) * (2 * bands**2 + 6) + 3 * len(mesh.faces))


def plan_bake(
    mesh: Mesh, error: float = 0.02, *, bands: int = 3, light: Float[np.ndarray, "k 3"] | None = None, seed: int = 0
) -> Plan:
    """Plan a bake to a relative error; with a light, its irradiance decides the bands instead of `bands`."""
    check_error(error)
    held = None
    if light is not None:
        bands, held = irradiance_bands(light)
    started = time.perf_counter()
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces)
    build = time.perf_counter() - started
    rng = np.random.default_rng(seed)
    active, rows = active_rows(mesh, geometry, None, rng.random((len(mesh.vertices), 1, 2), np.float32))
    size = transfer_bytes(mesh, bands)
    if not len(active):
        return Plan(bands, held, error, 0.0, 0.0, 0.0, 0, build, size, 0)
    rows = rows.take(np.sort(rng.permutation(len(active))[:SAMPLE]))
    count = len(rows.origins)
    alone = sp.csr_matrix(sp.identity(count))
    started = time.perf_counter()
    run_rounds(rows, error, bands, visible, alone)
    compiled = time.perf_counter()
    state, _ = run_rounds(rows, error, bands, visible, alone)
    sample = time.perf_counter() - compiled
    compilation = max(0.0, compiled - started - sample)
    rays = float(state.rays.mean())
    return Plan(
        bands=bands,
        irradiance_held=held,
        error=error,
        occluded_share=float(np.mean(state.share < 1)),
        blocked_rays=float(1 - state.share.mean()),
        rays_per_vertex=rays,
        rays_total=round(rays * len(active)),
        seconds=build + compilation + sample * len(active) / count,
        bytes=size,
        sampled_vertices=count,
    )
