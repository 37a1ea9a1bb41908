"""Polygons cut into triangles, whatever corner they begin with.

A polygon keeps the fan (0, i, i + 1) from its first corner if the fan covers it: if every triangle of the fan faces
the way of the whole polygon and together they turn less than once about the first corner. That holds for convex
polygons, which are nearly all. The others (concave ones, a wall with a window by a bridge edge, corners on a straight
edge, where the fan has triangles without area) are cut by earcut, along the axis nearest to the normal of their vector
area. It gives no triangle to corners on straight edges; the triangle at the edge is split there, so that every corner
has one and no seam opens. A polygon that crosses itself has no inside: it keeps its fan. All these are noted.
"""

from typing import NamedTuple

import mapbox_earcut
import numpy as np
from jaxtyping import Bool, Float, Int, Num

from gash_jax.geometry.mesh import lengths, vector_areas

STRAIGHT = 1e-5  # twice the area over the square of the longest side, as a part of the polygon's: a triangle is none
BENT = 0.1  # distance from the plane, as a part of the size, from which the way of cutting shows
_ROUNDING = float(np.finfo(np.float32).eps)


class _Polygons(NamedTuple):
    """Some polygons, and what their fans say about them."""

    number: Int[np.ndarray, "p"]  # among all polygons
    size: Int[np.ndarray, "p"]  # corners
    first: Int[np.ndarray, "p"]  # place of the first corner
    normal: Float[np.ndarray, "p 3"]  # twice the vector area (Newell)
    covers: Bool[np.ndarray, "p"]  # the fan is a triangulation
    bent: Bool[np.ndarray, "p"]
    slack: Float[np.ndarray, "p"]  # rounding of the coordinates in float32


def triangulate(
    corners: Int[np.ndarray, "c"], sizes: Int[np.ndarray, "p"], vertices: Num[np.ndarray, "v 3"]
) -> tuple[Int[np.ndarray, "f 3"], tuple[str, ...]]:
    """Triangles, in order, of polygons given as their corners in a row and their sizes; and notes on odd polygons.

    A polygon of n corners gives n - 2 triangles with its own winding, or fewer where it touches itself; of fewer than
    three corners, none. Corners may name vertices that do not exist: such polygons keep their fan and are refused
    later, with all other faces.
    """
    places, notes = triangle_places(corners, sizes, vertices)
    return corners[places].astype(np.int64), notes


def triangle_places(
    corners: Int[np.ndarray, "c"], sizes: Int[np.ndarray, "p"], vertices: Num[np.ndarray, "v 3"]
) -> tuple[Int[np.ndarray, "f 3"], tuple[str, ...]]:
    """As `triangulate`, but each corner of a triangle as its place among `corners`: for what belongs to corners."""
    faces, few = _fans(np.arange(len(corners)), sizes), int(np.count_nonzero(sizes < 3))
    notes = _note(few, "of fewer than three corners: left out")
    if sizes.max(initial=0) <= 3:
        return faces, notes
    judged = _judged(corners, sizes, vertices)
    ends = np.cumsum(np.maximum(sizes - 2, 0))
    kept = np.ones(len(faces), dtype=bool)
    cut = crossing = 0
    for k in np.flatnonzero(~judged.covers):
        own = corners[judged.first[k] : judged.first[k] + judged.size[k]]
        triangles = _ears(_seen_along(vertices[own], judged.normal[k]), judged.slack[k])
        if triangles is None:
            crossing += 1
            continue
        cut += 1
        place = ends[judged.number[k]] - judged.size[k] + 2
        kept[place + len(triangles) : ends[judged.number[k]]] = False
        faces[place : place + len(triangles)] = judged.first[k] + triangles
    notes += _note(cut, "with concave or straight corners: cut inside the outline, not as a fan")
    notes += _note(crossing, "without an inside, crossing itself or twisted: cut as a fan from the first corner")
    bent = int(np.count_nonzero(judged.bent))
    return faces[kept], notes + _note(bent, "bent by more than a tenth of the size: cut in one of several ways")


def _note(count: int, words: str) -> tuple[str, ...]:
    return (f"{count} {'polygon' if count == 1 else 'polygons'} {words}",) if count else ()


def _fans(corners: Int[np.ndarray, "c"], sizes: Int[np.ndarray, "p"]) -> Int[np.ndarray, "f 3"]:
    triangles = np.maximum(sizes - 2, 0)
    base = np.repeat(np.cumsum(sizes) - sizes, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([corners[base], corners[base + step + 1], corners[base + step + 2]], axis=1).astype(np.int64)


def _judged(corners: np.ndarray, sizes: np.ndarray, vertices: np.ndarray) -> _Polygons:
    """The polygons of more than three corners, these existing and finite, and whether their fans cover them."""
    usable = np.append((np.abs(vertices) < np.finfo(np.float32).max).all(axis=1), False)
    places = np.where((corners >= 0) & (corners < len(vertices)), corners, len(vertices))
    broken = np.bincount(np.repeat(np.arange(len(sizes)), sizes), ~usable[places], len(sizes)) > 0
    number = np.flatnonzero((sizes > 3) & ~broken)
    size, first = sizes[number], (np.cumsum(sizes) - sizes)[number]
    at = np.repeat(first - (np.cumsum(size) - size), size) + np.arange(size.sum())
    polygons = _Polygons(number, size, first, np.zeros((len(size), 3)), *np.zeros((3, len(size)), dtype=bool))
    return _judge(polygons, _fans(corners[at], size), vertices) if len(number) else polygons


def _judge(polygons: _Polygons, fans: Int[np.ndarray, "t 3"], vertices: np.ndarray) -> _Polygons:
    """Fill in what the fans say about the polygons."""
    size = polygons.size
    starts = np.cumsum(size - 2) - (size - 2)
    a, b, c = (vertices[corner].astype(np.float64) for corner in fans.T)
    sides = b - a, c - b, a - c
    cross = 2 * vector_areas(vertices, fans)
    normal = np.add.reduceat(cross, starts)
    area = lengths(normal)
    unit = np.repeat(normal / np.where(area > 0, area, 1.0)[:, None], size - 2, axis=0)
    facing, doubled = np.einsum("ti,ti->t", cross, unit), lengths(cross)
    squares = [np.einsum("ti,ti->t", side, side) for side in sides]
    longest = np.sqrt(np.maximum(np.maximum(squares[0], squares[1]), squares[2]))
    thinness = area / np.maximum.reduceat(longest, starts).clip(1e-150) ** 2
    step = _ROUNDING * np.abs(vertices).max(axis=1).astype(np.float64)[fans].max(axis=1)  # of coordinates in float32
    least = longest * (STRAIGHT * np.repeat(thinness, size - 2) * longest + step)
    repeated = (squares[0] == 0) | (squares[1] == 0) | (squares[2] == 0)
    good = np.logical_and.reduceat((facing > least) | repeated, starts)
    turning = np.add.reduceat(np.arctan2(facing, -np.einsum("ti,ti->t", sides[0], sides[2])), starts)
    line = np.logical_and.reduceat(doubled <= 4 * step * longest, starts)  # of corners: nothing to cover
    height = np.maximum(*(np.abs(np.einsum("ti,ti->t", side, unit)) for side in (sides[0], sides[2])))
    bent = np.logical_or.reduceat(height > np.maximum(BENT * np.repeat(np.sqrt(area), size - 2), 4 * step), starts)
    covers = (good & (turning < 2 * np.pi)) | line
    return _Polygons(*polygons[:3], normal, covers, bent & ~line, np.maximum.reduceat(step, starts))


def _seen_along(points: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 2"]:
    """The corners in the two coordinates across the largest of the normal, counter-clockwise: exactly those given."""
    axis = int(np.argmax(np.abs(normal)))
    kept = [(axis + 1) % 3, (axis + 2) % 3][:: 1 if normal[axis] > 0 else -1]
    points = points.astype(np.float64)[:, kept]
    return points - points[0]


def _ears(points: Float[np.ndarray, "n 2"], slack: float) -> Int[np.ndarray, "t 3"] | None:
    """Triangles of a counter-clockwise polygon in the plane; None if it crosses itself.

    `slack` is the distance from a line at which rounding may put a corner that belongs on it.
    """
    kept = _turning(points, slack)
    found = kept[mapbox_earcut.triangulate_float64(points[kept], np.array([len(kept)], np.uint32)).reshape(-1, 3)]
    area, whole = _doubled_area(points[found]), _doubled_area(points[None])[0]
    if not whole > 0 or abs(np.abs(area).sum() - whole) > STRAIGHT * whole:
        return None
    found = found if area.sum() > 0 else found[:, ::-1]
    sides = points[found] - points[np.roll(found, 1, axis=1)]
    longest = np.sqrt(np.sum(sides**2, axis=2)).max(axis=1)
    # at the corner in the middle of a triangle without area its normal would be noise
    slivers = np.abs(area) <= longest * (STRAIGHT * longest + slack)
    for chosen in (found[~slivers], found):
        triangles = _split_at_straight_corners(chosen, points, slack)
        if abs(_doubled_area(points[triangles]).sum() - whole) <= STRAIGHT * whole:
            return triangles
    return found


def _doubled_area(polygons: Float[np.ndarray, "p n 2"]) -> Float[np.ndarray, "p"]:
    x, y = np.moveaxis(polygons - polygons[:, :1], -1, 0)
    return np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)


def _turning(points: Float[np.ndarray, "n 2"], slack: float) -> Int[np.ndarray, "k"]:
    """The corners at which the outline turns."""
    along, before = np.roll(points, -1, axis=0) - points, points - np.roll(points, 1, axis=0)
    cross = before[:, 0] * along[:, 1] - before[:, 1] * along[:, 0]
    length = np.sqrt(np.sum((along + before) ** 2, axis=1))
    straight = (np.sum(before * along, axis=1) > 0) & (np.abs(cross) <= length * (STRAIGHT * length + slack))
    kept = np.flatnonzero(~straight)
    area = _doubled_area(points[None])[0]
    whole = len(kept) >= 3 and abs(_doubled_area(points[kept][None])[0] - area) <= STRAIGHT * area
    return kept if whole else np.arange(len(points))


def _split_at_straight_corners(
    chosen: Int[np.ndarray, "s 3"], points: Float[np.ndarray, "n 2"], slack: float
) -> Int[np.ndarray, "t 3"]:
    """Split triangles where an edge, neither of the outline nor shared, passes corners that are on no other triangle.

    Inside the outline an edge (a, b) of a counter-clockwise triangle passes corners between a and b.
    """
    count, triangles = len(points), chosen.tolist()
    owner = {(t[i], t[i - 2]): k for k, t in enumerate(triangles) for i in range(3)}
    open_edges = list(owner)
    while open_edges and len(triangles) < count - 2:
        a, b = open_edges.pop()
        if (b - a) % count == 1 or (b, a) in owner or (a, b) not in owner:
            continue
        passed = _on_segment((a + 1 + np.arange((b - a - 1) % count)) % count, a, b, points, slack)
        if not len(passed):
            continue
        k, c = owner.pop((a, b)), int(passed[len(passed) // 2])
        apex = next(corner for corner in triangles[k] if corner not in (a, b))
        triangles[k] = [a, c, apex]
        triangles.append([c, b, apex])
        owner |= dict.fromkeys([(a, c), (c, apex), (apex, a)], k)
        owner |= dict.fromkeys([(c, b), (b, apex), (apex, c)], len(triangles) - 1)
        open_edges += [(a, c), (c, b)]
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def _on_segment(
    corners: Int[np.ndarray, "k"], a: int, b: int, points: Float[np.ndarray, "n 2"], slack: float
) -> Int[np.ndarray, "m"]:
    """Those of the corners that lie between two others; at them, if these are at one place."""
    (x, y), (u, v) = points[b] - points[a], (points[corners] - points[a]).T
    length, along = np.hypot(x, y), u * x + v * y
    if length == 0:
        return corners[(u == 0) & (v == 0)]
    near = np.abs(u * y - v * x) <= length * (STRAIGHT * length + slack)
    return corners[near & (along >= 0) & (along <= length**2)]
