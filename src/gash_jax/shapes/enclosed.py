"""Recipes for shapes that are dark inside: mouths, shells with holes, housings with parts, mechanisms, layers, poses.

A recipe maps a generator and a vertex count to a closed surface of about unit radius. Narrow gaps and thin walls need
a fine grid whatever the count, so surfaces are made fine enough for them and then decimated.
"""

import numpy as np
from jaxtyping import Float

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.lattices import lattice_surface
from gash_jax.shapes.mechanical import bracket, gear, plate
from gash_jax.shapes.organic import ellipsoid, random_solid
from gash_jax.shapes.parametric import flat_domain
from gash_jax.shapes.poses import posed_limbs
from gash_jax.shapes.retessellation import collapse, relax
from gash_jax.shapes.sdf import (
    Field,
    box,
    capsule,
    cylinder,
    placed,
    shell,
    sphere,
    subtract,
    surface_of,
    torus,
    union,
    value_noise,
)
from gash_jax.shapes.triangles import join, mean_normals, moved, outward, random_rotation

UPRIGHT = np.eye(3)


def thinned(surface: RawMesh, rng: np.random.Generator, target: int) -> RawMesh:
    """The surface with at most about `target` vertices, however many there are too many."""
    for _ in range(8):
        surface = collapse(surface, rng, target, passes=150)
        if len(surface.vertices) <= target:
            break
        surface = relax(surface, 2)  # slivers, which no contraction can leave the right way up, stop it
    return surface


def fine_surface(field: Field, rng: np.random.Generator, target: int, narrowest: float) -> RawMesh:
    """Surface of a solid whose walls and gaps are `narrowest` or wider: made on a grid that has them, then thinned."""
    # a body of about unit radius with an inside has an area of about 14
    return thinned(surface_of(field, rng, max(target, round(40 / narrowest**2)), 2.4), rng, target)


def mouth(rng: np.random.Generator, target: int) -> RawMesh:
    """A head with a deep pocket behind a narrow slit or hole, some with eye holes: hardly any light gets in."""
    radii = rng.uniform(0.7, 1.0, size=3)
    body: list[Field] = [ellipsoid(np.zeros(3), radii)]
    body.append(sphere((0, rng.uniform(-0.6, -0.3), 0.3), rng.uniform(0.4, 0.6)))  # the jaw
    body.append(sphere((0, rng.uniform(-0.1, 0.2), radii[2]), rng.uniform(0.1, 0.25)))  # the nose
    height, depth = rng.uniform(-0.4, -0.2), rng.uniform(0.0, 0.25)
    pocket = np.array([rng.uniform(0.25, 0.5), rng.uniform(0.2, 0.4), rng.uniform(0.3, 0.45)]) * radii.min()
    lips = box([rng.uniform(0.1, 0.35), rng.uniform(0.03, 0.07), 1.0], 0.02)
    if rng.random() < 0.35:
        lips = capsule((0, 0, -1), (0, 0, 1), *rng.uniform(0.05, 0.14, size=2))
    tools = [placed(lips, UPRIGHT, (0, height, 1.0 + depth)), ellipsoid(np.array([0, height, depth]), pocket)]
    tools.append(ellipsoid(np.array([0, height - 0.1, depth - 0.3]), 0.6 * pocket))  # the throat
    if rng.random() < 0.6:
        across, up, size = rng.uniform(0.25, 0.4), rng.uniform(0.25, 0.4), rng.uniform(0.08, 0.18)
        tools += [capsule((s * across, up, 0.35), (s * across, up, 1.5), size, size) for s in (-1, 1)]
    tongue = ellipsoid(np.array([0, height - 0.5 * pocket[1], depth]), pocket * [0.6, 0.45, 0.8])
    skin, amount = value_noise(rng, rng.uniform(1.5, 4), octaves=2), rng.uniform(0.0, 0.04)
    head = subtract(union(body, rng.uniform(0.05, 0.25)), tools, rng.uniform(0.0, 0.04))
    solid = union([head, tongue]) if rng.random() < 0.5 else head
    return fine_surface(lambda points: solid(points) + amount * skin(points), rng, target, 0.1)


def skull(rng: np.random.Generator, target: int) -> RawMesh:
    """A thin shell of a blob with 2 to 6 holes of different sizes, some with a body inside."""
    lumps = [ellipsoid(np.zeros(3), rng.uniform(0.6, 1.0, size=3))]
    for _ in range(int(rng.integers(1, 4))):
        lumps.append(sphere(rng.uniform(-0.5, 0.5, size=3), rng.uniform(0.35, 0.6)))
    body = union(lumps, rng.uniform(0.1, 0.35))
    holes = []
    for _ in range(int(rng.integers(2, 7))):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        size = rng.uniform(0.06, 0.3)
        holes.append(capsule(0.35 * way, 2 * way, size * rng.uniform(0.5, 1.0), size))
    wall = rng.uniform(0.06, 0.15)
    solid = subtract(shell(body, wall), holes, rng.uniform(0.0, 0.06))
    if rng.random() < 0.5:
        inside = placed(
            random_solid(rng, rng.uniform(0.25, 0.45)), random_rotation(rng), rng.uniform(-0.2, 0.2, size=3)
        )
        solid = union([solid, inside])
    return fine_surface(solid, rng, target, wall)


def housing(rng: np.random.Generator, target: int) -> RawMesh:
    """A box or drum with walls, a window or a lid that stands a little off, and parts inside."""
    half, wall = rng.uniform(0.45, 0.9, size=3), rng.uniform(0.06, 0.14)
    drum = rng.random() < 0.4
    if drum:
        half[2] = half[0]
    outer, inner, above = (cylinder(h[0], h[1]) if drum else box(h) for h in (half, half - wall, half * [2, 0.5, 2]))
    tools = [inner]
    lid = rng.random() < 0.5
    if lid:  # cut off above the rim
        tools.append(placed(above, UPRIGHT, (0, 1.5 * half[1] - wall, 0)))
    for _ in range(int(rng.integers(0 if lid else 1, 4))):
        axis, at = int(rng.integers(3)), rng.uniform(-0.4, 0.4, size=3) * half
        at[axis] = half[axis] * rng.choice([-1, 1])
        window = rng.uniform(0.08, 0.5, size=3) * half
        window[axis] = 3 * wall
        tools.append(placed(box(window), UPRIGHT, at))
    walls = fine_surface(subtract(outer, tools), rng, target // 2, wall)
    parts = [walls, *_contents(rng, target // 2, half - 2 * wall)]
    if lid:
        cover = cylinder(half[0], 0.5 * wall) if drum else box([half[0], 0.5 * wall, half[2]])
        tilt = moved(surface_of(cover, rng, max(target // 6, 300), 2.0), _turn(2, rng.uniform(-0.06, 0.06)))
        parts.append(moved(tilt, offset=(rng.uniform(-0.15, 0.15), half[1] + rng.uniform(0.02, 0.2), 0.0)))
    return thinned(join(parts), rng, target)


def _contents(rng: np.random.Generator, target: int, half: Float[np.ndarray, "3"]) -> list[RawMesh]:
    """Boxes, gears, brackets and shafts within a box of this half size, spread over its floor."""
    count = int(rng.integers(1, 2 + min(5, target // 60)))
    parts = []
    for number in range(count):
        part = _part(rng, max(60, target // count), int(rng.integers(4)))
        size = rng.uniform(0.25, 0.5) * half.min()
        part = moved(part, _turn(int(rng.integers(3)), 0.5 * np.pi), scale=size / np.abs(part.vertices).max())
        angle = 2.4 * number
        spot = 0.6 * np.sqrt(number / count) * half * [np.cos(angle), 0, np.sin(angle)]
        spot[1] = rng.uniform(-1.0, 0.2) * half[1] + size
        parts.append(moved(part, offset=spot))
    return parts


def _part(rng: np.random.Generator, target: int, kind: int) -> RawMesh:
    """A block, a gear, a drilled plate, a bracket or, from 4 on, a shaft along y; within about the unit ball."""
    if kind == 0:
        block = [np.linspace(-h, h, int(rng.integers(2, 5))) for h in rng.uniform(0.3, 0.8, size=3)]
        return lattice_surface(np.ones([len(cuts) - 1 for cuts in block], bool), block, rng)
    if kind < 4:
        return (gear, plate, bracket)[kind - 1](rng, max(target, 150))
    return surface_of(cylinder(rng.uniform(0.06, 0.14), 1.0), rng, max(target, 400), 1.3)


def machine(rng: np.random.Generator, target: int) -> RawMesh:
    """5 to 15 gears, plates, rings, brackets and blocks that touch or run through one another, on shafts and a base."""
    count, parts = int(rng.integers(5, 6 + min(10, target // 60))), []
    share = target // (count + 1)
    shafts = rng.uniform(-0.7, 0.7, size=(int(rng.integers(1, 4)), 3))
    ways = [_turn(int(rng.integers(3)), 0.5 * np.pi) for _ in shafts]
    for middle, way in zip(shafts, ways, strict=True):
        parts.append(moved(_part(rng, share, 4), way, middle))
    while len(parts) < count:
        at = int(rng.integers(len(shafts)))
        kind = int(rng.choice(5, p=[0.2, 0.35, 0.15, 0.15, 0.15]))
        ring = torus(rng.uniform(0.5, 0.8), rng.uniform(0.08, 0.2))
        part = surface_of(ring, rng, max(share, 400), 1.3) if kind == 4 else _part(rng, share, kind)
        if kind == 2:  # plates lie across z
            part = moved(part, _turn(0, 0.5 * np.pi))
        part = moved(part, ways[at], scale=rng.uniform(0.15, 0.4) / np.abs(part.vertices).max())
        along = ways[at] @ np.array([0.0, 0.9 - 1.8 * (len(parts) * 0.618 % 1), 0.0])  # even, whatever the count
        parts.append(moved(part, offset=shafts[at] + along + rng.choice([0.0, 0.15]) * rng.normal(size=3)))
    low = min(part.vertices[:, 1].min() for part in parts) + rng.uniform(0.0, 0.2)
    base = [np.linspace(-1, 1, 6), np.array([-0.1, 0.0]), np.linspace(-1, 1, 6)]
    slab = lattice_surface(np.ones((5, 1, 5), bool), base, rng)
    return thinned(join([*parts, moved(slab, offset=(0, low, 0))]), rng, target)


def layers(rng: np.random.Generator, target: int) -> RawMesh:
    """Thin sheets close to each other: folded cloth, leaves, pages or fins at a spine, shells one in the other."""
    style, count = int(rng.integers(4)), int(rng.integers(3, 4 + min(5, target // 150)))
    gap, thick, fine = rng.uniform(0.06, 0.16), rng.uniform(0.012, 0.025), max(target, 1500)
    if style == 0:
        return thinned(_folded_cloth(rng, fine, gap, thick, min(count, 6)), rng, target)
    if style == 1:
        balls = [shell(sphere((0, 0, 0), 1 - number * (gap + 0.07)), 0.07) for number in range(min(count, 4))]
        cut = placed(box([2, 2, 2]), random_rotation(rng), rng.uniform(1.9, 2.5) * random_rotation(rng)[0])
        holes = [capsule((0, 0, 0), 2 * way, 0.3, 0.3) for way in random_rotation(rng)[: int(rng.integers(3))]]
        return fine_surface(subtract(union(balls), [cut, *holes]), rng, target, 0.07)
    wave, curl = value_noise(rng, rng.uniform(0.5, 1.2), octaves=1), rng.uniform(0.0, 1.2)
    wild, depth = (rng.uniform(0.0, 0.4) * gap if style == 2 else 0.0), rng.uniform(0.6, 1.0)
    parts = []
    for number in range(count):
        flat = flat_domain(rng, fine // (2 * count))
        u, v = 2 * flat.vertices[:, 0] - 1, 2 * flat.vertices[:, 1] - 1
        height = gap * (number - 0.5 * count) + wild * wave(flat.vertices + number) + 0.3 * curl * u * u
        parts.append(_thickened(RawMesh(np.stack([u, height, -depth * v], -1), flat.faces), thick))
    if style == 3:
        low, high = parts[0].vertices[:, 1].min(), parts[-1].vertices[:, 1].max()
        spine = [np.array([0.0, 0.12]), np.linspace(low, high, 4), np.linspace(-depth, depth, 4)]
        solid = lattice_surface(np.ones((1, 3, 3), bool), spine, rng)
        parts.append(moved(solid, offset=(-1.03, 0.5 * (low + high), 0)))
    return thinned(join(parts), rng, target)


def _folded_cloth(rng: np.random.Generator, target: int, gap: float, thick: float, count: int) -> RawMesh:
    """One sheet laid to and fro in `count` layers."""
    flat = flat_domain(rng, target // 2, rng.uniform(3.0, 5.0))
    along, across = count * flat.vertices[:, 1], flat.vertices[:, 0]
    sway = rng.uniform(0, 0.2) * np.sin(rng.uniform(1, 3) * across + rng.uniform(0, 3))
    # level between the turns, steep in them
    height = gap * (along - 0.5 * count + np.sin(2 * np.pi * along) / (2 * np.pi))
    middle = np.stack([0.8 * np.cos(np.pi * along) + sway, height, 1.6 * across - 0.8], -1)
    return _thickened(RawMesh(middle, flat.faces), min(thick, 0.25 * gap))


def _thickened(sheet: RawMesh, thick: float) -> RawMesh:
    """The closed body between a sheet and itself, moved along its normals."""
    step = 0.5 * thick * mean_normals(sheet)
    count, faces = len(sheet.vertices), sheet.faces
    directed = np.stack([faces, np.roll(faces, -1, axis=1)], -1).reshape(-1, 2)
    rim = directed[~np.isin(directed @ [count, 1], directed @ [1, count])]
    a, b = rim.T
    walls = [np.stack([b, a, a + count], -1), np.stack([b, a + count, b + count], -1)]
    vertices = np.concatenate([sheet.vertices + step, sheet.vertices - step])
    return outward(RawMesh(vertices, np.concatenate([faces, faces[:, ::-1] + count, *walls])))


def figure(rng: np.random.Generator, target: int) -> RawMesh:
    """A figure, an animal or a hand whose limbs come near its body or each other."""
    return fine_surface(posed_limbs(rng), rng, target, 0.1)


def _turn(axis: int, angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about one of the axes."""
    c, s = np.cos(angle), np.sin(angle)
    return np.roll(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), (axis, axis), axis=(0, 1))
