"""Recipes for grown shapes: blobs, folded and displaced bodies, limbs, cavities.

A recipe maps a generator and a vertex count to a closed surface of about unit radius with about that many
vertices. Solids are signed distances (`sdf`); displaced bodies move the vertices of a triangulated sphere.
"""

import numpy as np
from jaxtyping import Float

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.parametric import sphere_points
from gash_jax.shapes.sdf import (
    Field,
    Vector,
    box,
    capsule,
    creases,
    cylinder,
    placed,
    shell,
    sphere,
    subtract,
    surface_of,
    torus,
    union,
    value_noise,
    wave_noise,
    winding_folds,
)
from gash_jax.shapes.triangles import largest_parts, random_rotation


def random_solid(rng: np.random.Generator, size: float) -> Field:
    """A turned primitive about the origin with about the given radius."""
    a, b = size * rng.uniform(0.35, 1.0, size=2)
    choice = int(rng.integers(5))
    solid = (
        sphere((0, 0, 0), a),
        capsule((0, -a, 0), (0, a, 0), size * rng.uniform(0.2, 0.6), size * rng.uniform(0.2, 0.6)),
        box(size * rng.uniform(0.3, 0.9, size=3), rounding=0.1 * size),
        torus(0.8 * size, size * rng.uniform(0.18, 0.4)),
        cylinder(a, b),
    )[choice]
    return placed(solid, random_rotation(rng))


def blob(rng: np.random.Generator, target: int) -> RawMesh:
    """Smooth unions of 2 to 9 primitives, some with pieces bitten out."""
    parts = []
    for _ in range(int(rng.integers(2, 10))):
        offset = rng.normal(size=3)
        offset *= rng.uniform(0.2, 0.75) / np.linalg.norm(offset)
        parts.append(placed(random_solid(rng, rng.uniform(0.2, 0.55)), np.eye(3), offset))
    bites = []
    for _ in range(int(rng.integers(0, 4))):
        offset = rng.normal(size=3)
        offset *= rng.uniform(0.4, 0.9) / np.linalg.norm(offset)
        bites.append(placed(random_solid(rng, rng.uniform(0.2, 0.45)), np.eye(3), offset))
    solid = subtract(union(parts, rng.uniform(0.02, 0.4)), bites, rng.uniform(0.0, 0.12))
    return surface_of(solid, rng, target, 1.6)


def folded(rng: np.random.Generator, target: int) -> RawMesh:
    """One or two lobes with winding furrows along the zero set of a noise, as on brains, wood and stone."""
    spread = rng.uniform(0.0, 0.42) if rng.random() < 0.35 else 0.0
    radii = np.array([[0.75, 0.85, 1.0]]) * rng.uniform(0.85, 1.15, size=(2, 3))
    lobes = [ellipsoid((side * spread, 0.0, 0.0), r) for side, r in zip((-1, 1), radii, strict=True)]
    body = union(lobes, rng.uniform(0.0, 0.15)) if spread else lobes[0]
    # a furrow is about width / frequency wide: four edges or more across it
    frequency = rng.uniform(1.2, 0.9 + 0.05 * np.sqrt(target))
    depth, width = rng.uniform(0.1, 0.45), rng.uniform(0.14, 0.4)
    furrows = creases(value_noise(rng, frequency, octaves=1), width)
    if rng.random() < 0.4:
        furrows = winding_folds(
            value_noise(rng, 1.0, octaves=1), rng.uniform(1.0, max(1.2, 0.8 + 0.025 * np.sqrt(target)))
        )
    bumps, bump_height = value_noise(rng, rng.uniform(2, 5), octaves=2), rng.uniform(0.0, 0.04)
    upright = rng.random() < 0.6  # furrows that go straight down, as sulci do, or any way, as in rock
    warp, bend = [wave_noise(rng, 0.6, 3) for _ in range(3)], rng.uniform(0.0, 0.2)

    def solid(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        bent = points + bend * np.stack([noise(points) for noise in warp], -1)
        if upright:
            bent = bent / np.maximum(np.linalg.norm(points, axis=-1, keepdims=True), 0.3)
        return body(points) + depth * furrows(bent) + bump_height * bumps(points)

    return largest_parts(surface_of(solid, rng, target, 1.7), 0.2)


def displaced(rng: np.random.Generator, target: int) -> RawMesh:
    """A triangulated ellipsoid displaced along the radius by octaves of noise or by furrows.

    The slope is bounded by limiting the amplitude of high frequencies; the surface stays star-shaped, hence
    free of self-intersections.
    """
    directions, faces = sphere_points(rng, target)[:2]
    style, amplitude, frequency = rng.integers(4), rng.uniform(0.15, 0.6), rng.uniform(0.8, 2.4)
    if style == 0:
        height = value_noise(rng, frequency, octaves=int(rng.integers(1, 5)), gain=rng.uniform(0.3, 0.6))(directions)
    elif style == 1:
        height = wave_noise(rng, frequency, int(rng.integers(3, 9)))(directions)
    elif style == 2:
        height = -creases(value_noise(rng, 1.5 * frequency, octaves=2, gain=0.3), rng.uniform(0.1, 0.4))(directions)
    else:
        ridges = np.abs(value_noise(rng, frequency, octaves=3)(directions))
        height = rng.choice([-1.6, 1.6]) * ridges ** rng.uniform(0.5, 1.5)
    radius = np.exp(amplitude * height)
    return RawMesh(directions * radius[:, None] * rng.uniform(0.45, 1.0, size=3), faces)


def limbs(rng: np.random.Generator, target: int) -> RawMesh:
    """Blended capsule skeletons: four-legged and standing figures, hands, branching growths."""
    grow = (animal, _figure, _hand, _branches)[int(rng.choice(4, p=[0.35, 0.25, 0.15, 0.25]))]
    bones = grow(rng)
    solid = union([capsule(*bone) for bone in bones], rng.uniform(0.03, 0.14))
    if rng.random() < 0.4:
        skin, height = value_noise(rng, rng.uniform(1.5, 4), octaves=2), rng.uniform(0.01, 0.05)
        return surface_of(lambda points: solid(points) + height * skin(points), rng, target, 2.2)
    return surface_of(solid, rng, target, 2.2)


Bone = tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], float, float]


def _chain(
    rng: np.random.Generator,
    start: Float[np.ndarray, "3"],
    step: Float[np.ndarray, "3"],
    joints: int,
    radius: float,
    taper: float,
    wander: float,
) -> list[Bone]:
    """Bones one after the other, each turned and thinned a little."""
    bones = []
    for _ in range(joints):
        end = start + step
        bones.append((start, end, radius, radius * taper))
        step = (step + wander * np.linalg.norm(step) * rng.normal(size=3)) * rng.uniform(0.8, 1.05)
        start, radius = end, radius * taper
    return bones


def _mirrored(bones: list[Bone], rng: np.random.Generator, jitter: float) -> list[Bone]:
    """The bones and their mirror image in x, the image moved a little at its far ends."""
    flip = np.array([-1.0, 1.0, 1.0])
    sway = jitter * rng.normal(size=3)
    image = [(a * flip + i * sway, b * flip + (i + 1) * sway, r, s) for i, (a, b, r, s) in enumerate(bones)]
    return bones + image


def animal(rng: np.random.Generator) -> list[Bone]:
    """Capsules of a standing animal: trunk along z, four legs down, neck, head, some with ears, tail."""
    length, girth, leg = rng.uniform(0.5, 0.9), rng.uniform(0.16, 0.38), rng.uniform(0.25, 0.55)
    hip, chest = np.array([0, 0, -length]), np.array([0, rng.uniform(-0.1, 0.2), length])
    bones: list[Bone] = [(hip, chest, girth * rng.uniform(0.8, 1.1), girth)]
    for z in (-length, length):
        start, thick = np.array([0.7 * girth, -0.3 * girth, z]), girth * rng.uniform(0.3, 0.55)
        down = leg * np.array([rng.uniform(0, 0.3), -1.0, rng.uniform(-0.4, 0.4)])
        bones += _mirrored(_chain(rng, start, down, 2, thick, 0.75, 0.15), rng, 0.08)
    rise = np.array([0, rng.uniform(0.1, 0.5), rng.uniform(0.15, 0.35)])
    neck = _chain(rng, chest, rise, int(rng.integers(1, 3)), 0.6 * girth, 0.9, 0.1)
    head, size = neck[-1][1], girth * rng.uniform(0.45, 0.9)
    bones += neck + [(head, head + np.array([0, -0.05, 1.3 * size]), size, 0.6 * size)]
    if rng.random() < 0.7:
        ear = (head + [0.5 * size, 0.4 * size, 0], head + [size, size * rng.uniform(1.2, 2.4), -0.1], 0.3 * size, 0.12)
        bones += _mirrored([ear], rng, 0.02)
    tail = rng.uniform(0.15, 0.3) * np.array([0, rng.uniform(-0.6, 0.8), -1.0])
    return bones + _chain(rng, hip - [0, 0, 0.5 * girth], tail, 3, 0.35 * girth + 0.03, 0.8, 0.3)


def _figure(rng: np.random.Generator) -> list[Bone]:
    girth, width = rng.uniform(0.18, 0.34), rng.uniform(0.2, 0.4)
    pelvis, chest = np.array([0, -0.3, 0.0]), np.array([0, 0.35, rng.uniform(-0.1, 0.1)])
    bones: list[Bone] = [(pelvis, chest, girth, girth * rng.uniform(0.9, 1.4))]
    legs = np.array([rng.uniform(0, 0.2), -rng.uniform(0.35, 0.55), rng.uniform(-0.1, 0.1)])
    arms = rng.uniform(0.3, 0.45) * np.array([rng.uniform(0.3, 1.0), rng.uniform(-1.0, 0.8), rng.uniform(-0.4, 0.4)])
    hip, shoulder = pelvis + [0.6 * width, -0.1, 0], chest + [width, 0.1, 0]
    bones += _mirrored(_chain(rng, hip, legs, 2, 0.6 * girth, 0.8, 0.1), rng, 0.08)
    bones += _mirrored(_chain(rng, shoulder, arms, 3, 0.45 * girth, 0.85, 0.3), rng, 0.1)
    head = chest + [0, 0.3 + girth, 0.02]
    return bones + [(chest, head, 0.5 * girth, 0.4 * girth), (head, head + [0, 0.15, 0.05], 0.25, 0.25)]


def _hand(rng: np.random.Generator) -> list[Bone]:
    thick, curl = rng.uniform(0.09, 0.15), rng.uniform(-0.1, 0.9)
    bones: list[Bone] = [(np.array([0, -1.1, 0]), np.array([0, -0.5, 0]), 1.6 * thick, 2 * thick)]
    count = int(rng.integers(3, 6))
    for x in np.linspace(-0.4, 0.4, count):
        root, finger = np.array([x, 0.15, 0.0]), np.array([0.5 * x, rng.uniform(0.25, 0.38), 0.1])
        bones.append((np.array([0.5 * x, -0.5, 0]), root, 1.5 * thick, 1.2 * thick))
        bend = curl * rng.uniform(0.5, 1.5)
        for _ in range(3):
            bones.append((root, root + finger, thick, 0.88 * thick))
            root = root + finger
            turn = np.array([[1, 0, 0], [0, np.cos(bend), -np.sin(bend)], [0, np.sin(bend), np.cos(bend)]])
            finger = 0.8 * turn @ finger
    thumb = np.array([0.25, 0.25, rng.uniform(0, 0.3)])
    return bones + _chain(rng, np.array([0.3, -0.4, 0.05]), thumb, 2, 1.15 * thick, 0.85, 0.15)


def _branches(rng: np.random.Generator) -> list[Bone]:
    """A trunk or a core with arms that fork once."""
    core = rng.uniform(0.15, 0.4)
    bones: list[Bone] = [(np.array([0, -0.2, 0]), np.array([0, 0.2, 0]), core, core)]
    for _ in range(int(rng.integers(3, 9))):
        out = rng.normal(size=3)
        out *= rng.uniform(0.25, 0.42) / np.linalg.norm(out)
        arm = _chain(rng, 0.5 * out, out, int(rng.integers(2, 4)), core * rng.uniform(0.3, 0.6), 0.8, 0.35)
        tip, step, thin = arm[-1][1], arm[-1][1] - arm[-1][0], arm[-1][3]
        bones += arm
        for _ in range(int(rng.integers(0, 3))):
            bones += _chain(rng, tip, 0.8 * (step + 0.7 * np.linalg.norm(step) * rng.normal(size=3)), 1, thin, 0.7, 0.3)
    return bones


def cavity(rng: np.random.Generator, target: int) -> RawMesh:
    """Hollow shells with openings, some with a body inside: skulls, vessels, caves, helmets."""
    body = (sphere((0, 0, 0), 1.0), box(rng.uniform(0.6, 1.0, size=3), 0.2), cylinder(0.9, rng.uniform(0.5, 1.0)))
    outer = body[int(rng.integers(3))]
    if rng.random() < 0.4:
        outer = union([outer, placed(random_solid(rng, 0.7), np.eye(3), rng.uniform(-0.7, 0.7, size=3))], 0.15)
    hollow = shell(outer, rng.uniform(0.13, 0.26))
    holes = []
    for _ in range(int(rng.integers(1, 5))):
        way = rng.normal(size=3)
        way /= np.linalg.norm(way)
        size = rng.uniform(0.2, 0.6)
        holes.append(capsule(0.5 * way, 2 * way, size, size))
    solid = subtract(hollow, holes, rng.uniform(0.0, 0.1))
    if rng.random() < 0.4:
        inner = placed(random_solid(rng, rng.uniform(0.25, 0.5)), np.eye(3), rng.uniform(-0.3, 0.3, size=3))
        solid = union([solid, inner], 0.0)
    return surface_of(solid, rng, target, 2.0)


def ellipsoid(centre: Vector, radii: Float[np.ndarray, "3"]) -> Field:
    """Ellipsoid along the axes; no exact distance, never more than it."""
    scale = np.asarray(radii, np.float32)
    at = np.asarray(centre, np.float32)
    return lambda points: (np.linalg.norm((points - at) / scale, axis=-1) - 1.0) * scale.min()
