"""Images that give vertices their values back better than sampling does.

Sampled texels and bilinear lookups do not undo each other: with B the lookup (v x n²) and s the sampled image, the
vertices get B s instead of their values t. The fitted image is s + c with the correction c of least
|B c - (t - B s)|² / STRENGTH + |c|², that is c = B' (B B' + STRENGTH I)^-1 (t - B s). A texel that serves no vertex
stays as it was sampled. Where several vertices share four texels their values are balanced against each other, and a
smaller STRENGTH buys the last of the error with overshoots that a network would have to learn.

One factorisation serves all values: it depends on the image alone.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy import sparse
from scipy.sparse.linalg import splu

from gash_jax.geometry.geometry_image import GeometryImage

STRENGTH = 0.1

# values of all vertices (v, c) -> image (n, n, c), float32
FitFn = Callable[[Float[np.ndarray, "v c"]], Float[np.ndarray, "n n c"]]


def image_fit(image: GeometryImage) -> FitFn:
    """A function that makes fitted images of values of all vertices (module docstring)."""
    vertices, size = len(image.texels), len(image.face)
    starts = 4 * np.arange(vertices + 1)
    entries = (image.bilinear.astype(np.float64).ravel(), image.texels.ravel(), starts)
    lookup = sparse.csr_array(entries, shape=(vertices, size * size))
    factors = splu(sparse.csc_array(lookup @ lookup.T + STRENGTH * sparse.eye_array(vertices)))

    def fit(values: Float[np.ndarray, "v c"]) -> Float[np.ndarray, "n n c"]:
        sampled = np.asarray(image.to_image(values))
        missed = values - lookup @ sampled.reshape(size * size, -1)
        missed[image.bilinear.sum(axis=1) == 0] = 0  # vertices without a face, which have no texels
        correction = lookup.T @ factors.solve(missed.astype(np.float64))
        return sampled + correction.reshape(sampled.shape).astype(np.float32)

    return fit
