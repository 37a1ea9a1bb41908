"""Images that give vertices their values back better than sampling does.

Sampled texels and bilinear lookups do not undo each other: with B the lookup (v x n²) and s the sampled image, the
vertices get B s instead of their values t. The fitted image is s + c with the correction c of least
|B c - (t - B s)|² / STRENGTH + |c|², that is (B'B + STRENGTH I) c = B' (t - B s). A texel that serves no vertex stays
as it was sampled. Where several vertices share four texels their values are balanced against each other, and a smaller
STRENGTH buys the last of the error with overshoots that a network would have to learn.

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
    used, column = np.unique(image.texels[image.bilinear > 0], return_inverse=True)
    rows = np.nonzero(image.bilinear)[0]
    entries = image.bilinear[image.bilinear > 0].astype(np.float64)
    lookup = sparse.csr_array((entries, (rows, column)), shape=(vertices, len(used)))
    factors = splu(sparse.csc_array(lookup.T @ lookup + STRENGTH * sparse.eye_array(len(used))))

    def fit(values: Float[np.ndarray, "v c"]) -> Float[np.ndarray, "n n c"]:
        flat = np.array(image.to_image(values)).reshape(size * size, -1)
        missed = values - lookup @ flat[used]
        flat[used] += factors.solve(lookup.T @ missed.astype(np.float64)).astype(np.float32)
        return flat.reshape(size, size, -1)

    return fit
