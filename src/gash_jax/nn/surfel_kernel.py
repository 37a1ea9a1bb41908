"""The pairs of `SurfelNet.encode` on the host: one pass over those of each vertex, compiled by Numba.

Notation and formulas are those of `surfel_net` and `surfel_pairs`, which XLA compiles for whoever needs derivatives,
`vmap` or an accelerator; there every intermediate of every pair goes through memory, and lists are as long as the
longest. Here a vertex is finished before the next one begins, and its list ends where its weights do.

What is known of the pairs of a vertex stands in rows of one scratch array: number i of pair j is s[i * STRIDE + j].
One array and a constant distance between rows let LLVM see that no loop overwrites what it has yet to read, so that it
makes every loop over j one of whole vectors. For the same reason loops run over whole blocks of LANES pairs (what fills
the last one has weight 0), a maximum is taken lane by lane, and what is compared is a conditional expression.

What Numba compiles is marked `no_type_check`, as the tests would wrap it otherwise, and takes whole arrays and the
number v of a vertex, as a slice would cost more than what is done with it. Numba compiles anew when this file changes
and looks at no other: hence constants of `surfel_pairs` come as arguments.
"""

from typing import no_type_check

import numpy as np

from gash_jax.files.compiled import compiled

# surfels in a list
MOST = 256
LANES = 8
# not a power of two: rows would share the same few lines of the cache
STRIDE = MOST + 16
# the first numbers of a pair are the record of its surfel
RECORD = 20
OFFSET, VECTOR, AREA, SIZE, FORM, SPREAD = (STRIDE * i for i in (0, 3, 6, 7, 8, 14))
SHARE, DISTANCE, COVERED, ANGLE, HEIGHT, REACH, ABOVE, PARTLY, LARGEST = (STRIDE * i for i in range(RECORD, 29))
FEATURES, FEATURE_COUNT = STRIDE * 29, 16
NUMBERS = STRIDE * (29 + FEATURE_COUNT)

# what is read of a pair after its weights are known
READ = (
    *(OFFSET + STRIDE * i for i in range(3)),
    *(VECTOR + STRIDE * i for i in range(3)),
    *(AREA, SIZE, DISTANCE, COVERED, ANGLE, HEIGHT, REACH, ABOVE, PARTLY),
)
_F = np.float32
# moving them costs about as much as the pairs of a fifth of a list
MOST_KEPT = _F(0.8)
TINIEST = np.finfo(np.float32).tiny
# sums in any order, but what is not finite stays so
_compiled = compiled(fastmath={"reassoc", "nsz", "arcp", "contract", "afn"})


@_compiled
@no_type_check
def _gathered(records, table, weight, v, offset, s):
    """Records of the list of a vertex, as rows, and how many blocks of LANES it has."""
    count = table.shape[1]
    while count > 0 and weight[v, count - 1] == _F(0):
        count -= 1
    blocks = (count + LANES - 1) // LANES
    stored = min(blocks * LANES, table.shape[1])
    for j in range(stored):
        row = table[v, j]
        for i in range(3):
            s[OFFSET + i * STRIDE + j] = records[row, i] - offset[v, i]
        for i in range(3, RECORD):
            s[i * STRIDE + j] = records[row, i]
        s[SHARE + j] = weight[v, j]
    for j in range(stored, blocks * LANES):
        for i in range(RECORD + 1):
            s[i * STRIDE + j] = _F(0)
    return blocks


@_compiled
@no_type_check
def _quadratic(s, form, j, x, y, z):
    """u' S u of pair j, at least 0."""
    even = s[form + j] * x * x + s[form + STRIDE + j] * y * y + s[form + 2 * STRIDE + j] * z * z
    mixed = s[form + 3 * STRIDE + j] * x * y + s[form + 4 * STRIDE + j] * x * z + s[form + 5 * STRIDE + j] * y * z
    found = even + _F(2) * mixed
    return found if found > _F(0) else _F(0)


@_compiled
@no_type_check
def _clipped(x, low, high):
    x = x if x > low else low
    return x if x < high else high


@_compiled
@no_type_check
def _weighed(s, blocks, n, constants):
    """Weights of the pairs; sum of k u, of k, of q w c, and the largest of these."""
    floor, tiny, rounding, smallest, farthest, edge_on = constants
    sx, sy, sz, even, total, most = _F(0), _F(0), _F(0), _F(0), _F(0), _F(0)
    for j in range(blocks * LANES):
        x, y, z = s[OFFSET + j], s[OFFSET + STRIDE + j], s[OFFSET + 2 * STRIDE + j]
        square = x * x + y * y + z * z + floor
        distance = np.sqrt(square)
        inverse = _F(1) / distance
        x, y, z = x * inverse, y * inverse, z * inverse
        s[OFFSET + j], s[OFFSET + STRIDE + j], s[OFFSET + 2 * STRIDE + j] = x, y, z
        area = s[AREA + j]
        least = area * edge_on
        projected = _F(4 * np.pi) * np.sqrt(_quadratic(s, FORM, j, x, y, z) + least * least + smallest * smallest)
        covered = projected if projected < area else area
        angle = covered / (covered + square)
        height = x * n[0] + y * n[1] + z * n[2]
        reach = np.sqrt(_quadratic(s, SPREAD, j, n[0], n[1], n[2]) + tiny) * inverse
        reach = reach if reach < farthest else farthest
        counted, up = s[SHARE + j] * angle, height - rounding * inverse
        above, partly = counted * (up if up > _F(0) else _F(0)), counted * _clipped(height + reach, _F(0), _F(1))
        s[DISTANCE + j], s[COVERED + j], s[ANGLE + j], s[HEIGHT + j] = distance, covered, angle, height
        s[REACH + j], s[ABOVE + j], s[PARTLY + j] = reach, above, partly
        k = above + _F(1e-3) * partly
        sx += k * x
        sy += k * y
        sz += k * z
        even += k
        total += above
    for j in range(LANES):
        s[LARGEST + j] = _F(0)
    for block in range(blocks):
        for j in range(LANES):
            above, largest = s[ABOVE + block * LANES + j], s[LARGEST + j]
            s[LARGEST + j] = above if above > largest else largest
    for j in range(LANES):
        most = s[LARGEST + j] if s[LARGEST + j] > most else most
    return (sx, sy, sz), even, total, most


@_compiled
@no_type_check
def _described(s, blocks, frames, v, constants):
    """Features of the pairs, in the order of `surfel_pairs`."""
    floor, tiny, rounding, smallest, farthest, edge_on = constants
    a, b, n = _axis(frames, v, 0), _axis(frames, v, 1), _axis(frames, v, 2)
    for j in range(blocks * LANES):
        u = (s[OFFSET + j], s[OFFSET + STRIDE + j], s[OFFSET + 2 * STRIDE + j])
        vector = (s[VECTOR + j], s[VECTOR + STRIDE + j], s[VECTOR + 2 * STRIDE + j])
        x, y, height, distance = _dot(u, a), _dot(u, b), s[HEIGHT + j], s[DISTANCE + j]
        area, covered, angle = s[AREA + j], s[COVERED + j], s[ANGLE + j]
        covered = covered if covered > smallest else smallest
        unit = _F(1) / (area if area > smallest else smallest)
        f = FEATURES + j
        s[f], s[f + STRIDE], s[f + 2 * STRIDE] = x, y, height
        s[f + 3 * STRIDE], s[f + 4 * STRIDE], s[f + 6 * STRIDE] = x * y, y * height, x * height
        s[f + 5 * STRIDE] = _F(1.5) * height * height - _F(0.5)
        s[f + 7 * STRIDE] = _F(0.5) * (x * x - y * y)
        s[f + 8 * STRIDE] = np.sqrt(angle if angle > tiny else tiny)
        s[f + 9 * STRIDE] = _clipped(-_dot(u, vector) / covered, _F(-2), _F(2))
        s[f + 10 * STRIDE] = s[REACH + j]
        s[f + 11 * STRIDE] = s[SIZE + j] / (s[SIZE + j] + distance)
        s[f + 12 * STRIDE] = _dot(vector, n) * unit
        s[f + 13 * STRIDE], s[f + 14 * STRIDE] = _dot(vector, a) * unit, _dot(vector, b) * unit
        s[f + 15 * STRIDE] = _fourth_root(distance, tiny)


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
def _pooled(s, blocks, layer, v, pooled):
    """Sums over the pairs of ReLU(W f + b) with both weights; the last column of `layer` is b."""
    channels = len(layer)
    for c in range(channels):
        first, second = _weights(layer, c, 0), _weights(layer, c, 4)
        third, fourth = _weights(layer, c, 8), _weights(layer, c, 12)
        bias, above, partly = layer[c, FEATURE_COUNT], _F(0), _F(0)
        for j in range(blocks * LANES):
            f = FEATURES + j
            h = bias + _four(first, s, f, STRIDE) + _four(second, s, f + 4 * STRIDE, STRIDE)
            h += _four(third, s, f + 8 * STRIDE, STRIDE) + _four(fourth, s, f + 12 * STRIDE, STRIDE)
            h = h if h > _F(0) else _F(0)
            above += h * s[ABOVE + j]
            partly += h * s[PARTLY + j]
        pooled[v, c], pooled[v, channels + c] = above, partly


@_compiled
@no_type_check
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@_compiled
@no_type_check
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_compiled
@no_type_check
def _axis(frames, v, i):
    return frames[v, 0, i], frames[v, 1, i], frames[v, 2, i]


@_compiled
@no_type_check
def _fourth_root(x, tiny):
    return np.sqrt(np.sqrt(x if x > tiny else tiny))


@_compiled
@no_type_check
def _normalized(a):
    """`safe_normalize`."""
    largest = max(abs(a[0]), abs(a[1]), abs(a[2]))
    if largest < TINIEST:
        return _F(0), _F(0), _F(0)
    x, y, z = a[0] / largest, a[1] / largest, a[2] / largest
    length = np.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@_compiled
@no_type_check
def _tangential(a, n):
    up = _dot(a, n)
    return a[0] - up * n[0], a[1] - up * n[1], a[2] - up * n[2]


@_compiled
@no_type_check
def _any_tangent(n):
    """The first axis of `orthonormal_frame`."""
    x, y, z = n
    if z < _F(0):
        largest = max(abs(x), abs(y))
        u, w = (x / largest, y / largest) if largest > _F(1e-30) else (_F(1), y)
        scale = (_F(1) - z) / (u * u + w * w)
        return _F(1) - u * u * scale, -u * w * scale, -x
    scale = _F(1) / (_F(1) + z)
    return _F(1) - x * x * scale, -x * y * scale, -x


@_compiled
@no_type_check
def _turned(hidden, even, corner, n, turning, v, frames):
    """The frame of a vertex, from the sums of k u and of k and the direction of its first corner."""
    tiny, least, faint, cos, sin = turning
    a = _tangential(hidden, n)
    missing = least * even + faint - np.sqrt(_dot(a, a) + tiny)
    missing = missing if missing > _F(0) else _F(0)
    other = _normalized(_tangential(corner, n))
    across = _cross(n, other)
    cos, sin = missing * cos, missing * sin
    a = (
        a[0] + (cos * other[0] + sin * across[0]),
        a[1] + (cos * other[1] + sin * across[1]),
        a[2] + (cos * other[2] + sin * across[2]),
    )
    a = _normalized(a if _dot(a, a) > _F(1e-16) else _any_tangent(n))
    b = _cross(n, a)
    for i in range(3):
        frames[v, i, 0], frames[v, i, 1], frames[v, i, 2] = a[i], b[i], n[i]


@_compiled
@no_type_check
def encode(arrays, layer, constants, turning, pooled, frames, seen):
    """All vertices of a part in turn: see `surfel_encode`. Of `pooled` the columns of the corners are left out."""
    records, position, normal, near, cover, table, weight = arrays
    s = np.empty(NUMBERS, np.float32)
    last = pooled.shape[1] - 6
    for v in range(len(position)):
        n = (normal[v, 0], normal[v, 1], normal[v, 2])
        blocks = _gathered(records, table, weight, v, position, s)
        hidden, even, total, most = _weighed(s, blocks, n, constants)
        _turned(hidden, even, _corner(near, v, constants), n, turning, v, frames)
        blocks = _kept(s, blocks)
        _described(s, blocks, frames, v, constants)
        _pooled(s, blocks, layer, v, pooled)
        pooled[v, last], pooled[v, last + 1] = total, most
        for i in range(3):
            pooled[v, last + 3 + i] = _dot((cover[v, 0], cover[v, 1], cover[v, 2]), _axis(frames, v, i))
        seen[v] = total + pooled[v, last + 5]


@_compiled
@no_type_check
def _corner(near, v, constants):
    """The direction of the first corner."""
    x, y, z = near[v, 0], near[v, 1], near[v, 2]
    per = _F(1) / np.sqrt(x * x + y * y + z * z + constants[0])
    return x * per, y * per, z * per


@_compiled
@no_type_check
def _kept(s, blocks):
    """Where much of the list has no weight, as below the horizon of a mesh that moves, only the rest goes on."""
    count = 0
    for j in range(blocks * LANES):
        count += 1 if s[PARTLY + j] > _F(0) else 0
    kept = (count + LANES - 1) // LANES
    if _F(kept) > MOST_KEPT * _F(blocks):
        return blocks
    at = 0
    for j in range(blocks * LANES):
        if s[PARTLY + j] > _F(0):
            for row in READ:
                s[row + at] = s[row + j]
            at += 1
    for j in range(at, kept * LANES):
        s[ABOVE + j], s[PARTLY + j] = _F(0), _F(0)
    return kept
