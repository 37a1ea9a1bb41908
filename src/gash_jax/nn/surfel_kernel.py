"""x"""

from typing import Any

import numpy as np
from jaxtyping import Float
from numba import njit

from gash_jax.nn import surfel_pairs as pairs
from gash_jax.nn.surfel_pairs import Part

MOST = 256
STRIDE = MOST + 16
LANES = 8
_F = np.float32
_jit = njit(nogil=True, fastmath=True, error_model="numpy", cache=True)

# rows of the scratch
U, VECTOR, AREA, SIZE, FORM, SPREAD = (STRIDE * i for i in (0, 3, 6, 7, 8, 14))
SHARE, DISTANCE, COVERED, ANGLE, HEIGHT, REACH, ABOVE, PARTLY = (STRIDE * i for i in range(20, 28))
FEATURES = STRIDE * 28
TOP = STRIDE * 44
ROWS = 45
NEAR_FEATURES = 14


@_jit
def _gather(records, table, weight, v, count, position, s):
    px, py, pz = position[v, 0], position[v, 1], position[v, 2]
    blocks = (count + LANES - 1) // LANES
    end = blocks * LANES
    stored = min(end, table.shape[1])
    for j in range(stored):
        row = table[v, j]
        s[U + j] = records[row, 0] - px
        s[U + STRIDE + j] = records[row, 1] - py
        s[U + 2 * STRIDE + j] = records[row, 2] - pz
        s[VECTOR + j] = records[row, 3]
        s[VECTOR + STRIDE + j] = records[row, 4]
        s[VECTOR + 2 * STRIDE + j] = records[row, 5]
        s[AREA + j] = records[row, 6]
        s[SIZE + j] = records[row, 7]
        s[FORM + j] = records[row, 8]
        s[FORM + STRIDE + j] = records[row, 9]
        s[FORM + 2 * STRIDE + j] = records[row, 10]
        s[FORM + 3 * STRIDE + j] = records[row, 11]
        s[FORM + 4 * STRIDE + j] = records[row, 12]
        s[FORM + 5 * STRIDE + j] = records[row, 13]
        s[SPREAD + j] = records[row, 14]
        s[SPREAD + STRIDE + j] = records[row, 15]
        s[SPREAD + 2 * STRIDE + j] = records[row, 16]
        s[SPREAD + 3 * STRIDE + j] = records[row, 17]
        s[SPREAD + 4 * STRIDE + j] = records[row, 18]
        s[SPREAD + 5 * STRIDE + j] = records[row, 19]
        s[SHARE + j] = weight[v, j]
    for j in range(stored, end):
        for row in range(21):
            s[row * STRIDE + j] = _F(0)
    return blocks


@_jit
def _weigh(s, blocks, nx, ny, nz, constants):
    floor, tiny, rounding, smallest, farthest, edge_on = constants
    four_pi = _F(4 * np.pi)
    sx, sy, sz, total, most, even = _F(0), _F(0), _F(0), _F(0), _F(0), _F(0)
    for j in range(blocks * LANES):
        x, y, z = s[U + j], s[U + STRIDE + j], s[U + 2 * STRIDE + j]
        square = x * x + y * y + z * z + floor
        distance = np.sqrt(square)
        inverse = _F(1) / distance
        x, y, z = x * inverse, y * inverse, z * inverse
        s[U + j], s[U + STRIDE + j], s[U + 2 * STRIDE + j] = x, y, z
        s[DISTANCE + j] = distance
        area = s[AREA + j]
        q = s[FORM + j] * x * x + s[FORM + STRIDE + j] * y * y + s[FORM + 2 * STRIDE + j] * z * z
        q += _F(2) * (s[FORM + 3 * STRIDE + j] * x * y + s[FORM + 4 * STRIDE + j] * x * z + s[FORM + 5 * STRIDE + j] * y * z)
        q = q if q > _F(0) else _F(0)
        least = area * edge_on
        projected = four_pi * np.sqrt(q + least * least + smallest * smallest)
        covered = projected if projected < area else area
        s[COVERED + j] = covered
        angle = covered / (covered + square)
        s[ANGLE + j] = angle
        height = x * nx + y * ny + z * nz
        s[HEIGHT + j] = height
        q = s[SPREAD + j] * nx * nx + s[SPREAD + STRIDE + j] * ny * ny + s[SPREAD + 2 * STRIDE + j] * nz * nz
        q += _F(2) * (s[SPREAD + 3 * STRIDE + j] * nx * ny + s[SPREAD + 4 * STRIDE + j] * nx * nz + s[SPREAD + 5 * STRIDE + j] * ny * nz)
        q = q if q > _F(0) else _F(0)
        reach = np.sqrt(q + tiny) * inverse
        reach = reach if reach < farthest else farthest
        s[REACH + j] = reach
        counted = s[SHARE + j] * angle
        up = height - rounding * inverse
        up = up if up > _F(0) else _F(0)
        above = counted * up
        s[ABOVE + j] = above
        top = height + reach
        top = top if top > _F(0) else _F(0)
        top = top if top < _F(1) else _F(1)
        partly = counted * top
        s[PARTLY + j] = partly
        k = above + _F(1e-3) * partly
        sx += k * x
        sy += k * y
        sz += k * z
        even += k
        total += above
    for j in range(LANES):
        s[TOP + j] = _F(0)
    for block in range(blocks):
        for j in range(LANES):
            above = s[ABOVE + block * LANES + j]
            s[TOP + j] = above if above > s[TOP + j] else s[TOP + j]
    for j in range(LANES):
        most = s[TOP + j] if s[TOP + j] > most else most
    return sx, sy, sz, even, total, most


@_jit
def _describe(s, blocks, frame, v, constants):
    floor, tiny, rounding, smallest, farthest, edge_on = constants
    ax, ay, az = frame[v, 0, 0], frame[v, 1, 0], frame[v, 2, 0]
    bx, by, bz = frame[v, 0, 1], frame[v, 1, 1], frame[v, 2, 1]
    nx, ny, nz = frame[v, 0, 2], frame[v, 1, 2], frame[v, 2, 2]
    for j in range(blocks * LANES):
        ux, uy, uz = s[U + j], s[U + STRIDE + j], s[U + 2 * STRIDE + j]
        vx, vy, vz = s[VECTOR + j], s[VECTOR + STRIDE + j], s[VECTOR + 2 * STRIDE + j]
        x, y, height = ux * ax + uy * ay + uz * az, ux * bx + uy * by + uz * bz, s[HEIGHT + j]
        distance, area, size, covered = s[DISTANCE + j], s[AREA + j], s[SIZE + j], s[COVERED + j]
        covered = covered if covered > smallest else smallest
        area = area if area > smallest else smallest
        flux = -(ux * vx + uy * vy + uz * vz) / covered
        flux = flux if flux > _F(-2) else _F(-2)
        flux = flux if flux < _F(2) else _F(2)
        unit = _F(1) / area
        angle = s[ANGLE + j]
        angle = angle if angle > tiny else tiny
        s[FEATURES + j] = x
        s[FEATURES + STRIDE + j] = y
        s[FEATURES + 2 * STRIDE + j] = height
        s[FEATURES + 3 * STRIDE + j] = x * y
        s[FEATURES + 4 * STRIDE + j] = y * height
        s[FEATURES + 5 * STRIDE + j] = _F(1.5) * height * height - _F(0.5)
        s[FEATURES + 6 * STRIDE + j] = x * height
        s[FEATURES + 7 * STRIDE + j] = _F(0.5) * (x * x - y * y)
        s[FEATURES + 8 * STRIDE + j] = np.sqrt(angle)
        s[FEATURES + 9 * STRIDE + j] = flux
        s[FEATURES + 10 * STRIDE + j] = s[REACH + j]
        s[FEATURES + 11 * STRIDE + j] = size / (size + distance)
        s[FEATURES + 12 * STRIDE + j] = (vx * nx + vy * ny + vz * nz) * unit
        s[FEATURES + 13 * STRIDE + j] = (vx * ax + vy * ay + vz * az) * unit
        s[FEATURES + 14 * STRIDE + j] = (vx * bx + vy * by + vz * bz) * unit
        far = distance if distance > tiny else tiny
        s[FEATURES + 15 * STRIDE + j] = np.sqrt(np.sqrt(far))


@_jit
def _pool(s, blocks, layer, out, v):
    channels = len(layer)
    for c in range(channels):
        w0, w1, w2, w3 = layer[c, 0], layer[c, 1], layer[c, 2], layer[c, 3]
        w4, w5, w6, w7 = layer[c, 4], layer[c, 5], layer[c, 6], layer[c, 7]
        w8, w9, w10, w11 = layer[c, 8], layer[c, 9], layer[c, 10], layer[c, 11]
        w12, w13, w14, w15 = layer[c, 12], layer[c, 13], layer[c, 14], layer[c, 15]
        bias = layer[c, 16]
        a, p = _F(0), _F(0)
        for j in range(blocks * LANES):
            h = bias + w0 * s[FEATURES + j] + w1 * s[FEATURES + STRIDE + j] + w2 * s[FEATURES + 2 * STRIDE + j]
            h += w3 * s[FEATURES + 3 * STRIDE + j] + w4 * s[FEATURES + 4 * STRIDE + j]
            h += w5 * s[FEATURES + 5 * STRIDE + j] + w6 * s[FEATURES + 6 * STRIDE + j]
            h += w7 * s[FEATURES + 7 * STRIDE + j] + w8 * s[FEATURES + 8 * STRIDE + j]
            h += w9 * s[FEATURES + 9 * STRIDE + j] + w10 * s[FEATURES + 10 * STRIDE + j]
            h += w11 * s[FEATURES + 11 * STRIDE + j] + w12 * s[FEATURES + 12 * STRIDE + j]
            h += w13 * s[FEATURES + 13 * STRIDE + j] + w14 * s[FEATURES + 14 * STRIDE + j]
            h += w15 * s[FEATURES + 15 * STRIDE + j]
            h = h if h > _F(0) else _F(0)
            a += h * s[ABOVE + j]
            p += h * s[PARTLY + j]
        out[v, c] = a
        out[v, channels + c] = p


@_jit
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_jit
def _unit(a):
    x, y, z = a
    x, y, z = abs(x), abs(y), abs(z)
    largest = x if x > y else y
    largest = largest if largest > z else z
    if largest < _F(1.1754944e-38):
        return _F(0), _F(0), _F(0)
    x, y, z = a[0] / largest, a[1] / largest, a[2] / largest
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@_jit
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_jit
def _tangential(a, n):
    up = _dot(a, n)
    return a[0] - up * n[0], a[1] - up * n[1], a[2] - up * n[2]


@_jit
def _any_tangent(n):
    x, y, z = n
    ax, ay = abs(x), abs(y)
    largest = ax if ax > ay else ay
    if z < _F(0):
        u, v = (x / largest, y / largest) if largest > _F(1e-30) else (_F(1), y)
        lower = (_F(1) - z) / (u * u + v * v)
        return _F(1) - u * u * lower, -u * v * lower, -x
    upper = _F(1) / (_F(1) + z)
    return _F(1) - x * x * upper, -x * y * upper, -x


@_jit
def _frame(hidden, even, corner, n, constants, frame, v):
    tiny, least_even, faint, cos, sin = constants
    first = _tangential(hidden, n)
    length = np.sqrt(_dot(first, first) + tiny)
    missing = least_even * even + faint - length
    missing = missing if missing > _F(0) else _F(0)
    other = _unit(_tangential(corner, n))
    across = _cross(n, other)
    first = (
        first[0] + missing * (cos * other[0] + sin * across[0]),
        first[1] + missing * (cos * other[1] + sin * across[1]),
        first[2] + missing * (cos * other[2] + sin * across[2]),
    )
    first = _unit(first if _dot(first, first) > _F(1e-16) else _any_tangent(n))
    second = _cross(n, first)
    for i in range(3):
        frame[v, i, 0], frame[v, i, 1], frame[v, i, 2] = first[i], second[i], n[i]


CORNERS = 8


@_jit
def _corners(near, v, c, constants, n):
    """c: (21, 8) flat rows: v, normal, away | 14 features; returns rise, mean of away"""
    floor, tiny, rounding, smallest, farthest, edge_on = constants
    rise, mean = _F(0), _F(0)
    for j in range(CORNERS):
        for i in range(6):
            c[8 * i + j] = near[v, 6 * j + i]
    for j in range(CORNERS):
        x, y, z = c[j], c[8 + j], c[16 + j]
        away = np.sqrt(x * x + y * y + z * z + floor)
        inverse = _F(1) / away
        x, y, z = x * inverse, y * inverse, z * inverse
        c[j], c[8 + j], c[16 + j] = x, y, z
        c[48 + j] = away
        mean += away
        up = x * n[0] + y * n[1] + z * n[2] - rounding * inverse
        rise += up if up > _F(0) else _F(0)
    return rise / _F(CORNERS), mean / _F(CORNERS)


NF = 56
G = NF + 14 * 8


@_jit
def _near(c, mean, frame, v, tiny, layer, out, start):
    ax, ay, az = frame[v, 0, 0], frame[v, 1, 0], frame[v, 2, 0]
    bx, by, bz = frame[v, 0, 1], frame[v, 1, 1], frame[v, 2, 1]
    nx, ny, nz = frame[v, 0, 2], frame[v, 1, 2], frame[v, 2, 2]
    per = _F(1) / (mean + _F(1e-9))
    for j in range(CORNERS):
        vx, vy, vz = c[j], c[8 + j], c[16 + j]
        mx, my, mz = c[24 + j], c[32 + j], c[40 + j]
        x, y, z = vx * ax + vy * ay + vz * az, vx * bx + vy * by + vz * bz, vx * nx + vy * ny + vz * nz
        away = c[48 + j]
        c[NF + j] = x
        c[NF + 8 + j] = y
        c[NF + 16 + j] = z
        c[NF + 24 + j] = x * y
        c[NF + 32 + j] = y * z
        c[NF + 40 + j] = x * z
        c[NF + 48 + j] = _F(0.5) * (x * x - y * y)
        c[NF + 56 + j] = z * z
        c[NF + 64 + j] = mx * ax + my * ay + mz * az
        c[NF + 72 + j] = mx * bx + my * by + mz * bz
        c[NF + 80 + j] = mx * nx + my * ny + mz * nz
        c[NF + 88 + j] = mx * vx + my * vy + mz * vz
        c[NF + 96 + j] = away * per
        far = away if away > tiny else tiny
        c[NF + 104 + j] = np.sqrt(np.sqrt(far))
    channels = len(layer)
    for k in range(channels):
        w0, w1, w2, w3 = layer[k, 0], layer[k, 1], layer[k, 2], layer[k, 3]
        w4, w5, w6, w7 = layer[k, 4], layer[k, 5], layer[k, 6], layer[k, 7]
        w8, w9, w10, w11 = layer[k, 8], layer[k, 9], layer[k, 10], layer[k, 11]
        w12, w13, bias = layer[k, 12], layer[k, 13], layer[k, 14]
        total, most = _F(0), _F(0)
        for j in range(CORNERS):
            h = bias + w0 * c[NF + j] + w1 * c[NF + 8 + j] + w2 * c[NF + 16 + j] + w3 * c[NF + 24 + j]
            h += w4 * c[NF + 32 + j] + w5 * c[NF + 40 + j] + w6 * c[NF + 48 + j] + w7 * c[NF + 56 + j]
            h += w8 * c[NF + 64 + j] + w9 * c[NF + 72 + j] + w10 * c[NF + 80 + j] + w11 * c[NF + 88 + j]
            h += w12 * c[NF + 96 + j] + w13 * c[NF + 104 + j]
            c[G + j] = h if h > _F(0) else _F(0)
        for j in range(CORNERS):
            total += c[G + j]
        for j in range(CORNERS):
            most = c[G + j] if c[G + j] > most else most
        out[v, start + k] = total / _F(CORNERS)
        out[v, start + channels + k] = most


@_jit
def _encode(records, position, normal, near, cover, table, weight, layer, near_layer, constants, turning, pooled, frames, seen):
    s = np.empty(ROWS * STRIDE, np.float32)
    c = np.empty(G + 8, np.float32)
    floor, tiny, rounding, smallest, farthest, edge_on = constants
    wide = len(layer)
    for v in range(len(position)):
        count = table.shape[1]
        while count > 0 and weight[v, count - 1] == _F(0):
            count -= 1
        blocks = _gather(records, table, weight, v, count, position, s)
        n = (normal[v, 0], normal[v, 1], normal[v, 2])
        sx, sy, sz, even, total, most = _weigh(s, blocks, n[0], n[1], n[2], constants)
        rise, edge = _corners(near, v, c, constants, n)
        _frame((sx, sy, sz), even, (c[0], c[8], c[16]), n, turning, frames, v)
        _describe(s, blocks, frames, v, constants)
        _pool(s, blocks, layer, pooled, v)
        _near(c, edge, frames, v, tiny, near_layer, pooled, 2 * wide)
        at = 2 * wide + 2 * len(near_layer)
        pooled[v, at] = total
        pooled[v, at + 1] = most
        edge = edge if edge > tiny else tiny
        pooled[v, at + 2] = np.sqrt(np.sqrt(edge))
        for i in range(3):
            pooled[v, at + 3 + i] = cover[v, 0] * frames[v, 0, i] + cover[v, 1] * frames[v, 1, i] + cover[v, 2] * frames[v, 2, i]
        seen[v] = total + rise + pooled[v, at + 5]


def _layer(params: Any) -> np.ndarray:
    kernel, bias = (np.asarray(params[name], np.float32) for name in ("kernel", "bias"))
    return np.ascontiguousarray(np.concatenate([kernel, bias[None]]).T)


def encode_on_host(params: Any, part: Part, records: Any) -> tuple[Float[np.ndarray, "v c"], Float[np.ndarray, "v 3 3"], Float[np.ndarray, "v"]]:
    """x"""
    arrays = [np.require(part[n], t, ["C", "W"]) for n, t in (("position", np.float32), ("normal", np.float32), ("near", np.float32), ("cover", np.float32), ("table", np.int32), ("weight", np.float32))]
    layer, near_layer = _layer(params["surfel"]), _layer(params["near"])
    count = len(arrays[0])
    pooled = np.empty((count, 2 * len(layer) + 2 * len(near_layer) + 6), np.float32)
    frames, seen = np.empty((count, 3, 3), np.float32), np.empty(count, np.float32)
    constants = tuple(_F(x) for x in (pairs.FLOOR, pairs.TINY, pairs.ROUNDING, pairs.SMALLEST_AREA, pairs.FARTHEST, pairs.EDGE_ON / (4 * np.pi)))
    turning = tuple(_F(x) for x in (pairs.TINY, pairs.EVEN, pairs.FAINT, np.cos(pairs.ASIDE), np.sin(pairs.ASIDE)))
    _encode(np.require(records, np.float32, ["C", "W"]), *arrays, layer, near_layer, constants, turning, pooled, frames, seen)
    return pooled, frames, seen
