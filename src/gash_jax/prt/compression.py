"""Visibility in few numbers a vertex: principal components, common to the whole mesh (Sloan et al. 2003, section 4).

The components are found in the frames of the vertices (`algebra.directions.orthonormal_frame`, columns tangent,
bitangent, normal), where the horizon is the same everywhere, so that none is spent on it. In a file

    visibility_weights (v, n)    visibility_components (n, j)    visibility_mean (j)

stand for the visibility mean + weights @ components in these frames; turned into the world it is what was compressed,
nearly. Vertices without a normal see nothing.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.algebra.closed_forms import zero_without_normal
from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.sh_rotation import rotate_coefficients

NAMES = ("visibility_weights", "visibility_components", "visibility_mean")


def compress_visibility(
    visibility: Float[np.ndarray, "v j"], normals: Float[np.ndarray, "v 3"], components: WholeNumber
) -> dict[str, np.ndarray]:
    """The three arrays of a file, with 1 to j components; weights are float16, one pair of bytes for each component.

    Raises ValueError for another number of components.
    """
    count = whole_number(components, "components", 1, visibility.shape[1])
    local = _turned(visibility.astype(np.float32), normals, into_world=False).astype(np.float64)
    usable = np.any(normals != 0, axis=1)
    mean = local[usable].mean(0) if usable.any() else np.zeros(local.shape[1])
    centred = (local - mean) * usable[:, None]
    basis = np.linalg.eigh(centred.T @ centred)[1][:, ::-1][:, :count].T
    arrays = ((centred @ basis.T).astype(np.float16), basis.astype(np.float32), mean.astype(np.float32))
    return dict(zip(NAMES, arrays, strict=True))


def expand_visibility(arrays: Mapping[str, np.ndarray], normals: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v j"]:
    """Visibility in the world, float16, from the three arrays."""
    weights, components, mean = (arrays[name].astype(np.float32) for name in NAMES)
    return _turned(mean + weights @ components, normals, into_world=True).astype(np.float16)


def _turned(
    values: Float[np.ndarray, "v j"], normals: Float[np.ndarray, "v 3"], *, into_world: bool
) -> Float[np.ndarray, "v j"]:
    frames = np.asarray(orthonormal_frame(normals.astype(np.float32)))
    turned = rotate_coefficients(values, frames if into_world else frames.swapaxes(1, 2))
    return np.asarray(zero_without_normal(turned, normals))
