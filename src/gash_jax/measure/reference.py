"""A method held against a reference bake: every measure at once, and the yardstick that gives equivalent rays.

References are dear and depend on the mesh alone, so they are kept in the user's cache under the hash of the mesh, the
ray count and the source of the bake.
"""

import hashlib
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.files.caches import cache_folder, source_hash
from gash_jax.files.npz import check_arrays, read_npz, write_npz
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure import metrics
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.tracing import ProgressFn

REFERENCE_RAYS, REFERENCE_SEED = 4096, 99
# whose source a reference depends on
BAKE_ROOMS = ("algebra", "geometry", "prt")


class Reference(NamedTuple):
    """Coefficients to be believed, their standard error, and the MSE of the plain bake by ray count."""

    coefficients: Float[np.ndarray, "v k"]
    standard_error: Float[np.ndarray, "v k"]
    curve: dict[int, float]
    rays: int


def make_reference(
    mesh: Mesh,
    bands: int = 3,
    rays: int = REFERENCE_RAYS,
    progress: ProgressFn | None = None,
    *,
    bounces: int = 0,
    albedo: float = 1.0,
) -> Reference:
    """Bake the reference of a mesh and the plain bakes below it, or read them from the cache.

    With `bounces` it is of light that surfaces of one grey `albedo` reflected up to so many times.
    """
    light: dict[str, Any] = {"bounces": bounces, "albedo": albedo} if bounces else {}
    digest = hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in mesh))
    digest.update(repr((bands, rays, REFERENCE_SEED, source_hash(BAKE_ROOMS), *light.values())).encode())
    path = cache_folder() / "references" / f"{digest.hexdigest()[:24]}.npz"
    try:
        arrays, metadata = read_npz(path, "reference", ("coefficients", "standard_error"))
        shape = (len(mesh.vertices), bands**2)
        check_arrays(path, "reference", arrays, {"coefficients": shape, "standard_error": shape})
        curve = {int(count): float(error) for count, error in metadata["curve"].items()}
        return Reference(arrays["coefficients"], arrays["standard_error"], curve, rays)
    except (ValueError, LookupError, AttributeError, TypeError):  # not there yet, or damaged: it is only a cache
        pass
    transfer = bake_transfer(mesh, bands, rays, seed=REFERENCE_SEED, progress=progress, **light)
    curve = metrics.plain_bake_curve(mesh, transfer.coefficients, rays, **light)
    assert transfer.standard_error is not None
    path.parent.mkdir(parents=True, exist_ok=True)
    arrays = {"coefficients": transfer.coefficients, "standard_error": transfer.standard_error}
    write_npz(path, arrays, {"curve": {str(count): error for count, error in curve.items()}})
    return Reference(transfer.coefficients, transfer.standard_error, curve, rays)


def score(estimate: Float[np.ndarray, "v k"], mesh: Mesh, reference: Reference) -> dict[str, Any]:
    """Every measure of an estimate, by name."""
    truth = reference.coefficients
    error = metrics.mse(estimate, truth)
    per_mse, per_std = metrics.coefficient_errors(estimate, truth)
    return {
        "relrmse": metrics.relrmse(estimate, truth),
        "skill": metrics.skill(estimate, truth, mesh.normals),
        "mse": error,
        "shadow_mse": metrics.shadow_mse(estimate, truth),
        "equivalent_rays": metrics.equivalent_rays(error, reference.curve) if np.any(truth) else "no transfer",
        "mse_per_coefficient": per_mse.tolist(),
        "std": per_std.tolist(),
    }
