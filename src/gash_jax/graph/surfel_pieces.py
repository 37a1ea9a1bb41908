"""How faces are cut into the leaves of the tree of surfels: large ones evenly, long ones across.

A face is cut into k² equal parts, its own shape on a smaller scale, so that the whole surface has about LEAVES of them.
A sliver would stay a sliver: where it is still longer than its share asks for, it is cut across into m slices of equal
length instead, and all of these but the one at its tip into two triangles.

Every way of cutting is a table of barycentric corners, and a leaf is the number of its piece in all of them (PIECES).
"""

import numpy as np
from jaxtyping import Float, Int

# leaves to aim at where the mesh has fewer faces, and the most parts along an edge
LEAVES, MOST_PARTS = 8192, 8
# slices of a sliver at most; leaves that slicing may add to a mesh, about; a sliver is so many times as long as wide
MOST_SLICES, MOST_SLICED, SLIVER = 16, 32768, 2.0
# edge of an equilateral triangle of area 1
EDGE = 1.52


def _parts(k: int) -> Float[np.ndarray, "m 3 3"]:
    """Barycentric corners of the k² equal parts of a triangle."""
    point = lambda i, j: (k - i - j, i, j)  # noqa: E731
    upright = [[point(i, j), point(i + 1, j), point(i, j + 1)] for i in range(k) for j in range(k - i)]
    turned = [
        [point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)] for i in range(k) for j in range(k - i) if i + j < k - 1
    ]
    return np.array(upright + turned, np.float32) / np.float32(k)


def _slices(m: int, tip: int) -> Float[np.ndarray, "n 3 3"]:
    """Barycentric corners of the 2 m - 1 triangles of m slices towards corner number `tip`."""
    side = [(m - i, 0, i) for i in range(m + 1)]
    other = [(0, m - i, i) for i in range(m + 1)]
    parts = [[side[i], other[i], side[i + 1]] for i in range(m)]
    parts += [[other[i], other[i + 1], side[i + 1]] for i in range(m - 1)]
    return np.roll(np.array(parts, np.float32) / np.float32(m), tip - 2, axis=2)


# k = 1 to MOST_PARTS, then m = 2 to MOST_SLICES towards each of the three corners
_WAYS = [_parts(k) for k in range(1, MOST_PARTS + 1)]
_WAYS += [_slices(m, tip) for m in range(2, MOST_SLICES + 1) for tip in range(3)]
PIECES = np.concatenate(_WAYS)
PIECE_COUNT = np.array([len(way) for way in _WAYS])
PIECE_START = np.cumsum(PIECE_COUNT) - PIECE_COUNT


def cut_faces(
    positions: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], area: Float[np.ndarray, "f"]
) -> tuple[Int[np.ndarray, "l"], Int[np.ndarray, "l"]]:
    """Face and piece of every leaf, face by face; areas in the units of the positions."""
    even = np.sqrt(area.sum() / LEAVES) + np.finfo(float).tiny
    parts = np.clip(np.ceil(np.sqrt(area) / even), 1, MOST_PARTS).astype(np.int64)
    way = parts - 1
    # opposite corner 0, 1, 2
    sides = [_length(positions, faces[:, i - 2], faces[:, i - 1]) for i in range(3)]
    length, width = np.maximum.reduce(sides), np.minimum.reduce(sides)
    slivers = np.flatnonzero(length > np.maximum(SLIVER * width, EDGE * even * parts))
    if len(slivers):
        long, wide = length[slivers], width[slivers]
        thick = np.maximum(wide, max(EDGE * even, 2 * float(long.sum()) / MOST_SLICED))
        slices = np.clip(np.ceil(long / thick), 1, MOST_SLICES).astype(np.int64)
        tip = np.argmin([side[slivers] for side in sides], axis=0)
        better = slices > parts[slivers]
        way[slivers[better]] = (MOST_PARTS + 3 * (slices - 2) + tip)[better]
    count = PIECE_COUNT[way]
    face = np.repeat(np.arange(len(faces), dtype=np.int32), count)
    first = np.cumsum(count) - count
    return face, (np.arange(len(face)) - np.repeat(first - PIECE_START[way], count)).astype(np.int32)


def _length(positions: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    x, y, z = (positions.take(b, axis=0) - positions.take(a, axis=0)).T
    return np.sqrt(x * x + y * y + z * z)
