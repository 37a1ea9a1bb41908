"""Light that bounces, to an error: how often it has to bounce, and how many rays that takes.

A pilot of few rays for every vertex tells both. Its bounces are added one by one: with d_n the RMS of what bounce n
adds, and q = d_n / d_(n-1), all further ones add about d_n q / (1 - q), as bounces fall like a geometric series once
light has spread. The first bounce says nothing of that, since it is compared with light from the open sky: there q is
the largest albedo, as no bounce sends back more. Bounces end where the rest is at most `LEFT_OUT` of the error asked
for, at the latest with the number that is given: light that bounces more often is not asked for then, and no error.

The standard errors of the pilot say how many rays bring the noise below the rest of the error. The bake is then that of
`bake_transfer` with so many rays and bounces; where its own standard errors say more than was asked for, it is done
again with more rays.
"""

import math
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import RealNumber, WholeNumber, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bake_job import make_job
from gash_jax.prt.bounces import MOST_BOUNCES, Exchange, checked_albedo, describe_albedo
from gash_jax.prt.error_bars import replicate_error
from gash_jax.prt.error_target import check_error
from gash_jax.prt.few_rays import MOST_RAYS
from gash_jax.prt.integrands import direct
from gash_jax.prt.scene import as_occluders, as_points, make_scene
from gash_jax.prt.tracing import ProgressFn
from gash_jax.prt.transfer import Transfer
from gash_jax.prt.visibility import ray_query

if TYPE_CHECKING:
    from jax import Array

    from gash_jax.algebra.arguments import ArrayLike

PILOT, REPLICATES, STEP = 32, 4, 16  # rays of the pilot; rows they are split into; of what rays are a multiple
LEFT_OUT = 0.3  # of the error, for bounces that are not counted
NOISE = math.sqrt(1 - LEFT_OUT**2)
AIM = 0.93  # of what noise may be
RATE = 1.5  # as N^-RATE variance is expected to fall with N rays


class _Pilot(NamedTuple):
    """Bounces that count, what all others add and the noise of the pilot, both relative to all transfer; its rays."""

    bounces: int
    left_out: float
    noise: float
    rays: int


def bake_bounces_to_error(
    mesh: MeshLike,
    error: RealNumber,
    bands: WholeNumber = 3,
    *,
    bounces: WholeNumber,
    albedo: "ArrayLike | Array",
    points: "ArrayLike | Array | None" = None,
    normals: "ArrayLike | Array | None" = None,
    occluders: Sequence[MeshLike] = (),
    seed: WholeNumber = 0,
    backend: str = "embree",
    progress: ProgressFn | None = None,
) -> Transfer:
    """Bake transfer of light that bounces up to `bounces` times to a relative RMS error over all vertices and colours.

    The result is a bake with error bars. The metadata's `counted_bounces` says how many bounces are in it,
    `light_left_out` what further ones would add, relative to the transfer, and `estimated_error` both that and the
    noise. Other arguments are those of `bake_transfer`. Raises ValueError for options out of range.
    """
    mesh, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    error, most = check_error(error), whole_number(bounces, "bounces", 1, MOST_BOUNCES)
    scene: dict[str, Any] = {"points": points, "normals": normals, "occluders": occluders, "backend": backend}
    started = time.perf_counter()
    pilot = _look(mesh, bands, albedo, most, error, seed, scene)
    rays, noise, rounds, total = PILOT, pilot.noise, [{"rays": pilot.rays, "bounces": pilot.bounces}], pilot.rays
    while True:
        more = rays * max(noise / (AIM * NOISE * error), 1.0) ** (2 / RATE)
        rays = min(STEP * math.ceil(more / STEP), MOST_RAYS)
        options = {"bounces": pilot.bounces, "albedo": albedo, "replicates": REPLICATES, "seed": seed}
        baked = bake_transfer(mesh, bands, rays, **scene, **options, progress=progress)
        rounds.append({"rays": baked.metadata["rays_total"], "bounces": pilot.bounces})
        total += baked.metadata["rays_total"]
        noise = _relative(baked.coefficients, baked.standard_error)
        if noise <= NOISE * error or rays == MOST_RAYS:
            break
    entries = {
        **baked.metadata,
        "method": "bake to error",
        "parameters": {
            "error": error,
            **{name: value for name, value in baked.metadata["parameters"].items() if name not in ("rays", "bounces")},
            "bounces": most,
            "albedo": describe_albedo(albedo),
        },
        "rays_total": total,
        "rounds": rounds,
        "counted_bounces": pilot.bounces,
        "light_left_out": pilot.left_out,
        "estimated_error": math.hypot(noise, pilot.left_out),
        "seconds": {**baked.metadata["seconds"], "total": time.perf_counter() - started},
    }
    return baked._replace(metadata=entries)


def _look(mesh: Any, bands: int, albedo: Any, most: int, error: float, seed: int, given: dict[str, Any]) -> _Pilot:
    """Few rays for every vertex, bounced until further bounces do not count."""
    receivers, blockers = as_points(given["points"], given["normals"]), as_occluders(given["occluders"])
    scene = make_scene(mesh, receivers, blockers)
    colours = checked_albedo(albedo, len(scene.surface.vertices))
    query = ray_query(*scene.geometry[:2], "closest", given["backend"])
    part = (0, len((receivers or mesh).vertices))
    # other rays than those of the bake, whose number should not hang on what they themselves have found
    job = make_job(scene, query, PILOT, REPLICATES, seed + 1, part=part, everywhere=True)
    if job.part.start >= job.part.stop:
        return _Pilot(1, 0.0, 0.0, 0)
    n = PILOT // REPLICATES
    exchange = Exchange(job.rows, direct(bands), n, query, active=job.active, surface=scene.surface)
    found, added, left, enough = exchange.first, [_rms(exchange.first[job.part])], math.inf, 0.0
    while left > enough and len(added) <= most:
        following = exchange.bounce(found, colours)
        added.append(_rms(following[job.part] - found[job.part]))
        found, left = following, _remainder(added, float(colours.max()))
        enough = LEFT_OUT * error * _rms(found[job.part])
    replicas = found[job.part]
    mean = replicas.mean(1)
    noise = _relative(mean, replicate_error(replicas, mean, PILOT, exchange.share[job.part]))
    # what is beyond the number of bounces that was asked for is no error
    left_out = LEFT_OUT * error * left / enough if 0 < left <= enough else 0.0
    return _Pilot(len(added) - 1, left_out, noise, PILOT * len(job.active))


def _rms(replicas: Float[np.ndarray, "p r k _"]) -> float:
    """Root mean square of the mean over the replicates."""
    return float(np.sqrt(np.mean(replicas.mean(1, dtype=np.float64) ** 2)))


def _remainder(added: Sequence[float], brightest: float) -> float:
    """What all bounces after the last one add (module docstring); `added` begins with the light that did not bounce."""
    if not added[-1]:
        return 0.0
    ratio = added[-1] / added[-2] if len(added) > 2 else brightest
    return added[-1] * ratio / (1 - ratio) if ratio < 1 else math.inf


def _relative(coefficients: np.ndarray, errors: np.ndarray | None) -> float:
    """RMS of the standard errors over that of the transfer, of which the part that is noise is taken out."""
    assert errors is not None
    noise = float(np.sum(errors.astype(np.float64) ** 2))
    energy = float(np.sum(coefficients.astype(np.float64) ** 2)) - noise
    return math.sqrt(noise / energy) if energy > 0 else 0.0
