"""Implicit solids: signed distances, blends, noise, and their surface by marching cubes.

Notation: a field maps points (n, 3) to values (n,), negative inside. Blends are the quadratic smooth minimum
min(a, b) - h² k / 4, h = max(k - |a - b|, 0) / k, which changes nothing where |a - b| >= k; k = 0 is the sharp
minimum. Blended or displaced fields are no longer exact distances, only their zero set matters.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float
from scipy.ndimage import map_coordinates
from skimage.measure import marching_cubes

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.triangles import largest_parts, random_rotation

Vector = Float[np.ndarray, "3"] | Sequence[float | int]
Field = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n"]]


def sphere(centre: Vector, radius: float) -> Field:
    """Ball."""
    return lambda points: np.linalg.norm(points - np.asarray(centre, points.dtype), axis=-1) - radius


def capsule(start: Vector, end: Vector, start_radius: float, end_radius: float) -> Field:
    """Segment with a radius that changes linearly along it."""
    start, axis = np.asarray(start, np.float32), np.subtract(end, start).astype(np.float32)

    def field(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        along = np.clip((points - start) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        away = np.linalg.norm(points - start - along[:, None] * axis, axis=-1)
        return away - start_radius - along * (end_radius - start_radius)

    return field


def box(half: Vector, rounding: float = 0.0) -> Field:
    """Axis-aligned box about the origin with rounded edges."""
    half = np.asarray(half, np.float32)

    def field(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        beyond = np.abs(points) - half + rounding
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        return outside + np.minimum(beyond.max(axis=-1), 0.0) - rounding

    return field


def cylinder(radius: float, half_height: float) -> Field:
    """Cylinder about the y axis."""

    def field(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        round_part = np.hypot(points[:, 0], points[:, 2]) - radius
        return np.maximum(round_part, np.abs(points[:, 1]) - half_height)

    return field


def torus(ring: float, tube: float) -> Field:
    """Torus about the y axis."""
    return lambda points: np.hypot(np.hypot(points[:, 0], points[:, 2]) - ring, points[:, 1]) - tube


def placed(field: Field, rotation: Float[np.ndarray, "3 3"], offset: Vector = (0.0, 0.0, 0.0)) -> Field:
    """The solid under x -> rotation x + offset."""
    rotation, offset = rotation.astype(np.float32), np.asarray(offset, np.float32)
    return lambda points: field((points - offset) @ rotation)


def smooth_minimum(a: Float[np.ndarray, "n"], b: Float[np.ndarray, "n"], blend: float) -> Float[np.ndarray, "n"]:
    """min(a, b) with the crease filled over a width `blend`."""
    if blend == 0.0:
        return np.minimum(a, b)
    h = np.maximum(blend - np.abs(a - b), 0.0) / blend
    return np.minimum(a, b) - 0.25 * blend * h * h


def union(fields: Sequence[Field], blend: float = 0.0) -> Field:
    """All solids, blended where they meet."""

    def field(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        value = fields[0](points)
        for other in fields[1:]:
            value = smooth_minimum(value, other(points), blend)
        return value

    return field


def subtract(body: Field, tools: Sequence[Field], blend: float = 0.0) -> Field:
    """The body without the tools."""
    if not tools:
        return body
    removed = union(tools, 0.0)
    return lambda points: -smooth_minimum(-body(points), removed(points), blend)


def shell(field: Field, thickness: float) -> Field:
    """The layer of the given thickness inside the surface."""
    return lambda points: np.abs(field(points) + 0.5 * thickness) - 0.5 * thickness


def value_noise(rng: np.random.Generator, frequency: float, octaves: int, gain: float = 0.5) -> Field:
    """Smooth noise, roughly in -1..1: lattice values under smoothstep interpolation, several octaves."""
    size = 12
    lattices = rng.uniform(-1.0, 1.0, size=(octaves, size, size, size)).astype(np.float32)
    rotations = [random_rotation(rng).astype(np.float32) for _ in range(octaves)]
    shifts = rng.uniform(0, size, size=(octaves, 3)).astype(np.float32)

    def field(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        total = np.zeros(len(points), np.float32)
        for octave, lattice in enumerate(lattices):
            at = points @ rotations[octave] * (frequency * 2.0**octave) + shifts[octave]
            cell = np.floor(at)
            fraction = at - cell
            smooth = cell + fraction * fraction * (3.0 - 2.0 * fraction)
            total += gain**octave * map_coordinates(lattice, smooth.T, order=1, mode="grid-wrap")
        return total

    return field


def wave_noise(rng: np.random.Generator, frequency: float, waves: int, spread: float = 1.5) -> Field:
    """Mean of spherical sine waves about random centres, each in -1..1."""
    centres = rng.normal(scale=spread, size=(waves, 3)).astype(np.float32)
    frequencies = frequency * rng.uniform(0.6, 1.6, size=waves)
    phases = rng.uniform(0, 2 * np.pi, size=waves)

    def field(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        total = np.zeros(len(points), np.float32)
        for centre, rate, phase in zip(centres, frequencies, phases, strict=True):
            total += np.sin(2 * np.pi * rate * np.linalg.norm(points - centre, axis=-1) + phase)
        return total * np.float32(1.6 / np.sqrt(waves))

    return field


def creases(noise: Field, width: float) -> Field:
    """1 along the zero set of the noise, falling to 0 over `width` of its values: winding narrow furrows."""
    return lambda points: np.exp(-np.square(noise(points) / width))


def winding_folds(noise: Field, count: float) -> Field:
    """0..1 in `count` rounds per unit of the noise: ridges and furrows side by side, as on a brain."""
    return lambda points: 0.5 + 0.5 * np.cos(2 * np.pi * count * noise(points))


def surface_of(field: Field, rng: np.random.Generator, target: int, radius: float) -> RawMesh:
    """Marching-cubes surface of the solid inside a ball of `radius` with about `target` vertices.

    The grid is turned at random against the solid and has cells of random proportions, so that its direction
    says nothing about the shape. Marching cubes puts one vertex on every grid edge that changes sign: counting
    them on a coarser grid gives the cell size. Crumbs with under 3 % of the faces are dropped.
    """
    rotation = random_rotation(rng) if rng.random() < 0.8 else np.eye(3)
    turned = placed(field, rotation.T)
    cells = rng.uniform(0.75, 1.3, size=3)
    lower, upper = _extent(turned, radius)
    step = float(np.max((upper - lower) / cells)) / 26.0
    for _ in range(2):
        crossings = _crossings(_sample(turned, lower, upper, step * cells)[0])
        step *= float(np.clip(np.sqrt(crossings / target), 0.3, 2.0))
    values, origin = _sample(turned, lower, upper, step * cells)
    vertices, faces, _, _ = marching_cubes(values, 0.0)
    return largest_parts(RawMesh((vertices * (step * cells) + origin) @ rotation.T, faces.astype(np.int64)), 0.03)


def _extent(field: Field, radius: float) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Box around every coarse cell that the surface may cross, told by |distance| < cell diagonal."""
    step = 2.0 * radius / 25
    values, origin = _sample(field, np.full(3, -radius), np.full(3, radius), np.full(3, step))
    near = np.argwhere(values < step)
    return origin + (near.min(axis=0) - 1) * step, origin + (near.max(axis=0) + 1) * step


def _sample(
    field: Field, lower: Float[np.ndarray, "3"], upper: Float[np.ndarray, "3"], step: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "x y z"], Float[np.ndarray, "3"]]:
    """Values on a grid over the box, and its origin; the outermost layer is outside by decree."""
    counts = np.ceil((upper - lower) / step).astype(int) + 3
    origin = 0.5 * (lower + upper - (counts - 1) * step)
    axes = [
        (start + size * np.arange(n)).astype(np.float32) for start, size, n in zip(origin, step, counts, strict=True)
    ]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    values = field(points).reshape(counts).astype(np.float32)
    values[values == 0.0] = 1e-7  # a vertex exactly on a grid point would give triangles without area
    for axis in range(3):
        end = np.moveaxis(values, axis, 0)
        end[0], end[-1] = np.maximum(np.abs(end[0]), 1e-4), np.maximum(np.abs(end[-1]), 1e-4)
    return values, origin


def _crossings(values: Float[np.ndarray, "x y z"]) -> int:
    inside = values < 0
    return max(8, sum(int((np.diff(inside, axis=axis)).sum()) for axis in range(3)))
