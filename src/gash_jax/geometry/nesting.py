"""Which closed sheets of faces lie inside which others.

A sheet is inside another if its bounding box is and if sample points of it are, by the winding number of the
outer sheet: the signed number of crossings with a ray. The ray has a fixed direction that no modelling tool
would produce, so it does not run through edges or vertices of axis-aligned models.

Boxes and faces are looked for among those that begin in the right interval of one coordinate, all at once in arrays
of bounded size: scenes of many thousand parts take seconds.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

SAMPLES = 7  # points of a sheet that must all be inside
_AT_ONCE = 1 << 20  # pairs of boxes, or of points and faces, compared at once


class _Shells(NamedTuple):
    """Triangles grouped by sheet and ordered by where they begin along y, with their boxes."""

    triangles: Float[np.ndarray, "f 3 3"]
    near: Float[np.ndarray, "3 f"]
    far: Float[np.ndarray, "3 f"]
    starts: Int[np.ndarray, "t"]  # first triangle of each sheet, and the number of all
    tallest: Float[np.ndarray, "m"]  # largest extent along y of a triangle of each sheet


def containment(
    triangles: Float[np.ndarray, "f 3 3"], sheet: Int[np.ndarray, "f"], solid: Bool[np.ndarray, "s"]
) -> Int[np.ndarray, "p 2"]:
    """Pairs (i, j): the i-th solid sheet lies inside the j-th; every such pair once, in order of i, then of j.

    `triangles` are the corners of all faces with consistent winding in each sheet, `sheet` the sheet of each
    face; only the sheets marked `solid` take part, numbered in order of their index.
    """
    from scipy.spatial.transform import Rotation  # slow to import, and few meshes have several closed sheets

    number = np.where(solid, np.cumsum(solid) - 1, -1)[sheet]
    order = np.argsort(number, kind="stable")[np.count_nonzero(number < 0) :]
    number = number[order]
    turned = triangles[order] @ Rotation.from_rotvec([0.613, -1.127, 0.829]).as_matrix().T
    starts = np.searchsorted(number, np.arange(np.count_nonzero(solid) + 1))
    near, far = turned.min(axis=1), turned.max(axis=1)
    low, high = np.minimum.reduceat(near, starts[:-1]), np.maximum.reduceat(far, starts[:-1])
    picks = np.linspace(starts[:-1], starts[1:] - 1, SAMPLES).astype(np.int64)
    rising = np.lexsort((near[:, 1], number))
    tallest = np.maximum.reduceat(far[:, 1] - near[:, 1], starts[:-1])
    shells = _Shells(turned[rising], near[rising].T.copy(), far[rising].T.copy(), starts, tallest)
    found = [np.zeros((0, 2), dtype=np.int64)]
    for pairs in _boxes_inside(low, high):
        for pick in picks:  # most pairs fail at the first sample
            points = turned[pick[pairs[:, 0]]].mean(axis=1)
            pairs = pairs[_winding_numbers(points, pairs[:, 1], shells) != 0]
        found.append(pairs)
    pairs = np.concatenate(found)
    return pairs[np.lexsort(pairs.T[::-1])]


def _boxes_inside(low: Float[np.ndarray, "m 3"], high: Float[np.ndarray, "m 3"]) -> Iterator[Int[np.ndarray, "p 2"]]:
    """Pairs (i, j) with box i strictly inside box j, some at a time."""
    orders = np.argsort(low, axis=0)
    ranges = []
    for axis, order in enumerate(orders.T):
        begins = low[order, axis]
        first = np.searchsorted(begins, low[:, axis], side="right")
        ranges.append((first, np.maximum(np.searchsorted(begins, high[:, axis]) - first, 0)))
    axis = int(np.argmin([counts.sum() for _, counts in ranges]))
    first, counts = ranges[axis]
    for outer, place in _expanded(first, counts):
        inner = orders[place, axis]
        for along in np.roll(np.arange(3), -axis):
            within = (low[inner, along] > low[outer, along]) & (high[inner, along] < high[outer, along])
            inner, outer = inner[within], outer[within]
        yield np.stack([inner, outer], axis=1)


def _winding_numbers(
    points: Float[np.ndarray, "p 3"], sheets: Int[np.ndarray, "p"], shells: _Shells
) -> Int[np.ndarray, "p"]:
    """Signed crossings of the ray from each point along +x with the triangles of its sheet."""
    windings = np.zeros(len(points), dtype=np.int64)
    begins, stops, height = shells.near[1], shells.starts[sheets + 1], points[:, 1]
    last = _bisect(begins, shells.starts[sheets], stops, height)
    # a triangle that begins lower than the tallest one is high ends below the point; a rounding error more is kept
    reach = shells.tallest[sheets] * (1 + 1e-9) + 1e-9 * np.abs(height)
    first = _bisect(begins, shells.starts[sheets], stops, height - reach)
    for which, face in _expanded(first, last - first):
        for axis in (2, 1):
            at = points[which, axis]
            across = (shells.near[axis, face] <= at) & (shells.far[axis, face] >= at)
            which, face = which[across], face[across]
        x, y, z = np.moveaxis(shells.triangles[face] - points[which, None], 2, 0)
        # edge functions: twice the areas of the sub-triangles that the ray makes in the yz plane
        parts = y[:, [1, 2, 0]] * z[:, [2, 0, 1]] - y[:, [2, 0, 1]] * z[:, [1, 2, 0]]
        sign = np.all(parts > 0, axis=1).astype(np.int64) - np.all(parts < 0, axis=1)
        ahead = np.einsum("fc,fc->f", parts, x) * sign > 0
        np.add.at(windings, which[ahead], sign[ahead])
    return windings


def _bisect(
    values: Float[np.ndarray, "f"], first: Int[np.ndarray, "p"], stop: Int[np.ndarray, "p"], limit: np.ndarray
) -> Int[np.ndarray, "p"]:
    """For each range of `values`, ascending in it, the first place with a value above the limit (`stop` if none)."""
    first, stop = first.copy(), stop.copy()
    while np.any(first < stop):
        middle = (first + stop) // 2
        below = values[np.minimum(middle, len(values) - 1)] <= limit
        first, stop = np.where(below & (first < stop), middle + 1, first), np.where(below, stop, middle)
    return first


def _expanded(
    first: Int[np.ndarray, "n"], counts: Int[np.ndarray, "n"]
) -> Iterator[tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]]:
    """The ranges first[k] ... first[k] + counts[k] as pairs (k, element), some whole ranges at a time."""
    ends = np.cumsum(counts)
    start = 0
    while start < len(counts):
        done = int(ends[start - 1]) if start else 0
        stop = max(start + 1, int(np.searchsorted(ends, done + _AT_ONCE, side="right")))
        part = slice(start, stop)
        owner = np.repeat(np.arange(start, stop), counts[part])
        offset = np.arange(len(owner)) - np.repeat(ends[part] - counts[part] - done, counts[part])
        yield owner, first[owner] + offset
        start = stop
