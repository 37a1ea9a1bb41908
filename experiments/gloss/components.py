"""PCA of the visibility over the vertices of a mesh: how many numbers it needs, in the world and in their own frames.

In the frame of a vertex the hemisphere of its normal is the same everywhere, so nothing is spent on the normals.
"""

import numpy as np

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.bake import bake_transfer

COMPONENTS = {3: (4, 8, 12, 16, 20, 25), 4: (4, 8, 12, 16, 24, 32, 49)}


def pca_errors(values: np.ndarray, counts: tuple[int, ...]) -> list[float]:
    """relrmse of the best linear model of so many components about the mean."""
    centred = values - values.mean(0)
    singular = np.linalg.svd(centred, compute_uv=False)
    return [float(np.sqrt(np.sum(singular[count:] ** 2) / np.sum(values**2))) for count in counts]


def component_curves(mesh: Mesh, rays: int) -> list[dict]:
    """Error of the visibility for every number of components, in 3 and 4 bands."""
    rows = []
    for bands, counts in COMPONENTS.items():
        visibility = bake_transfer(mesh, bands, rays, glossy=True).visibility
        assert visibility is not None
        world = visibility.astype(np.float64)
        frames = np.asarray(orthonormal_frame(mesh.normals)).swapaxes(1, 2)
        local = np.asarray(rotate_coefficients(world.astype(np.float32), frames), np.float64)
        for count, there, here in zip(counts, pca_errors(world, counts), pca_errors(local, counts), strict=True):
            size = {"bands": bands, "components": count, "bytes": 2 * count, "whole": 2 * world.shape[1]}
            rows.append({**size, "world": there, "local": here})
    return rows
