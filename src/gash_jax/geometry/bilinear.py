"""Looking up an image of n x n texels at texture coordinates (u, v): u to the right, v downwards, both from 0 to 1.

The centre of the texel in row i and column j lies at u = (j + 1/2) / n, v = (i + 1/2) / n, as in glTF and in every
graphics API. Between centres values are interpolated bilinearly; beyond the outermost ones they stay the same.
"""

import numpy as np
from jaxtyping import Float, Int, Num


def taps(uv: Float[np.ndarray, "p 2"], size: int) -> tuple[Int[np.ndarray, "p 4"], Float[np.ndarray, "p 4"]]:
    """The four texels around each place, counted row by row, and their weights, which sum to 1."""
    places = np.clip(uv.astype(np.float64) * size - 0.5, 0, size - 1)
    first = np.minimum(places.astype(np.int64), max(size - 2, 0))
    (x, y), (column, row) = (places - first).T, first.T
    right, below = np.minimum(column + 1, size - 1), np.minimum(row + 1, size - 1)
    index = np.stack([row * size + column, row * size + right, below * size + column, below * size + right], axis=1)
    return index, np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y], axis=1)


def lookup(image: Num[np.ndarray, "n n c"], uv: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p c"]:
    """Values of an image at texture coordinates."""
    index, weights = taps(uv, len(image))
    return np.einsum("pt,ptc->pc", weights, image.reshape(-1, image.shape[-1])[index].astype(np.float64))
