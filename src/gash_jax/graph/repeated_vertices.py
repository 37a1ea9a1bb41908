"""Vertices that a file has more than once: a texture seam splits them, and leaves place and normal alone.

Such vertices are one point of the surface, and a network that is asked about each of them by itself gives as many
answers, which shows as a seam. Places count as one where they are equal, normals within 1 / STEPS.
"""

import numpy as np
from jaxtyping import Float, Int

from gash_jax.geometry.topology import weld

STEPS = 4096
# odd numbers of 64 bits: products of the columns with them are added up, which tells rows apart
_FACTORS = np.random.default_rng(0).integers(0, 1 << 63, 6, np.uint64) | np.uint64(1)


def first_of_repeated(places: Float[np.ndarray, "v 3"], normals: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, "v"]:
    """For each vertex the first one at its place with its normal: most often itself."""
    count = len(places)
    # + 0: no zero is negative
    rows = np.concatenate([places, np.rint(STEPS * normals)], axis=1, dtype=np.float32) + np.float32(0)
    bits = np.ascontiguousarray(rows.T).view(np.uint32)
    codes = sum(column.astype(np.uint64) * factor for column, factor in zip(bits, _FACTORS, strict=True))
    codes = np.sort(codes)
    if not np.any(codes[1:] == codes[:-1]):  # as in most files
        return np.arange(count)
    label = weld(rows)
    first = np.full(count, count)
    np.minimum.at(first, label, np.arange(count))
    return first[label]
