"""Recipes for swept shapes: tubes and knots, superquadrics, turned vessels, grooved bodies, needles, sheets.

A recipe maps a generator and a vertex count to a surface of about unit radius with about that many vertices. Sheets
and some vessels are open; everything else is closed.
"""

import numpy as np
from jaxtyping import Float

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.parametric import flat_domain, grid_shape, revolved, spacing, sphere_points, swept, tube
from gash_jax.shapes.sdf import creases, value_noise, wave_noise
from gash_jax.shapes.triangles import join, moved, outward, random_rotation


def knot(rng: np.random.Generator, target: int) -> RawMesh:
    """Closed tubes about torus and Lissajous knots, open coils and wandering ropes; round, ribbed or square."""
    rows, columns = grid_shape(target, rng.uniform(4.0, 14.0))
    style = int(rng.integers(4))
    closed = style < 2
    s = 2 * np.pi * spacing(rng, rows, closed=closed)
    if style == 0:
        p, q = ((2, 3), (3, 2), (2, 5), (3, 4), (1, 3), (1, 0), (5, 2))[int(rng.integers(7))]
        ring = 1.0 + rng.uniform(0.3, 0.55) * np.cos(q * s)
        curve = np.stack([ring * np.cos(p * s), ring * np.sin(p * s), rng.uniform(0.3, 0.7) * np.sin(q * s)], -1)
    elif style == 1:
        a, b, c = ((3, 2, 7), (2, 3, 5), (3, 4, 7), (1, 2, 3))[int(rng.integers(4))]
        phase = rng.uniform(0.2, 1.2, size=3)
        curve = np.stack([np.cos(a * s + phase[0]), np.cos(b * s + phase[1]), 0.8 * np.cos(c * s + phase[2])], -1)
    elif style == 2:
        turns, rise = rng.uniform(2, 6), rng.uniform(0.5, 2.0)
        ring = 1.0 - rng.uniform(0, 0.8) * s / (2 * np.pi)
        curve = np.stack([ring * np.cos(turns * s), rise * (s / np.pi - 1), ring * np.sin(turns * s)], -1)
    else:
        waves = rng.normal(size=(3, 3)) / np.array([1.0, 1.5, 3.0])[:, None]
        curve = np.stack([s / np.pi - 1, 0 * s, 0 * s], -1)
        curve = curve + sum(w * np.sin((i + 1) * 0.5 * s)[:, None] for i, w in enumerate(waves)) * 0.6
    thickness = np.clip(rng.uniform(0.25, 0.5) * _clearance(curve, closed), rng.uniform(0.05, 0.1), 0.4)
    angle = 2 * np.pi * np.arange(columns) / columns
    ribs = 1 + rng.uniform(0, 0.25) * np.cos(rng.integers(2, 7) * s)[:, None]
    section = 1 - rng.uniform(0, 0.45) * np.cos(rng.integers(2, 5) * angle)[None] ** 2
    reference = curve - curve.mean(axis=0) if closed else np.broadcast_to(_least_along(curve), curve.shape)
    return outward(tube(curve, thickness * ribs * section, reference, rng, closed))


def _clearance(curve: Float[np.ndarray, "r 3"], closed: bool) -> float:
    """Smallest distance between stretches of the curve that are not neighbours along it."""
    steps = np.linalg.norm(np.roll(curve, -1, axis=0) - curve, axis=-1)
    place = np.concatenate([[0.0], np.cumsum(steps[:-1])])
    gap = np.abs(place[:, None] - place)
    gap = np.minimum(gap, steps.sum() - gap) if closed else gap
    distance = np.linalg.norm(curve[:, None] - curve, axis=-1)
    # neighbours: no further along the curve than half a circle with this distance as its diameter
    return float(np.where(gap > 1.7 * distance, distance, np.inf).min(initial=1.0))


def _least_along(curve: Float[np.ndarray, "r 3"]) -> Float[np.ndarray, "3"]:
    tangent = np.gradient(curve, axis=0)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    worst = np.abs(tangent @ np.eye(3)).max(axis=0)
    return np.eye(3)[int(worst.argmin())]


def superquadric(rng: np.random.Generator, target: int) -> RawMesh:
    """Superellipsoids, pinched stars, superformula bodies with lobes, supertoroids."""
    style = int(rng.integers(3))
    if style == 2:
        rows, columns = grid_shape(target, rng.uniform(0.8, 3.0))
        u, v = (2 * np.pi * spacing(rng, n, closed=True) for n in (rows, columns))
        e, f = rng.uniform(0.25, 1.8, size=2)
        ring = 1 + rng.uniform(0.2, 0.75) * _power(np.cos(v), f)
        height = rng.uniform(0.3, 0.9) * np.broadcast_to(_power(np.sin(v), f), (rows, columns))
        lobes = 1 + rng.uniform(0, 0.25) * np.cos(rng.integers(2, 8) * u)
        flat = (
            ring[None] * (lobes * _power(np.cos(u), e))[:, None],
            ring[None] * (lobes * _power(np.sin(u), e))[:, None],
        )
        return outward(swept(np.stack([flat[0], height, flat[1]], -1), rng, wrap_rows=True))
    directions, faces = sphere_points(rng, target)[:2]
    scale = rng.uniform(0.4, 1.0, size=3)
    if style == 0:
        e, f = rng.choice([0.25, 0.6, 1.6, 2.2, 2.8], size=2)
        x, y, z = np.maximum(np.abs(directions / scale), 1e-9).T
        radius = ((x ** (2 / f) + y ** (2 / f)) ** (f / e) + z ** (2 / e)) ** (-e / 2)
        return RawMesh(directions * radius[:, None], faces)
    azimuth, polar = np.arctan2(directions[:, 0], directions[:, 2]), np.arcsin(np.clip(directions[:, 1], -1, 1))
    depth, fade = rng.uniform(0.15, 0.6), np.cos(polar) ** 2
    lobes = 1 + depth * fade * np.cos(rng.integers(2, 9) * azimuth + rng.uniform(0, 4) * polar)
    bands = 1 + rng.uniform(0, 0.35) * np.cos(rng.integers(2, 7) * 2 * polar)
    return RawMesh(directions * (lobes * bands)[:, None] * scale, faces)


def _power(values: np.ndarray, exponent: float) -> np.ndarray:
    return np.sign(values) * np.abs(values) ** exponent


def vessel(rng: np.random.Generator, target: int) -> RawMesh:
    """Turned bowls, cups, vases and bottles, one wall or two, some with a handle, a spout or a lid."""
    extras = [kind for kind, share in (("handle", 0.35), ("spout", 0.25), ("lid", 0.25)) if rng.random() < share]
    rows, columns = grid_shape(round(target * (1 - 0.14 * len(extras))), rng.uniform(0.5, 2.0))
    walls = int(rng.integers(1, 3))
    h = spacing(rng, max(5, rows // walls))
    radius = np.full(len(h), rng.uniform(0.3, 0.9))
    for i in range(1, 5):
        radius += rng.normal(scale=0.32 / i) * np.cos(i * np.pi * h + rng.uniform(-0.6, 0.6))
    radius = 0.12 + np.logaddexp(0, 6 * (radius - 0.12)) / 6
    height = rng.uniform(0.8, 2.2)
    outer = np.stack([radius, height * (h - 0.5)], -1)
    if walls == 2:
        wall = rng.uniform(0.05, 0.12)
        inner = np.stack([np.maximum(radius - wall, 0.03), np.maximum(outer[:, 1], outer[0, 1] + wall)], -1)
        profile = np.concatenate([outer, inner[::-1]])
    else:
        profile = outer
    waves = rng.integers(3, 16) * 2 * np.pi * np.arange(columns) / columns
    flutes = 1 + rng.integers(0, 2) * rng.uniform(0.02, 0.12) * np.cos(waves)[None]
    parts = [revolved(profile, columns, rng, flutes, poles=(True, walls == 2))]
    at = int(0.5 * len(h))
    for kind in extras:
        parts.append(_fitting(rng, kind, round(0.14 * target), radius[at], radius[-1], height))
    return join(parts)


def _fitting(rng: np.random.Generator, kind: str, target: int, waist: float, rim: float, height: float) -> RawMesh:
    """A handle, spout or lid that enters the wall of a vessel a little, as modelled parts do."""
    rows, columns = grid_shape(target, rng.uniform(2.0, 5.0))
    if kind == "lid":
        t = np.linspace(0.03, np.pi - 0.03, rows)
        neck = 1 - 0.75 * np.exp(-(((t - 0.5) / 0.3) ** 2))
        knob = 0.22 * np.cos(t) + 0.12 * np.exp(-((t / 0.35) ** 2))
        profile = np.stack([rim * np.sin(t) * neck, 0.52 * height + knob], -1)
        return outward(revolved(profile[::-1], columns, rng, poles=(True, True)))
    s = np.linspace(0, 1, rows)
    if kind == "handle":
        reach = rng.uniform(0.3, 0.6)
        arc = np.pi * s
        curve = np.stack([waist - 0.05 + reach * np.sin(arc), 0.25 * height * np.cos(arc), 0 * s], -1)
        thickness = rng.uniform(0.04, 0.09) * np.ones((rows, columns))
    else:
        curve = np.stack([-waist + 0.08 - 0.7 * s, height * (0.55 * s**2 - 0.15), 0 * s], -1)
        thickness = np.repeat((0.16 - 0.1 * s)[:, None], columns, axis=1)
    return outward(tube(curve, thickness, np.broadcast_to([0.0, 0.0, 1.0], curve.shape), rng, closed=False))


def grooved(rng: np.random.Generator, target: int) -> RawMesh:
    """Turned bodies with rings, flutes, threads or knurls of round, triangular or square section; deep or fine."""
    slope = int(rng.integers(4))  # rings, flutes, threads, knurls
    rows, columns = grid_shape(target, (rng.uniform(1.0, 4.0), rng.uniform(0.15, 0.6), 2.0, 1.0)[slope])
    h = spacing(rng, rows)[:, None]
    angle = (2 * np.pi * np.arange(columns) / columns)[None]
    count, turns = rng.integers(3, max(5, rows // 6)), rng.integers(4, max(6, columns // 6))
    along, around = ((count, 0), (0, turns), (count, rng.integers(1, 4)), (count, turns))[slope]
    phase = 2 * np.pi * along * h + around * angle
    wave = 0.5 + 0.5 * np.cos(phase)
    if slope == 3:
        wave = wave * (0.5 + 0.5 * np.cos(2 * np.pi * along * h - around * angle))
    sharpness = rng.uniform(0.3, 4.0)
    wave = np.tanh(sharpness * (wave - rng.uniform(0.2, 0.7))) / np.tanh(sharpness)
    body = 1 + rng.uniform(-0.4, 0.4) * np.sin(np.pi * h + rng.uniform(0, 3)) if rng.random() < 0.6 else 1 + 0 * h
    radius = body * (1 - rng.uniform(0.1, 0.5) * (0.5 - 0.5 * wave)) + 0 * angle
    height = rng.uniform(0.6, 3.0)
    if rng.random() < 0.3:
        return _ringed(rng, radius, height)
    profile = np.stack([np.ones(rows), height * (h[:, 0] - 0.5)], -1)
    return outward(revolved(profile, columns, rng, radius, poles=(True, True)))


def _ringed(rng: np.random.Generator, radius: Float[np.ndarray, "r c"], height: float) -> RawMesh:
    """The grooved band as the outside of a ring with a smooth bore."""
    rows, columns = radius.shape
    bore = np.full((max(2, rows // 5), columns), radius.min() * rng.uniform(0.4, 0.85))
    inner = np.linspace(0.5, -0.5, len(bore))
    profile = np.stack([np.ones(rows + len(bore)), height * np.concatenate([np.linspace(-0.5, 0.5, rows), inner])], -1)
    return outward(revolved(profile, columns, rng, np.concatenate([radius, bore]), closed_rows=True))


def needle(rng: np.random.Generator, target: int) -> RawMesh:
    """Thin and long: curved needles, handles with shafts, bundles of rods, tongs."""
    count = int(rng.choice([1, 1, 2, 3, 5]))
    rows, columns = grid_shape(round(target / count), rng.uniform(5.0, 16.0))
    s = spacing(rng, rows)
    reach, bow = rng.uniform(6.0, 20.0), rng.uniform(0.0, 2.6) * rng.integers(0, 2)
    parts = []
    for _ in range(count):
        profile = np.full(rows, rng.uniform(0.15, 0.35))
        if rng.random() < 0.6:
            profile += rng.uniform(0.2, 0.6) / (1 + np.exp(60 * (s - rng.uniform(0.2, 0.6))))
        profile *= 1 - rng.uniform(0, 0.97) * np.clip((s - rng.uniform(0.6, 0.9)) / 0.3, 0, 1)
        profile *= 1 + rng.uniform(0, 0.2) * np.cos(2 * np.pi * rng.integers(4, 24) * s)
        theta = bow * (s - 0.5) if bow > 0.2 else None
        line = np.stack([reach * (s - 0.5), 0 * s, 0 * s], -1)
        arc = line if theta is None else reach / bow * np.stack([np.sin(theta), np.cos(theta) - 1, 0 * s], -1)
        spread = rng.uniform(-1, 1, size=3) * [1.0, 0.45, 0.45] * (count > 1)
        angle = 2 * np.pi * np.arange(columns) / columns
        section = 1 - rng.uniform(0, 0.5) * np.cos(rng.integers(2, 4) * angle)[None] ** 2
        reference = np.broadcast_to([0.0, 0.0, 1.0], arc.shape)
        parts.append(moved(outward(tube(arc, profile[:, None] * section, reference, rng, closed=False)), offset=spread))
    return join(parts)


def sheet(rng: np.random.Generator, target: int) -> RawMesh:
    """Open surfaces: terrain, pleated cloth, rolls, twisted ribbons, petals."""
    style = int(rng.integers(5))
    leaves = int(rng.integers(4, 9)) if style == 4 else 1
    parts = []
    for leaf in range(leaves):
        flat, faces = flat_domain(rng, target // leaves, rng.uniform(0.4, 2.5))[:2]
        u, v = flat[:, 0], flat[:, 1]
        if style == 0:
            parts.append(RawMesh(_terrain(rng, flat), faces))
        elif style == 1:
            folds, depth, slant = (
                rng.integers(2, 3 + len(flat) ** 0.5 / 10),
                rng.uniform(0.08, 0.3),
                rng.uniform(0, 1.5),
            )
            phase = 2 * np.pi * folds * (u + 0.2 * slant * v)
            sway = 0.12 * depth * folds * np.sin(2 * phase) * rng.uniform(0, 1) / folds
            parts.append(RawMesh(np.stack([u + sway, depth * (0.3 + v) * np.sin(phase), 1.3 * v], -1), faces))
        elif style == 2:
            turn = rng.uniform(2.5, 14.0)
            radius = 0.3 + rng.uniform(0.05, 0.12) * turn * u + 0.1 * v * rng.uniform(-1, 1)
            parts.append(RawMesh(np.stack([radius * np.cos(turn * u), radius * np.sin(turn * u), 1.5 * v], -1), faces))
        elif style == 3:
            twist, bend = rng.uniform(1, 9) * u, rng.uniform(0.5, 5) * u
            across = 0.6 * (v - 0.5)
            ring = 1 + across * np.cos(twist)
            parts.append(
                RawMesh(np.stack([ring * np.cos(bend), ring * np.sin(bend), across * np.sin(twist)], -1), faces)
            )
        else:
            parts.append(RawMesh(_petal(rng, flat, (leaf + rng.uniform(-0.2, 0.2)) / leaves), faces))
    return moved(join(parts), random_rotation(rng))


def _terrain(rng: np.random.Generator, flat: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    noise = (
        value_noise(rng, rng.uniform(2, 6), octaves=int(rng.integers(1, 5))),
        wave_noise(rng, rng.uniform(0.8, 3), 5),
        creases(value_noise(rng, rng.uniform(2, 5), octaves=2), rng.uniform(0.1, 0.4)),
    )[int(rng.integers(3))]
    return flat + [0, 0, 1.0] * (rng.uniform(-0.35, 0.35) * noise(flat))[:, None]


def _petal(rng: np.random.Generator, flat: Float[np.ndarray, "v 3"], turns: float) -> Float[np.ndarray, "v 3"]:
    """A leaf that droops outward from the y axis, turned about it."""
    u, v = flat[:, 0], flat[:, 1]
    wide, droop = np.sin(np.pi * np.clip(v, 0.02, 0.98)) ** 0.7 * rng.uniform(0.3, 0.7), rng.uniform(0.2, 2.2)
    side = wide * (u - 0.5)
    up, out = np.sin(droop * v) / droop - side**2, 0.1 + (1 - np.cos(droop * v)) / droop + 0.3 * v
    c, s = np.cos(2 * np.pi * turns), np.sin(2 * np.pi * turns)
    return np.stack([c * side + s * out, up, c * out - s * side], -1)
