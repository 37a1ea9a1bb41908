"""What `SurfelNet.encode` pools over the corners of a vertex's own faces, compiled by Numba: see `surfel_kernel`.

All CORNERS of them make one block: number i of corner j is c[i * CORNERS + j].
"""

from typing import no_type_check

import numpy as np

from gash_jax.files.compiled import compiled

CORNERS = 8
# of a corner: direction, normal, distance, one channel, features
CHANNEL, FEATURES, FEATURE_COUNT = 7 * CORNERS, 8 * CORNERS, 14
NUMBERS = FEATURES + FEATURE_COUNT * CORNERS

_F = np.float32
_compiled = compiled(fastmath={"reassoc", "nsz", "arcp", "contract", "afn"})


@_compiled
@no_type_check
def pool_corners(near, normal, frames, layer, constants, start, pooled, rise):
    """Write columns of `pooled` from `start` on, means and maxima over corners, and how far they `rise` in the mean.

    And of their mean distance the fourth root, third from the end.
    """
    floor, tiny, rounding = constants
    c = np.empty(NUMBERS, np.float32)
    for v in range(len(near)):
        rise[v], edge = _seen(near, v, (normal[v, 0], normal[v, 1], normal[v, 2]), floor, rounding, c)
        _described(c, edge, frames, tiny, v)
        _pooled(c, layer, v, start, pooled)
        pooled[v, start + 2 * len(layer) + 2] = _fourth_root(edge, tiny)


@_compiled
@no_type_check
def _seen(near, v, n, floor, rounding, c):
    """Direction, normal and distance of the corners, as rows; means of their rise and of their distance."""
    rise, edge = _F(0), _F(0)
    for j in range(CORNERS):
        for i in range(6):
            c[CORNERS * i + j] = near[v, 6 * j + i]
    for j in range(CORNERS):
        x, y, z = c[j], c[CORNERS + j], c[2 * CORNERS + j]
        away = np.sqrt(x * x + y * y + z * z + floor)
        inverse = _F(1) / away
        x, y, z = x * inverse, y * inverse, z * inverse
        c[j], c[CORNERS + j], c[2 * CORNERS + j], c[6 * CORNERS + j] = x, y, z, away
        edge += away
        up = x * n[0] + y * n[1] + z * n[2] - rounding * inverse
        rise += up if up > _F(0) else _F(0)
    return rise / _F(CORNERS), edge / _F(CORNERS)


@_compiled
@no_type_check
def _described(c, edge, frames, tiny, v):
    """Features of the corners, in the order of `surfel_pairs`."""
    a, b, n = _axis(frames, v, 0), _axis(frames, v, 1), _axis(frames, v, 2)
    per = _F(1) / (edge + _F(1e-9))
    for j in range(CORNERS):
        u, m = (c[j], c[CORNERS + j], c[2 * CORNERS + j]), (c[3 * CORNERS + j], c[4 * CORNERS + j], c[5 * CORNERS + j])
        x, y, z, away = _dot(u, a), _dot(u, b), _dot(u, n), c[6 * CORNERS + j]
        f = FEATURES + j
        c[f], c[f + CORNERS], c[f + 2 * CORNERS] = x, y, z
        c[f + 3 * CORNERS], c[f + 4 * CORNERS], c[f + 5 * CORNERS] = x * y, y * z, x * z
        c[f + 6 * CORNERS], c[f + 7 * CORNERS] = _F(0.5) * (x * x - y * y), z * z
        c[f + 8 * CORNERS], c[f + 9 * CORNERS], c[f + 10 * CORNERS] = _dot(m, a), _dot(m, b), _dot(m, n)
        c[f + 11 * CORNERS], c[f + 12 * CORNERS] = _dot(m, u), away * per
        c[f + 13 * CORNERS] = _fourth_root(away, tiny)


@_compiled
@no_type_check
def _pooled(c, layer, v, start, pooled):
    """Mean and largest over the corners of ReLU(W f + b), from column `start` on."""
    channels = len(layer)
    for k in range(channels):
        # here, as for all that LLVM knows what is written below might be the layer
        first, second, third = _weights(layer, k, 0), _weights(layer, k, 4), _weights(layer, k, 8)
        last, bias = (layer[k, 12], layer[k, 13]), layer[k, FEATURE_COUNT]
        for j in range(CORNERS):
            f = FEATURES + j
            h = bias + _four(first, c, f, CORNERS) + _four(second, c, f + 4 * CORNERS, CORNERS)
            h += _four(third, c, f + 8 * CORNERS, CORNERS)
            h += last[0] * c[f + 12 * CORNERS] + last[1] * c[f + 13 * CORNERS]
            c[CHANNEL + j] = h if h > _F(0) else _F(0)
        total, most = _F(0), _F(0)
        for j in range(CORNERS):
            total += c[CHANNEL + j]
        for j in range(CORNERS):
            most = c[CHANNEL + j] if c[CHANNEL + j] > most else most
        pooled[v, start + k], pooled[v, start + channels + k] = total / _F(CORNERS), most


@_compiled
@no_type_check
def _weights(layer, c, i):
    """Four weights of a channel, from feature i on."""
    return layer[c, i], layer[c, i + 1], layer[c, i + 2], layer[c, i + 3]


@_compiled
@no_type_check
def _four(w, x, at, step):
    """Four terms of W f; of a loop over them LLVM would make the vectors."""
    return w[0] * x[at] + w[1] * x[at + step] + w[2] * x[at + 2 * step] + w[3] * x[at + 3 * step]


@_compiled
@no_type_check
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_compiled
@no_type_check
def _axis(frames, v, i):
    return frames[v, 0, i], frames[v, 1, i], frames[v, 2, i]


@_compiled
@no_type_check
def _fourth_root(x, tiny):
    return np.sqrt(np.sqrt(x if x > tiny else tiny))
