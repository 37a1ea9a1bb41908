"""Recipes for parts as drawing programs export them: no vertex but at corners and on rims, however long the triangles.

A recipe maps a generator and a vertex count to a closed surface of about unit radius with at most about that many
vertices. Nothing is refined afterwards:
round holes of many short sides lie in large flat faces, fans of slivers join them, one normal serves both sides of a
sharp edge, and flat faces lie much closer to each other than their triangles are wide.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.mechanical import cap, inside_convex
from gash_jax.shapes.parametric import revolved
from gash_jax.shapes.triangles import join, moved, outward

SMALLEST = 0.015

Loop = Float[np.ndarray, "_ 2"]


class Hole(NamedTuple):
    """A circle in the top of a plate: what is inside lies at another height, or is open down to the bottom."""

    circle: Loop  # counter-clockwise
    level: float | None  # None: open
    bore: Loop | None  # a smaller circle in a pocket, open down to the bottom


def drilled(rng: np.random.Generator, target: int) -> RawMesh:
    """A plate with holes, pockets, stepped holes and bosses, most of them small beside the plate."""
    return _plate(rng, target, _outline(rng), _between(rng, 0.03, 0.6))


def _plate(rng: np.random.Generator, target: int, rim: Loop, height: float) -> RawMesh:
    """The plate over a convex outline, its bottom at z = 0."""
    corners = int(rng.choice([6, 12, 16, 24, 32, 48]))
    largest = _between(rng, 0.02, 0.35)
    holes: list[Hole] = []
    taken, used = np.zeros((0, 3)), 2 * len(rim)
    for _ in range(16 * max(1, target // (2 * corners))):
        if used + 3 * corners > 1.1 * target:
            break
        radius, centre = largest * rng.uniform(0.3, 1.0), rng.uniform(-1, 1, size=2)
        # where many are wanted there is no room for large ones; below, rounding decides what is a Delaunay edge
        largest = max(0.995 * largest, SMALLEST)
        inside = inside_convex(rim, centre) > 1.1 * radius
        free = (np.linalg.norm(taken[:, :2] - centre, axis=1) > taken[:, 2] + 1.1 * radius).all()
        if inside and free:
            hole = _hole(rng, centre, radius, corners, height)
            holes.append(hole)
            taken = np.concatenate([taken, [[*centre, radius]]])
            used += corners * (2 if hole.bore is None else 4)
    return _merged(_plate_faces(rim, holes, height))


def _hole(rng: np.random.Generator, centre: np.ndarray, radius: float, corners: int, height: float) -> Hole:
    """Open, a pocket, a pocket with a bore, or a boss."""
    turn, kind = rng.uniform(0, 2 * np.pi), int(rng.choice(4, p=[0.35, 0.2, 0.2, 0.25]))
    circle = centre + radius * _circle(corners, turn)
    if kind == 0:
        return Hole(circle, None, None)
    if kind == 3:
        return Hole(circle, height + radius * rng.uniform(0.2, 3.0), None)
    bore = centre + rng.uniform(0.3, 0.8) * radius * _circle(corners, turn) if kind == 2 else None
    return Hole(circle, height * rng.uniform(0.15, 0.85), bore)


def _circle(corners: int, turn: float = 0.0) -> Loop:
    angle = 2 * np.pi * np.arange(corners) / corners + turn
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def _outline(rng: np.random.Generator) -> Loop:
    """A rectangle with sharp or round corners, or a polygon; convex, counter-clockwise, within the unit circle."""
    if rng.random() < 0.4:
        return _circle(int(rng.choice([3, 5, 6, 8, 32, 64])), rng.uniform(0, 2 * np.pi)) * [1.0, rng.uniform(0.3, 1.0)]
    corners = int(rng.choice([1, 1, 3, 9]))
    half = np.array([1.0, rng.uniform(0.15, 1.0)]) / np.sqrt(2)
    radius = 0.0 if corners == 1 else half.min() * rng.uniform(0.1, 0.9)
    arc = radius * _circle(4 * (corners - 1))[:corners] if corners > 1 else np.zeros((1, 2))
    quarter = np.array([[0.0, -1.0], [1.0, 0.0]])
    signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    turned = [arc @ np.linalg.matrix_power(quarter, i).T for i in range(4)]
    return np.concatenate([sign * (half - radius) + arc for sign, arc in zip(signs, turned, strict=True)])


def _plate_faces(rim: Loop, holes: Sequence[Hole], height: float) -> list[RawMesh]:
    """Caps and walls, each with vertices of its own."""
    through = [hole.circle if hole.level is None else hole.bore for hole in holes]
    bottom = _cap(rim, [loop for loop in through if loop is not None], 0.0)
    pieces = [_wall(rim, 0.0, height), _cap(rim, [hole.circle for hole in holes], height)]
    pieces.append(RawMesh(bottom.vertices, bottom.faces[:, ::-1]))
    for circle, level, bore in holes:
        if level is None:
            pieces.append(_wall(circle[::-1], 0.0, height))
            continue
        pieces.append(_cap(circle, [] if bore is None else [bore], level))
        pieces.append(_wall(circle, height, level) if level > height else _wall(circle[::-1], level, height))
        if bore is not None:
            pieces.append(_wall(bore[::-1], 0.0, level))
    return pieces


def _cap(rim: Loop, holes: Sequence[Loop], level: float) -> RawMesh:
    """The flat face within a rim and outside its holes, facing up."""
    points, faces = cap([rim, *holes])
    return RawMesh(np.pad(points, ((0, 0), (0, 1)), constant_values=level), faces)


def _wall(loop: Loop, low: float, high: float) -> RawMesh:
    """The wall over a loop, facing away from what a counter-clockwise one encloses."""
    count, here = len(loop), np.arange(len(loop))
    following = np.roll(here, -1)
    faces = [np.stack([here, following, following + count], -1), np.stack([here, following + count, here + count], -1)]
    points = [np.pad(loop, ((0, 0), (0, 1)), constant_values=z) for z in (low, high)]
    return RawMesh(np.concatenate(points), np.concatenate(faces))


def _merged(pieces: Sequence[RawMesh]) -> RawMesh:
    """One surface; vertices at the very same place become one."""
    surface = join(pieces)
    vertices, place = np.unique(surface.vertices, axis=0, return_inverse=True)
    return RawMesh(vertices, place.reshape(-1)[surface.faces])


def shaft(rng: np.random.Generator, target: int) -> RawMesh:
    """A turned part: shoulders and some with a bore, in few rings of many long narrow faces."""
    columns = int(min(rng.choice([24, 32, 48, 64, 96]), max(target // 8, 12)))
    steps = int(rng.integers(1, min(9, max(2, target // (2 * columns)))))
    if target > 16 * columns:  # more corners where more vertices are wanted, not more rings
        columns = target // (2 * steps + 2)
    radius, length = rng.uniform(0.25, 1.0, size=steps), float(np.exp(rng.uniform(np.log(0.2), np.log(8.0))))
    ends = length * np.concatenate([[-0.5], np.sort(rng.uniform(-0.5, 0.5, size=steps - 1)), [0.5]])
    profile = np.stack([np.repeat(radius, 2), np.repeat(ends, 2)[1:-1]], -1)
    hollow = rng.random() < 0.6
    if hollow:
        bore = radius.min() * rng.uniform(0.3, 0.9)
        profile = np.concatenate([profile, [[bore, ends[-1]], [bore, ends[0]]]])
    profile /= np.abs(profile).max()
    return outward(revolved(profile, columns, rng, closed_rows=hollow, poles=(not hollow, not hollow)))


def stacked(rng: np.random.Generator, target: int) -> RawMesh:
    """Plates one over the other, or one in the other, with narrow gaps between their large flat faces."""
    count, rim, height = int(rng.integers(2, 5)), _outline(rng), _between(rng, 0.02, 0.4)
    nested = rng.random() < 0.3
    parts, level = [], 0.0
    for number in range(count):
        gap = _between(rng, 0.002, 0.1)
        if nested:
            scale = 1 - gap * (number > 0)
            rim, height = scale * rim, height * scale
            level += 0.5 * (1 - scale) * height
        elif rng.random() < 0.5:
            rim, height = _outline(rng) * rng.uniform(0.4, 1.0), _between(rng, 0.02, 0.2)
        part = moved(_plate(rng, target // count, rim, height), offset=(0, 0, level))
        parts.append(part)
        if not nested:  # now and then above the bosses
            level = gap + (float(part.vertices[:, 2].max()) if rng.random() < 0.2 else level + height)
    return join(parts)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniformly distributed."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
