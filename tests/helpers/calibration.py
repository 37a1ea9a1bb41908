"""Errors and error bars of bakes of closed-form scenes, pooled over seeds."""

import zlib
from collections.abc import Callable

import numpy as np

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.transfer import Transfer
from tests.helpers.closed_forms import ClosedFormScene

# by symmetry the count of free rays is nearly fixed here, so t_00 is off by less than a ray a replicate
LESS_THAN_A_RAY = ("corner", "corner turned", "disk 1.0 at 1.0", "disk 0.4 at 1.0")
FREE = ("convex alone", "box alone")

# (mesh with the probes' normals only, bands, seed) -> a bake with standard errors
BakeFn = Callable[[Mesh, int, int], Transfer]


def scene_errors(scene: ClosedFormScene, bake: BakeFn, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors and standard errors of the partly occluded probes, at least `samples` rows unless all are free."""
    bands, probes = round(scene.exact.shape[1] ** 0.5), np.asarray(scene.probes)
    normals = np.zeros_like(scene.mesh.normals)
    normals[probes] = scene.mesh.normals[probes]
    mesh = scene.mesh._replace(normals=normals)
    share = scene.of_mesh[:, 0] / np.asarray(unshadowed_transfer(np.array([[0, 0, 1]], np.float32), 1))[0, 0]
    partly = (share > 1e-3) & (share < 1 - 1e-3)
    errors, claimed = [], []
    for seed in range(-(-samples // len(probes))):
        baked = bake(mesh, bands, zlib.crc32(scene.name.encode()) + seed)
        assert baked.standard_error is not None
        errors.append((baked.coefficients[probes] - scene.of_mesh)[partly])
        claimed.append(baked.standard_error[probes][partly])
    return np.concatenate(errors), np.concatenate(claimed)
