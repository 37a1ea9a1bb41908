"""The walk of `surfel_walk` in compiled loops.

Numba compiles them, once on a machine. Members of families are weighed TILE at a time, in loops that become vector
instructions, and picked without branches, which a processor could not foresee.

Kernels call nothing of other files, as Numba looks for changes in this one alone.
"""

from typing import no_type_check

import numpy as np

from gash_jax.files.compiled import compiled

# members of a family, 4
FAN_BITS = 2
FAN = 1 << FAN_BITS
# members weighed at a time: what is known of them stays in the nearest cache
TILE = 256
# where in a tile what is known of them begins; before all, n . offset
PASSED, BY_MIDDLE, BY_TIPS, ROW_I, ROW_J = (TILE * i for i in range(1, 6))
# plain numbers would make float64 of all
ZERO, ONE, TWO = np.float32(0), np.float32(1), np.float32(2)
TINY = np.float32(1e-12)
# of squared extents: what rounding might still bring above the horizon is left in
ROUNDING = np.float32(1 + 1e-4)

# no arithmetic faster than IEEE's: lists are the same to the bit on every processor, and in `runtimes/gash_numpy.py`
_compiled = compiled()


@_compiled
@no_type_check
def walk(families, spread, starts, missing, own, rules, most, moves, lengths):
    """Arrays as in `Walked`; (n,) `lengths` are written."""
    opening, negligible, near, corners, middle, tips, full = rules
    # what is never written to takes no memory
    node = np.empty(len(own) * most + len(spread), np.int32)
    weight, rank = np.empty(len(node), np.float32), np.empty(len(spread), np.float32)
    vertex, leaf = np.empty(1024, np.int64), np.empty(1024, np.int64)
    share, highest = np.empty(1024, np.float32), np.empty(1024, np.float32)
    family, reached = np.empty(len(families), np.int64), np.empty(len(families), np.float32)
    next_family, next_reached = np.empty(len(families), np.int64), np.empty(len(families), np.float32)
    tile, picked = np.empty(6 * TILE, np.float32), np.empty(TILE + 1, np.int64)
    used, beside, last = 0, 0, len(starts) - 2
    for v in range(len(own)):
        x, y, z = own[v, 3], own[v, 4], own[v, 5]
        first, scale = used, ONE
        for again in (False, True):
            total, used, count = 0.0, first, starts[1]
            for f in range(count):
                family[f] = f
                reached[f] = ONE
            for level in range(last + 1):
                # from a place among all members to the row of the records
                shift = missing if level > 0 else 0
                found = 0
                for start in range(0, count, TILE // FAN):
                    n = FAN * min(count - start, TILE // FAN)
                    _fetch(families, family, reached, start, n, own, v, tile)
                    _weigh(tile, n, x, y, z, scale, middle, tips, ONE / opening, ONE / negligible, level < last)
                    if level < last:
                        # member m of a level has its family m of the next one as children
                        children = starts[level + 1] - FAN * starts[level]
                        found = _passed_on(tile, n, picked, family, start, children, next_family, next_reached, found)
                    for k in range(_picked(tile, BY_TIPS if moves else BY_MIDDLE, ZERO, n, picked)):
                        m = picked[k]
                        row = _member(family, start, m) - shift
                        above = _reaches(tile[m], spread, row, x, y, z, ROUNDING)
                        by, important = (BY_MIDDLE, ROW_I) if above or not moves else (BY_TIPS, ROW_J)
                        node[used] = row
                        weight[used] = tile[by + m]
                        rank[used - first] = tile[important + m]
                        used += 1 if (tile[by + m] > ZERO) & (above | moves) else 0
                        total += tile[BY_MIDDLE + m]
                    if level == last and not again:  # what is beside a vertex stays
                        for k in range(_picked(tile, ROW_J, near, n, picked)):
                            m = picked[k]
                            row = _member(family, start, m) - shift
                            if beside == len(leaf):
                                vertex, leaf = _longer(vertex), _longer(leaf)
                                share, highest = _longer(share), _longer(highest)
                            vertex[beside], leaf[beside] = v, row + shift - FAN * starts[level]
                            share[beside], highest[beside] = reached[start + (m >> FAN_BITS)], tile[ROW_J + m]
                            above = _reaches(tile[m], spread, row, x, y, z, ROUNDING * corners)
                            beside += 1 if above | moves else 0
                family, next_family = next_family, family
                reached, next_reached = next_reached, reached
                count = found
            if total <= full:
                break
            scale = np.float32(full / total)
        if used - first > most:
            used = _shortened(node, weight, rank, first, used, most)
        lengths[v] = used - first
    return node[:used].copy(), weight[:used].copy(), vertex[:beside], leaf[:beside], share[:beside], highest[:beside]


@_compiled
@no_type_check
def _fetch(families, family, reached, start, n, own, v, tile):
    """Offsets from the vertex, size, and what has been passed on to them, of `n` members."""
    for f in range(n >> FAN_BITS):
        number, share = family[start + f], reached[start + f]
        for k in range(FAN):
            m = FAN * f + k
            tile[m] = families[number, 0, k] - own[v, 0]
            tile[TILE + m] = families[number, 1, k] - own[v, 1]
            tile[2 * TILE + m] = families[number, 2, k] - own[v, 2]
            tile[3 * TILE + m] = families[number, 3, k]
            tile[4 * TILE + m] = share


@_compiled
@no_type_check
def _weigh(tile, n, x, y, z, scale, middle, tips, per_opening, per_negligible, opens):
    """Of `n` members, in place: n . offset, what they pass on, weights by i and by j, and i and j themselves."""
    most_opened = ONE if opens else ZERO
    for m in range(n):
        a, b, c = tile[m], tile[TILE + m], tile[2 * TILE + m]
        s, share = tile[3 * TILE + m], tile[4 * TILE + m]
        height = x * a + y * b + z * c
        square = s * s
        per_far = ONE / np.sqrt(a * a + b * b + c * c + square + TINY)
        filled = square * per_far * per_far
        i = _clipped((height + middle * s) * per_far) * filled * scale
        j = _clipped((height + tips * s) * per_far) * filled * scale
        opened = _clipped(j * per_opening - ONE) * most_opened
        left = share * (ONE - opened)
        tile[m] = height
        tile[PASSED + m] = share * opened
        tile[BY_MIDDLE + m] = _clipped(i * per_negligible - ONE) * left
        tile[BY_TIPS + m] = _clipped(j * per_negligible - ONE) * left
        tile[ROW_I + m] = i
        tile[ROW_J + m] = j


@_compiled
@no_type_check
def _clipped(x):
    """Between 0 and 1, in a form that becomes vector instructions."""
    x = x if x > ZERO else ZERO
    return x if x < ONE else ONE


@_compiled
@no_type_check
def _picked(tile, row, least, n, picked):
    """Numbers of the members of which a row is more than `least`, and how many they are."""
    count = 0
    for m in range(n):
        picked[count] = m
        count += 1 if tile[row + m] > least else 0
    return count


@_compiled
@no_type_check
def _member(family, start, m):
    """The place of member m of some families among all members."""
    # by bits, as a division takes longer than all the rest
    return FAN * family[start + (m >> FAN_BITS)] + (m & (FAN - 1))


@_compiled
@no_type_check
def _passed_on(tile, n, picked, family, start, children, next_family, next_reached, found):
    """Families of the children of what is open, and their shares; how many these are then."""
    for k in range(_picked(tile, PASSED, ZERO, n, picked)):
        m = picked[k]
        next_family[found] = children + _member(family, start, m)
        next_reached[found] = tile[PASSED + m]
        found += 1
    return found


@_compiled
@no_type_check
def _reaches(height, spread, row, x, y, z, reach):
    """Whether a surfel reaches above the horizon, by so many times its mean square extent n' C n."""
    if height > ZERO:
        return True
    extent = spread[row, 0] * x * x + spread[row, 1] * y * y + spread[row, 2] * z * z
    extent += TWO * (spread[row, 3] * x * y + spread[row, 4] * x * z + spread[row, 5] * y * z)
    return height * height <= extent * reach


@_compiled
@no_type_check
def _longer(array):
    """Twice as long."""
    return np.concatenate((array, np.empty_like(array)))


@_compiled
@no_type_check
def _shortened(node, weight, rank, first, used, most):
    """Keep the `most` important of a list, in place, the earlier of equals; where it ends then."""
    least = np.sort(rank[: used - first])[used - first - most]
    equals = most
    for k in range(used - first):
        equals -= 1 if rank[k] > least else 0
    end = first
    for k in range(used - first):
        if rank[k] > least or (rank[k] == least and equals > 0):
            equals -= 1 if rank[k] == least else 0
            node[end], weight[end] = node[first + k], weight[first + k]
            end += 1
    return end


@_compiled
@no_type_check
def place(node, weight, lengths, begin, width, empty, table, weights):
    """Copy lists to where they begin, and fill them up to their widths with the row that is empty."""
    first = 0
    for v in range(len(lengths)):
        for k in range(lengths[v]):
            table[begin[v] + k] = node[first + k]
            weights[begin[v] + k] = weight[first + k]
        for k in range(lengths[v], width[v]):
            table[begin[v] + k] = empty
            weights[begin[v] + k] = ZERO
        first += lengths[v]
