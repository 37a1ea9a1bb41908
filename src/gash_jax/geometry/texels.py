"""Which face of a mesh lies at each texel of its texture, and where on it.

A texel whose centre lies on a face stands for the point of the face at its centre. Bilinear lookups at the rim of a
chart reach texels whose centres lie beside it: every other texel within `REACH` of a face stands for the nearest point
of the nearest face. So whatever a face looks up was worked out on a face, be it smaller than a texel or without area in
the texture; texels beyond are looked up by none.

Faces are cut into rows of texels and these into texels, by repetition of array elements in blocks of `BLOCK`: memory is
bounded, whatever the size of faces and texture. Places are in texels, the centres at whole numbers.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

REACH = 2**0.5  # texels; a bilinear lookup reaches those less than one away in both directions
BLOCK = 1 << 15
DEEP = 0.02  # texels from its edges at which a centre lies inside a face beyond doubt


class Texels(NamedTuple):
    """The texels that stand for a point on a face, in their order row by row."""

    texel: Int[np.ndarray, "t"]  # row * size + column
    face: Int[np.ndarray, "t"]
    barycentric: Float[np.ndarray, "t 3"]  # of the point on its face
    inside: Bool[np.ndarray, "t"]  # whether the centre lies on the face
    doubled: int  # centres that lie on two faces or more


def find_texels(uv: Float[np.ndarray, "f 3 2"], size: int) -> Texels:
    """The texels of faces with texture coordinates from 0 to 1, in a texture of `size` x `size`.

    Of several faces at a centre, or equally far from it, the first counts.
    """
    corners = uv.astype(np.float64) * size - 0.5
    nearest = np.full(size * size, np.inf, np.float32)
    face_at = np.full(size * size, -1, np.int32)
    deep = np.zeros(size * size, np.uint16)
    for face, row, column in _candidates(corners, size):
        texel = row * size + column
        distance, _, depth = _closest(np.stack([column, row], axis=1), corners[face])
        np.add.at(deep, texel[depth > DEEP], 1)
        near = distance < REACH
        face, texel, distance = face[near], texel[near], distance[near].astype(np.float32)
        order = np.lexsort((face, distance, texel))
        first = order[np.flatnonzero(np.diff(texel[order], prepend=-1))]
        first = first[distance[first] < nearest[texel[first]]]
        nearest[texel[first]], face_at[texel[first]] = distance[first], face[first]
    index = np.flatnonzero(face_at >= 0)
    face, barycentric = face_at[index], np.zeros((len(index), 3), np.float32)
    for start in range(0, len(index), BLOCK):
        part = slice(start, start + BLOCK)
        centre = np.stack(np.divmod(index[part], size)[::-1], axis=1)
        barycentric[part] = _closest(centre, corners[face[part]])[1]
    return Texels(index, face, barycentric, nearest[index] == 0, int(np.count_nonzero(deep > 1)))


def _candidates(
    corners: Float[np.ndarray, "f 3 2"], size: int
) -> Iterator[tuple[Int[np.ndarray, "b"], Int[np.ndarray, "b"], Int[np.ndarray, "b"]]]:
    """Blocks of faces with the rows and columns of texels that may be within reach of them."""
    y = corners[..., 1]
    top = np.clip(np.ceil(y.min(axis=1) - REACH), 0, size - 1).astype(np.int64)
    bottom = np.clip(np.floor(y.max(axis=1) + REACH), 0, size - 1).astype(np.int64)
    for face, step in _repeated(bottom - top + 1):
        row = top[face] + step
        low, high = _extent(corners[face], row - REACH, row + REACH)
        left = np.clip(np.ceil(low - REACH), 0, size - 1).astype(np.int64)
        right = np.clip(np.floor(high + REACH), 0, size - 1).astype(np.int64)
        for pair, across in _repeated(right - left + 1):
            yield face[pair], row[pair], left[pair] + across


def _repeated(counts: Int[np.ndarray, "n"]) -> Iterator[tuple[Int[np.ndarray, "b"], Int[np.ndarray, "b"]]]:
    """Each number of an item counts[i] times, beside 0, 1, ... counts[i] - 1; in blocks."""
    ends = np.cumsum(counts)
    for start in range(0, int(ends[-1]), BLOCK):
        entry = np.arange(start, min(start + BLOCK, int(ends[-1])))
        item = np.searchsorted(ends, entry, side="right")
        yield item, entry - (ends[item] - counts[item])


def _extent(
    corners: Float[np.ndarray, "b 3 2"], above: Float[np.ndarray, "b"], below: Float[np.ndarray, "b"]
) -> tuple[Float[np.ndarray, "b"], Float[np.ndarray, "b"]]:
    """The least and the greatest x of a triangle between two lines of constant y, one of which it may only touch."""
    x, y = np.moveaxis(corners, -1, 0)
    low, high = np.full(len(x), np.inf), np.full(len(x), -np.inf)
    for a, b in ((0, 1), (1, 2), (2, 0)):
        rise = y[:, b] - y[:, a]
        for line in (above, below):
            along = np.clip((line - y[:, a]) / np.where(rise == 0, 1, rise), 0, 1)  # an end where they do not meet
            height = y[:, a] + along * rise
            within = (height >= above - 1e-9) & (height <= below + 1e-9)
            found = x[:, a] + along * (x[:, b] - x[:, a])
            low = np.where(within, np.minimum(low, found), low)
            high = np.where(within, np.maximum(high, found), high)
    nothing = low > high  # rounding: look everywhere
    return np.where(nothing, x.min(axis=1), low), np.where(nothing, x.max(axis=1), high)


def _closest(
    points: Int[np.ndarray, "b 2"], corners: Float[np.ndarray, "b 3 2"]
) -> tuple[Float[np.ndarray, "b"], Float[np.ndarray, "b 3"], Float[np.ndarray, "b"]]:
    """Distance to a triangle, barycentric coordinates of its nearest point, and depth inside (-1 outside)."""
    x, y = np.moveaxis(corners, -1, 0)
    dx, dy = (np.roll(values, -1, axis=1) - values for values in (x, y))  # along edge i, from corner i
    px, py = points[:, :1] - x, points[:, 1:] - y
    cross = dx * py - dy * px  # twice the area between edge i and the point
    area = cross.sum(axis=1, keepdims=True)
    inside = np.all(cross * np.sign(area) >= 0, axis=1) & (area[:, 0] != 0)
    squares = dx * dx + dy * dy
    distance, depth = np.zeros(len(points)), np.full(len(points), -1.0)
    depth[inside] = np.min(np.abs(cross[inside]) / np.sqrt(squares[inside]), axis=1)
    # edge i + 1 lies across from corner i
    barycentric = np.roll(cross, -1, axis=1) / np.where(area == 0, 1, area)
    out = np.flatnonzero(~inside)
    dx, dy, px, py, squares = (values[out] for values in (dx, dy, px, py, squares))
    along = np.clip((dx * px + dy * py) / np.where(squares > 0, squares, 1), 0, 1)
    apart = (px - along * dx) ** 2 + (py - along * dy) ** 2
    edge, each = np.argmin(apart, axis=1), np.arange(len(out))
    distance[out] = np.sqrt(apart[each, edge])
    barycentric[out] = 0
    barycentric[out, edge], barycentric[out, (edge + 1) % 3] = 1 - along[each, edge], along[each, edge]
    return distance, barycentric, depth
