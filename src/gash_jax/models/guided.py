"""Bakes of few rays that a small network reconstructs over the edges of the mesh: with a number of rays or to an error.

Rays come from `prt.few_rays`, the network is `nn.reconstruction`. The result is biased, and the more rays a vertex has
the less; what error is left the network says itself, as `predicted_error`. For labels and references there are
`bake_transfer` and `prt.error_target.bake_to_error`, which know no network.

To an error: `PILOT` rays for every vertex. The errors that the network expects say how many rays, with the fewest in
all, bring the mesh to `AIM` times the error asked for (`prt.allocation`); these are traced at once, and looked at
again, until the expected error is at most the one asked for. A look takes as long as some ten rays a vertex, so there
are to be few of them, and the first is at a part of the mesh alone (`guided_sample`).
"""

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from jaxtyping import Int

from gash_jax.algebra.arguments import RealNumber, WholeNumber, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.surfels import curve_codes
from gash_jax.models.guided_error import corrected, noise_left
from gash_jax.models.guided_sample import expected_everywhere, make_sample
from gash_jax.models.reconstruction import Rebuilt, Surface, make_surface, reconstruct, shipped_network
from gash_jax.nn.reconstruction import COMPARED, LEAST
from gash_jax.prt import error_target
from gash_jax.prt.allocation import PILOT, choose_rays
from gash_jax.prt.bake import free_and_dark
from gash_jax.prt.bounce_error import bake_bounces_to_error
from gash_jax.prt.error_target import check_error
from gash_jax.prt.few_rays import (
    LARGEST_ROW,
    MOST_RAYS,
    FewRays,
    check_few_rays,
    continued_shifts,
    trace_first,
    trace_up_to,
)
from gash_jax.prt.scene import as_occluders, make_scene
from gash_jax.prt.tracing import ProgressFn, active_rows
from gash_jax.prt.transfer import Transfer, make_metadata
from gash_jax.prt.visibility import visibility

# of the error asked for: what rays are to bring the mesh to, and what is enough in a part, which may be a little off
AIM, ENOUGH = 0.95, 0.97
# from this error on the pilot is enough for most meshes, and all has to be looked at anyhow
PILOT_MAY_DO = 0.06
# how expected mean square errors fall with the rays of a vertex, as N^-rate: from the pilot on; where neighbours make
# up for all noise, and what is added to that where they make up for none
FIRST_RATE, RATE, RATE_OF_RAYS = 1.3, 1.1, 0.35
MOST_DOUBLINGS = 3  # at a time: further ahead the expected errors do not see


class GuidedBake:
    """One bake: the scene, the rays so far, what was made of them.

    Every vertex first gets `first` rays; lattices of neighbours differ until they have grown to `last`.
    """

    def __init__(self, mesh: Mesh, bands: int, first: int, last: int, seed: int, backend: str, occluders: list[Mesh]):
        self.mesh, self.bands, self.traced, self.first_rays = mesh, bands, max(bands, COMPARED), first
        self.started = time.perf_counter()
        scene = make_scene(mesh, None, occluders).receivers_alone()
        self.geometry = scene.geometry
        self.visible = visibility(*scene.geometry[:2], backend)
        places = scene.geometry.vertices[: len(mesh.vertices)]
        order = np.argsort(curve_codes(places, mesh.normals, 30), kind="stable")
        shifts = continued_shifts(order, first, seed, last)
        self.active, self.rows = active_rows(mesh, scene.geometry, None, shifts)
        number = np.full(len(order), -1)
        number[self.active] = np.arange(len(self.active))
        self.order = number[order][number[order] >= 0]  # of the active vertices along the curve
        self.places = places
        self.built = time.perf_counter()

    def nothing(self) -> tuple[FewRays, Rebuilt]:
        """No rays and zeros, for a mesh without a normal."""
        count, k = len(self.active), self.traced**2
        zeros = np.zeros((count, k), np.float32)
        none = np.zeros(count, np.float32)
        return FewRays(np.zeros(count, np.int64), none, zeros, none), Rebuilt(zeros, zeros)

    def first(self, progress: ProgressFn | None = None) -> tuple[FewRays, Surface]:
        """The first rays; the table of edges is made meanwhile."""
        arguments = self.places, self.mesh.normals, self.rows.frames, self.mesh.faces, self.active
        with ThreadPoolExecutor(1) as beside:
            surface = beside.submit(make_surface, *arguments)
            few = trace_first(self.rows, self.first_rays, self.traced, self.visible, progress)
            return few, surface.result()

    def add(self, few: FewRays, wanted: Int[np.ndarray, "a"]) -> FewRays:
        """Rays so that each vertex has as many as it wants."""
        return trace_up_to(few, wanted, self.rows, self.traced, self.visible)

    def transfer(
        self, few: FewRays, rebuilt: Rebuilt, method: str, parameters: dict[str, Any], **entries: Any
    ) -> Transfer:
        """What is written: in the bands that were asked for."""
        k, count = self.bands**2, len(self.mesh.vertices)
        coefficients, errors = np.zeros((count, k), np.float32), np.zeros((count, k), np.float32)
        coefficients[self.active], errors[self.active] = rebuilt.coefficients[:, :k], np.sqrt(rebuilt.variance[:, :k])
        finished = time.perf_counter()
        metadata = make_metadata(
            self.bands,
            method,
            parameters,
            rays_total=int(few.rays.sum()),
            ray_offset=self.geometry.offset,
            modelled={**free_and_dark(few.share), "reconstructed_over_edges": True},
            seconds={
                "build": self.built - self.started,
                "trace": finished - self.built,
                "total": finished - self.started,
            },
            **entries,
        )
        return Transfer(coefficients, None, *self.mesh, metadata, errors)


def rebuild(few: FewRays, surface: Surface) -> Rebuilt:
    """What the network that ships makes of the rays, with the error that is expected once their halves are seen."""
    rebuilt = reconstruct(shipped_network(), surface, few)
    return rebuilt._replace(variance=corrected(rebuilt.variance, few))


def bake_guided(
    mesh: MeshLike,
    bands: WholeNumber = 3,
    rays: WholeNumber = 8,
    *,
    occluders: Sequence[MeshLike] = (),
    seed: WholeNumber = 0,
    backend: str = "embree",
    progress: ProgressFn | None = None,
) -> Transfer:
    """Bake shadowed diffuse transfer with few rays a vertex, reconstructed over the edges of the mesh.

    `rays` is a power of two, from 4. With 8 the error is that of some three times as many plain rays on meshes of
    several thousand vertices; the more rays, the less there is to gain. The result is biased, and has no
    `standard_error` but a `predicted_error`. `occluders` are those of `bake_transfer`. Raises ValueError for options
    out of range.

    >>> transfer = gash_jax.bake_guided("bunny.ply", rays=8)
    >>> transfer.coefficients.shape, transfer.predicted_error.shape
    ((362, 9), (362, 9))
    """
    mesh, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    rays = check_few_rays(rays)
    bake = GuidedBake(mesh, bands, min(rays, LARGEST_ROW), rays, seed, backend, as_occluders(occluders))
    few, rebuilt = bake.nothing()
    if len(bake.active):
        few, surface = bake.first(progress)
        few = bake.add(few, np.full(len(bake.active), rays))
        rebuilt = rebuild(few, surface)
    return bake.transfer(few, rebuilt, "guided bake", {"rays": rays, "seed": seed, "backend": backend})


def bake_to_error(
    mesh: MeshLike,
    error: RealNumber,
    bands: WholeNumber = 3,
    *,
    unbiased: bool = False,
    bounces: WholeNumber = 0,
    albedo: Any = None,
    points: Any = None,
    normals: Any = None,
    occluders: Sequence[MeshLike] = (),
    seed: WholeNumber = 0,
    backend: str = "embree",
    progress: ProgressFn | None = None,
) -> Transfer:
    """Bake shadowed diffuse transfer to a relative RMS error over the mesh (relrmse), with as few rays as it takes.

    Few-ray estimates are reconstructed over the edges of the mesh; `predicted_error` is what is expected to be left.
    `unbiased` leaves the network out, takes more rays, and gives a `standard_error` (`prt.error_target`); so do
    `points` with `normals`, which have no edges. Light that bounces up to `bounces` times off surfaces of an `albedo`
    is baked by rays alone, too (`prt.bounce_error`). The metadata's `rounds` says how many rays were traced when,
    `estimated_error` what the bake believes it reached. `progress(done, total)` counts rays. Vertices stop at 2^15
    rays each. Raises ValueError for options out of range.

    >>> transfer = gash_jax.bake_to_error("bunny.ply", 0.05)
    >>> transfer.metadata["estimated_error"] <= 0.05
    True
    """
    if bounces or albedo is not None:
        scene = {"points": points, "normals": normals, "occluders": occluders, "bounces": bounces, "albedo": albedo}
        return bake_bounces_to_error(mesh, error, bands, **scene, seed=seed, backend=backend, progress=progress)
    if unbiased or points is not None or normals is not None:
        scene = {"points": points, "normals": normals, "occluders": occluders}
        return error_target.bake_to_error(mesh, error, bands, **scene, seed=seed, backend=backend, progress=progress)
    mesh, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    error, blockers = check_error(error), as_occluders(occluders)
    last = PILOT if error >= PILOT_MAY_DO else LARGEST_ROW
    bake = GuidedBake(mesh, bands, PILOT, last, seed, backend, blockers)
    few, rebuilt = bake.nothing()
    report: dict[str, Any] = {"rounds": [], "estimated_error": 0.0}
    if len(bake.active):
        few, rebuilt, report = _rounds(bake, error, progress)
    parameters = {"error": error, "seed": seed, "backend": backend}
    parameters |= {"occluders": len(blockers)} if blockers else {}
    return bake.transfer(few, rebuilt, "guided bake to error", parameters, **report)


def _rounds(bake: GuidedBake, error: float, progress: ProgressFn | None) -> tuple[FewRays, Rebuilt, dict[str, Any]]:
    """Trace until the expected relative error is at most `error`; also what there is to say about it."""
    few, surface = bake.first()
    rounds = [{"vertices": len(few.rays), "rays": int(few.rays.sum())}]
    if not few.share.any():  # zero is the formula, and no error is small beside it
        return few, bake.nothing()[1], {"rounds": rounds, "estimated_error": 0.0}
    network, k = shipped_network(), bake.bands**2
    rebuilt, variance, energy = None, np.zeros(0), 0.0
    sample = make_sample(surface, bake.order) if error < PILOT_MAY_DO else None  # for the first look
    while rebuilt is None:
        if sample is not None:
            variance, energy = expected_everywhere(network, sample, surface, few, k)
            variance = corrected(variance[:, None], few)[:, 0]
        else:
            rebuilt = rebuild(few, surface)
            # without the least that the network says, which no ray lowers
            variance = np.maximum(rebuilt.variance[:, :k] - LEAST, 0).sum(axis=1, dtype=np.float64)
            energy = float(np.sum(rebuilt.coefficients[:, :k].astype(np.float64) ** 2))
        enough = variance.sum() <= ((1.0 if sample is None else ENOUGH) * error) ** 2 * energy
        budget, pilot = (AIM * error) ** 2 * energy, len(rounds) == 1
        wanted = few.rays if enough else _wanted(few, variance, k, budget, pilot)
        chosen, sample = wanted > few.rays, None
        if chosen.any():
            if progress:
                progress(int(few.rays.sum()), int(wanted.sum()))
            rounds.append({"vertices": int(chosen.sum()), "rays": int((wanted - few.rays).sum())})
            few, rebuilt = bake.add(few, wanted), None
    if progress:
        progress(int(few.rays.sum()), int(few.rays.sum()))
    estimated = float(np.sqrt(variance.sum() / energy)) if energy > 0 else 0.0
    return few, rebuilt, {"rounds": rounds, "estimated_error": estimated}


def _wanted(few: FewRays, variance: np.ndarray, k: int, budget: float, pilot: bool) -> np.ndarray:
    """Rays of each vertex with which the variances are expected to meet a budget, as far ahead as can be seen."""
    rate = FIRST_RATE if pilot else RATE + RATE_OF_RAYS * noise_left(few, variance, k)
    wanted = choose_rays(few.rays, variance, budget, rate)
    return np.minimum(wanted, np.minimum(few.rays << MOST_DOUBLINGS, MOST_RAYS))
