"""The records of `surfels` as compiled loops, for arrays on the host: leaves, then parents from below.

Kernels call nothing of other files, as Numba looks for changes in this one alone. Row and array are arguments, as a
slice of the array would cost more than what is done with it.
"""

from typing import no_type_check

import numpy as np

from gash_jax.files.compiled import compiled

FAN = 4
# plain numbers would make float64 of all
ZERO, HALF, THREE, TWELVE = np.float32(0), np.float32(0.5), np.float32(3), np.float32(12)
TINIEST = np.finfo(np.float32).tiny
# covariance within a record, and pairs of coordinates in its order
SPREAD, FIRST, SECOND = 14, (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)

# no arithmetic faster than IEEE's: records are the same to the bit on every processor, and in `runtimes/gash_numpy.py`
_compiled = compiled()


@_compiled
@no_type_check
def write_records(face, piece, pieces, faces, positions, sizes, records):
    """Write (s, 20) `records` of a tree with levels of these sizes; those without a surfel are 0, as is the last."""
    start = len(records) - 1 - len(face)
    p = np.empty(9, np.float32)
    for leaf in range(len(face)):
        if face[leaf] >= 0:
            _find_corners(pieces, piece[leaf], faces, face[leaf], positions, p)
            _write_leaf(p, records, start + leaf)
        else:
            _clear(records, start + leaf)
    for level in range(len(sizes) - 2, -1, -1):
        below = start
        start -= sizes[level]
        for i in range(sizes[level]):
            if FAN * i < sizes[level + 1]:
                _write_parent(records, below + FAN * i, start + i)
            else:
                _clear(records, start + i)
    _clear(records, len(records) - 1)


@_compiled
@no_type_check
def _clear(records, row):
    for i in range(records.shape[1]):
        records[row, i] = ZERO


@_compiled
@no_type_check
def _find_corners(pieces, piece, faces, face, positions, p):
    """The corners of a part of a face, one after the other."""
    first, second, third = faces[face, 0], faces[face, 1], faces[face, 2]
    for a in range(3):
        u, v, w = pieces[piece, a, 0], pieces[piece, a, 1], pieces[piece, a, 2]
        for i in range(3):
            p[3 * a + i] = u * positions[first, i] + v * positions[second, i] + w * positions[third, i]


@_compiled
@no_type_check
def _write_leaf(p, records, row):
    """Moments of a triangle; its corners give way to their offsets from its middle."""
    for i in range(3):
        middle = (p[i] + p[3 + i] + p[6 + i]) / THREE
        records[row, i] = middle
        for a in range(0, 9, 3):
            p[a + i] -= middle
    ux, uy, uz, vx, vy, vz = p[3] - p[0], p[4] - p[1], p[5] - p[2], p[6] - p[0], p[7] - p[1], p[8] - p[2]
    x, y, z = HALF * (uy * vz - uz * vy), HALF * (uz * vx - ux * vz), HALF * (ux * vy - uy * vx)
    records[row, 3], records[row, 4], records[row, 5] = x, y, z
    records[row, 6] = np.sqrt(x * x + y * y + z * z)
    for n in range(6):
        i, j = FIRST[n], SECOND[n]
        records[row, SPREAD + n] = (p[i] * p[j] + p[3 + i] * p[3 + j] + p[6 + i] * p[6 + j]) / TWELVE
    _complete(records, row)


@_compiled
@no_type_check
def _write_parent(records, child, row):
    """Moments of a family, by the parallel-axis theorem."""
    for i in range(3, 7):
        records[row, i] = _sum(records[child, i], records[child + 1, i], records[child + 2, i], records[child + 3, i])
    total = records[row, 6] if records[row, 6] > TINIEST else TINIEST
    a, b, c, d = (
        records[child, 6] / total,
        records[child + 1, 6] / total,
        records[child + 2, 6] / total,
        records[child + 3, 6] / total,
    )
    for i in range(3):
        records[row, i] = _sum(
            a * records[child, i], b * records[child + 1, i], c * records[child + 2, i], d * records[child + 3, i]
        )
    for n in range(6):
        records[row, SPREAD + n] = _sum(
            a * _spread(records, child, row, n),
            b * _spread(records, child + 1, row, n),
            c * _spread(records, child + 2, row, n),
            d * _spread(records, child + 3, row, n),
        )
    _complete(records, row)


@_compiled
@no_type_check
def _sum(a, b, c, d):
    """In this order, whatever is faster."""
    return (a + b) + (c + d)


@_compiled
@no_type_check
def _spread(records, child, row, n):
    """Covariance number n of a child about the middle of its parent."""
    i, j = FIRST[n], SECOND[n]
    away, aside = records[child, i] - records[row, i], records[child, j] - records[row, j]
    return records[child, SPREAD + n] + away * aside


@_compiled
@no_type_check
def _complete(records, row):
    """What follows from the covariance: size, and adjugate."""
    xx, yy, zz = records[row, SPREAD], records[row, SPREAD + 1], records[row, SPREAD + 2]
    xy, xz, yz = records[row, SPREAD + 3], records[row, SPREAD + 4], records[row, SPREAD + 5]
    trace = xx + yy + zz
    records[row, 7] = np.sqrt(trace) if trace > ZERO else ZERO
    records[row, 8], records[row, 9], records[row, 10] = yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy
    records[row, 11], records[row, 12] = xz * yz - xy * zz, xy * yz - xz * yy
    records[row, 13] = xy * xz - xx * yz
