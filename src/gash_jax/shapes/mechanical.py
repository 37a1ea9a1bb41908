"""Recipes for made shapes: gears, drilled plates, brackets.

A recipe maps a generator and a vertex count to a closed surface of about unit radius with at most about that many
vertices. Flat faces are triangulated as drawing programs do it, with long thin triangles between the features; the
caller refines where it wants more vertices.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import Delaunay

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.organic import random_solid
from gash_jax.shapes.parametric import facing_up, swept
from gash_jax.shapes.sdf import Field, box, capsule, cylinder, placed, shell, subtract, surface_of, union
from gash_jax.shapes.triangles import join, moved, outward


def gear(rng: np.random.Generator, target: int) -> RawMesh:
    """Toothed, scalloped or polygonal rings with a bore and a hub, from a few closed outlines."""
    per_tooth = int(rng.integers(4, 9))
    teeth = int(rng.integers(5, max(6, min(33, target // (8 * per_tooth)))))  # at most eight outlines
    phase = np.arange(teeth * per_tooth) / per_tooth % 1.0
    style, depth = int(rng.integers(3)), rng.uniform(0.08, 0.3)
    tooth = (np.clip(2.5 * np.abs(2 * phase - 1) - 0.75, 0, 1), np.cos(2 * np.pi * phase), phase)[style]
    angle = 2 * np.pi * np.arange(len(phase)) / len(phase)
    outer = 1 - depth * tooth
    bore = np.full(len(phase), rng.uniform(0.1, 0.5))
    if rng.random() < 0.5:
        sides = int(rng.integers(3, 8))
        bore *= np.cos(np.pi / sides) / np.cos((angle % (2 * np.pi / sides)) - np.pi / sides)
    half, hub = rng.uniform(0.08, 0.7), rng.uniform(0.55, 0.8)
    step = rng.uniform(-0.8, 0.8) * half
    ring = 0.5 * (bore + hub)
    outline = [(outer, -half), (outer, half)]
    if rng.random() < 0.7 and bore.max() < 0.9 * hub * outer.min():
        web = np.full(len(phase), hub * outer.min())
        outline += [
            (web, half),
            (web, half + step),
            (np.minimum(ring, web), half + step),
            (np.minimum(ring, web), half),
        ]
    outline += [(bore, half), (bore, -half)]
    radius, height = np.stack([r for r, _ in outline]), np.array([h for _, h in outline])
    rows = max(1, target // (len(phase) * len(outline)))
    radius, height = _subdivided(radius, rows), _subdivided(height[:, None], rows)
    points = np.broadcast_arrays(radius * np.sin(angle), height, radius * np.cos(angle))
    return outward(swept(np.stack(points, -1), rng, wrap_rows=True))


def _subdivided(rows: Float[np.ndarray, "r c"], pieces: int) -> Float[np.ndarray, "q c"]:
    """Every stretch between cyclic neighbours cut into equal pieces."""
    share = np.arange(pieces)[:, None] / pieces
    following = np.roll(rows, -1, axis=0)
    return (rows[:, None] * (1 - share) + following[:, None] * share).reshape(-1, rows.shape[1])


def plate(rng: np.random.Generator, target: int) -> RawMesh:
    """A convex plate drilled with round and polygonal holes, some stacked on a second plate with posts between."""
    layers = int(rng.integers(1, 4))
    gap, height = rng.uniform(0.15, 0.6), rng.uniform(0.03, 0.25)
    parts = [
        moved(_drilled(rng, target // layers, height), offset=(0, 0, layer * (gap + height))) for layer in range(layers)
    ]
    return join(parts)


def _drilled(rng: np.random.Generator, target: int, height: float) -> RawMesh:
    """Extrusion of a convex outline with holes that keep clear of each other and of the rim; walls hang from both."""
    sides = int(rng.choice([4, 4, 5, 6, 8, 24, 40]))
    turn = 2 * np.pi * (np.arange(sides) + 0.5) / sides
    rim = np.stack([np.cos(turn), np.sin(turn)], -1) * [1.0, rng.uniform(0.4, 1.0)]
    clear = np.abs(rim[:, 1].max()) * np.cos(np.pi / sides)
    corners = int(rng.choice([4, 6, 12, 20, 32]))
    loops = [rim]
    placed_holes = np.zeros((0, 3))
    for _ in range(4 * max(1, target // (4 * corners))):
        radius = clear * rng.uniform(0.05, 0.3)
        centre = rng.uniform(-1, 1, size=2) * [0.95, clear]
        inside = inside_convex(rim, centre) > radius + 0.03
        free = (np.linalg.norm(placed_holes[:, :2] - centre, axis=1) > placed_holes[:, 2] + radius + 0.03).all()
        if inside and free and 2 * (sum(map(len, loops)) + corners) <= target:
            angle = 2 * np.pi * np.arange(corners) / corners + rng.uniform(0, 1)
            loops.append(centre - radius * np.stack([np.cos(angle), -np.sin(angle)], -1))
            placed_holes = np.concatenate([placed_holes, [[*centre, radius]]])
    return _extruded(loops, height)


def inside_convex(outline: Float[np.ndarray, "n 2"], point: Float[np.ndarray, "2"]) -> float:
    """Distance from the nearest side of a counter-clockwise outline; negative outside."""
    along = np.roll(outline, -1, axis=0) - outline
    normal = np.stack([-along[:, 1], along[:, 0]], -1) / np.linalg.norm(along, axis=1, keepdims=True)
    return float(np.sum((point - outline) * normal, axis=1).min())


def cap(loops: Sequence[Float[np.ndarray, "_ 2"]]) -> tuple[Float[np.ndarray, "n 2"], Int[np.ndarray, "f 3"]]:
    """The flat face within a rim, the first of the loops, and outside its holes: corners, and triangles facing up.

    Corners of a hole lie on a circle with nothing inside, and the rim is its own hull, so every edge of the drawing is
    a Delaunay edge.
    """
    points = np.concatenate(loops)
    owner = np.repeat(np.arange(len(loops)), [len(loop) for loop in loops])
    faces = facing_up(points, Delaunay(points).simplices)
    in_hole = (owner[faces] == owner[faces[:, :1]]).all(axis=1) & (owner[faces[:, 0]] > 0)
    return points, faces[~in_hole]


def _extruded(loops: list[Float[np.ndarray, "_ 2"]], height: float) -> RawMesh:
    """Prism over a rim (counter-clockwise) with holes (clockwise), see `cap`."""
    points, caps = cap(loops)
    starts = np.cumsum([0] + [len(loop) for loop in loops[:-1]])
    following = np.concatenate(
        [start + np.roll(np.arange(len(loop)), -1) for start, loop in zip(starts, loops, strict=True)]
    )
    count, here = len(points), np.arange(len(points))
    walls = [
        np.stack([here, following, following + count], -1),
        np.stack([here, following + count, here + count], -1),
    ]
    bottom, top = np.pad(points, ((0, 0), (0, 1))), np.pad(points, ((0, 0), (0, 1)), constant_values=height)
    bottom[:, 2] = 0.0
    top[:, :2] = points
    return RawMesh(np.concatenate([bottom, top]), np.concatenate([caps[:, ::-1], caps + count, *walls]))


def bracket(rng: np.random.Generator, target: int) -> RawMesh:
    """Plates, bosses and ribs joined sharply or with fillets, then drilled, slotted and cut."""
    solids: list[Field] = [box([rng.uniform(0.6, 1.0), rng.uniform(0.1, 0.25), rng.uniform(0.4, 0.9)], 0.02)]
    for _ in range(int(rng.integers(1, 5))):
        at = rng.uniform(-0.7, 0.7, size=3) * [1, 0.4, 0.8]
        kind = int(rng.integers(4))
        solid = (
            box([rng.uniform(0.1, 0.2), rng.uniform(0.4, 0.9), rng.uniform(0.3, 0.8)], 0.02),
            cylinder(rng.uniform(0.2, 0.45), rng.uniform(0.3, 0.8)),
            box([rng.uniform(0.3, 0.9), rng.uniform(0.3, 0.7), rng.uniform(0.1, 0.2)], 0.02),
            random_solid(rng, 0.5),
        )[kind]
        solids.append(placed(solid, np.eye(3), at))
    quarter = np.eye(3)[[1, 2, 0]]
    tools = []
    for _ in range(int(rng.integers(1, 7))):
        at = rng.uniform(-0.8, 0.8, size=3)
        reach, size = rng.uniform(0, 0.4), rng.uniform(0.1, 0.3)
        tool = (
            cylinder(size, 3.0),
            capsule((-reach, 0, 0), (reach, 0, 0), size, size),
            box([0.5 * size + 0.04, 3.0, 0.2 + reach], 0.0),
            shell(cylinder(0.3 + size, 0.2), 0.12),
        )[int(rng.choice(4, p=[0.5, 0.15, 0.25, 0.1]))]
        tools.append(placed(tool, np.linalg.matrix_power(quarter, int(rng.integers(3))), at))
    return surface_of(subtract(union(solids, rng.choice([0.0, 0.1])), tools), rng, target, 2.0)
