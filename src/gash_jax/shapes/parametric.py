"""Parametric surfaces: grids swept in space, spheres under a map, tubes, surfaces of revolution, sheets.

Notation: a grid is an array of points (r, c, 3); rows run along the body, columns around it. Both directions may
wrap; an open end of the rows may be closed by a pole vertex. With rows along +y and columns from +z to +x (seen
from above: counter-clockwise) the faces look outward.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, Delaunay

from gash_jax.geometry.mesh import RawMesh


def swept(
    grid: Float[np.ndarray, "r c 3"],
    rng: np.random.Generator,
    wrap_rows: bool = False,
    wrap_columns: bool = True,
    poles: tuple[Float[np.ndarray, "3"] | None, Float[np.ndarray, "3"] | None] = (None, None),
) -> RawMesh:
    """Triangulate a grid; diagonals all one way, alternating or at random."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    if wrap_rows:
        index = np.concatenate([index, index[:1]])
    if wrap_columns:
        index = np.concatenate([index, index[:, :1]], axis=1)
    a, b = index[:-1, :-1].ravel(), index[:-1, 1:].ravel()
    d, c = index[1:, :-1].ravel(), index[1:, 1:].ravel()
    share = rng.choice([0.0, 0.5, 1.0])
    first = (rng.random(len(a)) < share)[:, None]
    faces = [
        np.where(first, np.stack([a, b, c], -1), np.stack([a, b, d], -1)),
        np.where(first, np.stack([a, c, d], -1), np.stack([b, c, d], -1)),
    ]
    vertices = [grid.reshape(-1, 3)]
    for pole, row, back in zip(poles, (index[0], index[-1]), (True, False), strict=True):
        if pole is None:
            continue
        tip = np.full(len(row) - 1, sum(map(len, vertices)))
        vertices.append(np.asarray(pole)[None])
        ends = (row[1:], row[:-1]) if back else (row[:-1], row[1:])
        faces.append(np.stack([tip, *ends], -1))
    return RawMesh(np.concatenate(vertices).astype(np.float64), np.concatenate(faces).astype(np.int64))


def spacing(rng: np.random.Generator, count: int, closed: bool = False) -> Float[np.ndarray, "n"]:
    """Increasing parameters in 0..1, even or graded at random; closed: without the end point."""
    even = np.arange(count) / (count if closed else count - 1)
    wave = rng.uniform(0.0, 0.8) * rng.integers(0, 2)
    return even + wave * (np.sin(2 * np.pi * even + (phase := rng.uniform(0, 6.28))) - np.sin(phase)) / (2 * np.pi)


def grid_shape(target: int, aspect: float) -> tuple[int, int]:
    """Rows and columns with rows * columns = target and rows / columns = aspect, as far as integers allow."""
    columns = max(6, round(np.sqrt(target / aspect)))
    return max(4, round(target / columns)), columns


def sphere_points(rng: np.random.Generator, target: int) -> RawMesh:
    """Triangulated unit sphere: Fibonacci, jittered, clustered, random or a latitude grid; convex, outward."""
    style = rng.integers(5)
    if style == 0:
        rows, columns = grid_shape(target, rng.uniform(0.4, 0.9))
        t = np.pi * spacing(rng, rows + 2)[1:-1, None]
        p = 2 * np.pi * spacing(rng, columns, closed=True)[None]
        ring = np.broadcast_arrays(np.sin(t) * np.sin(p), -np.cos(t), np.sin(t) * np.cos(p))
        return swept(np.stack(ring, -1), rng, poles=(np.array([0, -1.0, 0]), np.array([0, 1.0, 0])))
    i = np.arange(target) + 0.5
    z, p = 1 - 2 * i / target, i * np.pi * (3 - np.sqrt(5.0))
    points = np.stack([np.sqrt(1 - z * z) * np.cos(p), np.sqrt(1 - z * z) * np.sin(p), z], -1)
    if style >= 2:
        points = points + rng.normal(scale=rng.uniform(0.2, 0.9) / np.sqrt(target), size=points.shape)
    if style == 3:
        points = points + rng.uniform(0.2, 0.6) * (axis := rng.normal(size=3)) / np.linalg.norm(axis)
    if style == 4:
        points = rng.normal(size=(target, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    hull = ConvexHull(points)
    a, b, c = points[hull.simplices].transpose(1, 0, 2)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), a + b + c) < 0
    faces = np.where(inward[:, None], hull.simplices[:, ::-1], hull.simplices)
    return RawMesh(points, faces.astype(np.int64))


def tube(
    curve: Float[np.ndarray, "r 3"],
    radius: Float[np.ndarray, "r c"],
    reference: Float[np.ndarray, "r 3"],
    rng: np.random.Generator,
    closed: bool,
) -> RawMesh:
    """Surface around a curve; `radius` per row and column, `reference` vectors fix the zero angle.

    The reference is orthogonalised against the tangent, so it must never be parallel to it. Open tubes end in
    poles.
    """
    if closed:
        tangent = np.roll(curve, -1, axis=0) - np.roll(curve, 1, axis=0)
    else:
        tangent = np.gradient(curve, axis=0)
    tangent = _unit(tangent)
    across = _unit(reference - np.sum(reference * tangent, -1, keepdims=True) * tangent)
    third = np.cross(tangent, across)
    angle = 2 * np.pi * spacing(rng, radius.shape[1], closed=True)
    ring = np.cos(angle)[None, :, None] * across[:, None] + np.sin(angle)[None, :, None] * third[:, None]
    poles = (None, None) if closed else (curve[0], curve[-1])
    return swept(curve[:, None] + radius[..., None] * ring, rng, wrap_rows=closed, poles=poles)


def revolved(
    profile: Float[np.ndarray, "r 2"],
    columns: int,
    rng: np.random.Generator,
    ripple: Float[np.ndarray, "#r c"] | float = 1.0,
    closed_rows: bool = False,
    poles: tuple[bool, bool] = (False, False),
) -> RawMesh:
    """Surface of revolution about y of a profile of (radius, height); `ripple` scales the radius."""
    angle = 2 * np.pi * np.arange(columns) / columns
    radius = profile[:, :1] * ripple
    points = np.broadcast_arrays(radius * np.sin(angle), profile[:, 1:], radius * np.cos(angle))
    tips = [np.array([0.0, profile[row, 1], 0.0]) if pole else None for row, pole in zip((0, -1), poles, strict=True)]
    return swept(np.stack(points, -1), rng, wrap_rows=closed_rows, poles=(tips[0], tips[1]))


def flat_domain(rng: np.random.Generator, target: int, aspect: float = 1.0) -> RawMesh:
    """Triangulated rectangle of the plane z = 0 facing +z: a grid or Delaunay triangles of scattered points."""
    rows, columns = grid_shape(target, aspect)
    u, v = np.meshgrid(spacing(rng, rows), spacing(rng, columns), indexing="ij")
    if rng.random() < 0.5:
        return swept(np.stack([v, u, 0 * u], -1), rng, wrap_columns=False)
    inner = (u > 0) & (u < 1) & (v > 0) & (v < 1)
    spread = rng.uniform(0.1, 0.9)
    u = u + inner * rng.uniform(-0.5, 0.5, u.shape) * spread / rows
    v = v + inner * rng.uniform(-0.5, 0.5, v.shape) * spread / columns
    points = np.clip(np.stack([v.ravel(), u.ravel()], -1), 0.0, 1.0)
    return RawMesh(np.pad(points, ((0, 0), (0, 1))), facing_up(points, Delaunay(points).simplices))


def facing_up(points: Float[np.ndarray, "v 2"], faces: np.ndarray) -> np.ndarray:
    """Planar triangles turned counter-clockwise, those without area dropped."""
    a, b, c = points[faces].transpose(1, 0, 2)
    (x, y), (s, t) = (b - a).T, (c - a).T
    area = x * t - y * s
    kept = np.abs(area) > 1e-12
    return np.where(area[:, None] < 0, faces[:, ::-1], faces)[kept].astype(np.int64)


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
