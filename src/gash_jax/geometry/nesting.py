"""Which closed sheets of faces lie inside which others.

A sheet is inside another if its bounding box is and if sample points of it are, by the winding number of the
outer sheet: the signed number of crossings with a ray. The ray has a fixed direction that no modelling tool
would produce, so it does not run through edges or vertices of axis-aligned models.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

SAMPLES = 7  # points of a sheet that must all be inside


def containment(
    triangles: Float[np.ndarray, "f 3 3"], sheet: Int[np.ndarray, "f"], solid: Bool[np.ndarray, "s"]
) -> Bool[np.ndarray, "m m"]:
    """inside[i, j]: the i-th solid sheet lies inside the j-th.

    `triangles` are the corners of all faces with consistent winding in each sheet, `sheet` the sheet of each
    face; only the m sheets marked `solid` take part, in order of their index.
    """
    from scipy.spatial.transform import Rotation  # slow to import, and few meshes have several closed sheets

    number = np.where(solid, np.cumsum(solid) - 1, -1)[sheet]
    order = np.argsort(number, kind="stable")[np.count_nonzero(number < 0) :]
    turned = triangles[order] @ Rotation.from_rotvec([0.613, -1.127, 0.829]).as_matrix().T
    count = np.count_nonzero(solid)
    starts = np.searchsorted(number[order], np.arange(count + 1))
    near, far = turned.min(axis=1), turned.max(axis=1)
    low, high = np.minimum.reduceat(near, starts[:-1]), np.maximum.reduceat(far, starts[:-1])
    inside = np.zeros((count, count), dtype=bool)
    for outer in range(count):
        shell = slice(starts[outer], starts[outer + 1])
        for inner in np.flatnonzero(np.all((low > low[outer]) & (high < high[outer]), axis=1)):
            picks = np.linspace(starts[inner], starts[inner + 1] - 1, SAMPLES).astype(np.int64)
            inside[inner, outer] = all(
                _winding_number(point, turned[shell], near[shell], far[shell]) != 0
                for point in turned[picks].mean(axis=1)
            )
    return inside


def _winding_number(
    point: Float[np.ndarray, "3"],
    shell: Float[np.ndarray, "f 3 3"],
    near: Float[np.ndarray, "f 3"],
    far: Float[np.ndarray, "f 3"],
) -> int:
    """Signed crossings of the ray from `point` along +x with triangles whose boxes are `near` to `far`."""
    across = (near[:, 1] <= point[1]) & (far[:, 1] >= point[1]) & (near[:, 2] <= point[2]) & (far[:, 2] >= point[2])
    x, y, z = np.moveaxis(shell[across] - point, 2, 0)
    # edge functions: twice the areas of the sub-triangles that the ray makes in the yz plane
    parts = y[:, [1, 2, 0]] * z[:, [2, 0, 1]] - y[:, [2, 0, 1]] * z[:, [1, 2, 0]]
    sign = np.all(parts > 0, axis=1).astype(np.int64) - np.all(parts < 0, axis=1)
    ahead = np.einsum("fc,fc->f", parts, x) * sign > 0
    return int(sign[ahead].sum())
