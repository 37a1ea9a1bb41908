"""The formula of `surfel_cover` as compiled loops over pairs, for arrays on the host.

Most leaves beside a vertex do not reach above its horizon, and take no time here. Kernels call nothing of other files,
as Numba looks for changes in this one alone.
"""

from typing import no_type_check

import numpy as np

from gash_jax.files.compiled import compiled

# plain numbers would make float64 of all
ZERO = np.float32(0)
TINY = np.float32(1e-20)
PER_TURN = np.float32(0.5 / np.pi)

_compiled = compiled()


@_compiled
@no_type_check
def add_cover(vertex, leaf, weight, face, piece, pieces, faces, positions, normals, flat, touching, found):
    """Add to `found` (v, 3) what the leaves of all pairs cover."""
    for pair in range(len(vertex)):
        v = vertex[pair]
        parts, corners = pieces[piece[leaf[pair]]], faces[face[leaf[pair]]]
        own, up = (positions[v, 0], positions[v, 1], positions[v, 2]), (normals[v, 0], normals[v, 1], normals[v, 2])
        a = _corner(parts[0], corners, positions, own)
        b = _corner(parts[1], corners, positions, own)
        c = _corner(parts[2], corners, positions, own)
        if not (_dot(a, up) > flat or _dot(b, up) > flat or _dot(c, up) > flat):
            continue
        nowhere = (ZERO, ZERO, ZERO)
        total, gone, back = _with_edge(nowhere, nowhere, nowhere, a, b, up)
        total, gone, back = _with_edge(total, gone, back, b, c, up)
        total, gone, back = _with_edge(total, gone, back, c, a, up)
        total = _turned(total, gone, back)
        plane = _cross((b[0] - a[0], b[1] - a[1], b[2] - a[2]), (c[0] - a[0], c[1] - a[1], c[2] - a[2]))
        away = _dot(plane, a) / np.sqrt(_dot(plane, plane) + TINY)
        towards = away / np.sqrt(away * away + touching * touching)
        height = _dot(total, up) / np.sqrt(_dot(total, total) + TINY) * towards
        if height > ZERO:
            for i in range(3):
                found[v, i] += weight[pair] * height * towards * total[i]


@_compiled
@no_type_check
def keep_others(vertex, leaf, weight, vertices, face, faces):
    """Number the vertices as `vertices` does, and keep in place the leaves that are no part of their own faces."""
    kept = 0
    for pair in range(len(vertex)):
        v, row = vertices[vertex[pair]], face[leaf[pair]]
        if faces[row, 0] != v and faces[row, 1] != v and faces[row, 2] != v:
            vertex[kept], leaf[kept], weight[kept] = v, leaf[pair], weight[pair]
            kept += 1
    return kept


@_compiled
@no_type_check
def _corner(parts, corners, positions, own):
    """A corner of a part of a face, seen from the vertex."""
    x, y, z = -own[0], -own[1], -own[2]
    for k in range(3):
        x += parts[k] * positions[corners[k], 0]
        y += parts[k] * positions[corners[k], 1]
        z += parts[k] * positions[corners[k], 2]
    return x, y, z


@_compiled
@no_type_check
def _with_edge(total, gone, back, a, b, up):
    """And what of an edge stands above the horizon; where the outline goes below it, and where it comes back."""
    above, then = _dot(a, up), _dot(b, up)
    if above < ZERO and then < ZERO:
        return total, gone, back
    if above >= ZERO and then >= ZERO:
        return _turned(total, a, b), gone, back
    share = above / (above - then)
    horizon = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
    if above >= ZERO:
        return _turned(total, a, horizon), horizon, back
    return _turned(total, horizon, b), gone, horizon


@_compiled
@no_type_check
def _turned(total, a, b):
    """And t a x b / |a x b| / 2 pi; 0 of an edge that is a point."""
    cross = _cross(a, b)
    sine = np.sqrt(_dot(cross, cross) + TINY)
    angle = PER_TURN * np.arctan2(sine, _dot(a, b)) / sine
    return total[0] + angle * cross[0], total[1] + angle * cross[1], total[2] + angle * cross[2]


@_compiled
@no_type_check
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_compiled
@no_type_check
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
