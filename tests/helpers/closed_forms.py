"""Scenes whose transfer is a formula.

Every formula is that of the *ideal* scene (an endless groove, a round opening). What separates a mesh from its ideal,
truncation, facets and the lift of the ray origins, is computed from the mesh itself: all occluders here are polygons,
convex bodies, or convex bodies with one opening, so that the value of the mesh is a boundary integral over the sky.

Probes that no surface carries are corners of a face of no area, (i, i, i), which no ray can hit.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gash_jax.geometry.mesh import Mesh, concatenate, face_areas, face_normals
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.shapes.primitives import box, grid, icosphere, patch, spherical_bowl, v_groove
from tests.helpers.transfer_formulas import (
    Y00,
    cavity_ao,
    cone_transfer,
    convex_on_plane_ao,
    convex_transfer,
    disk_form_factor,
    free_transfer,
    groove_transfer,
    polygon_form_factor,
    polygon_transfer,
    rectangle_form_factor,
    rotation9,
    sphere_ao,
    sphere_transfer,
    wall_ao,
)

LIFT = 1.2e-5  # of half the bounding box's diagonal: how far along the normal a bake's rays start
UP = np.array([0.0, 0.0, 1.0])


class ClosedFormScene(NamedTuple):
    """A mesh, and the exact transfer of some of its vertices; all other vertices have normal 0 and are not baked."""

    name: str
    mesh: Mesh
    probes: np.ndarray  # (p,) vertex indices
    exact: np.ndarray  # (p, k) first k = 1, 4 or 9 coefficients of the ideal scene, float64
    tessellation: np.ndarray  # (p,) largest |of_mesh - exact| over a probe's coefficients
    of_mesh: np.ndarray  # (p, k) exact transfer of this very mesh, float64


def dust(points: np.ndarray, normals: np.ndarray) -> Mesh:
    """Vertices without a surface: faces of no area."""
    points, normals = np.broadcast_arrays(points, normals)
    faces = np.repeat(np.arange(len(points), dtype=np.int32)[:, None], 3, axis=1)
    return Mesh(points.astype(np.float32), normals.astype(np.float32), faces)


def lathe(radii: list[float], heights: list[float], segments: int) -> Mesh:
    """Rings about z, joined in order, each a polygon with the area of its circle; normals 0."""
    u, w, faces = grid(segments, len(radii) - 1)
    ring = np.round(w * (len(radii) - 1)).astype(int)
    angle = 2 * np.pi * (np.round(u * segments) % segments) / segments
    radius = np.array(radii)[ring] * np.sqrt(2 * np.pi / segments / np.sin(2 * np.pi / segments))
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.array(heights)[ring]], axis=1)
    return Mesh(vertices.astype(np.float32), np.zeros_like(vertices, np.float32), faces.astype(np.int32))


def flat_shaded(mesh: Mesh) -> Mesh:
    """Every face with corners of its own, whose normals are the face's."""
    vertices = mesh.vertices[mesh.faces].reshape(-1, 3)
    normals = np.repeat(face_normals(mesh.vertices, mesh.faces), 3, axis=0).astype(np.float32)
    return Mesh(vertices, normals, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))


def moved(mesh: Mesh, scale: float, shift: np.ndarray) -> Mesh:
    """Scaled about the origin, then shifted; normals kept."""
    return mesh._replace(vertices=(mesh.vertices.astype(np.float64) * scale + shift).astype(np.float32))


def make_scene(
    name: str,
    mesh: Mesh,
    probes: np.ndarray,
    exact: np.ndarray,
    value: Callable[[np.ndarray, np.ndarray], np.ndarray],
    rotation: np.ndarray | None = None,
) -> ClosedFormScene:
    """Keep the probes' normals alone, compute the tessellation's error, and turn everything by `rotation`.

    `exact` is (k,) or (p, k); `value(origins, normals)` gives at least k coefficients of the mesh as it is stored.
    """
    coefficients = exact.shape[-1]
    exact = np.broadcast_to(exact, (len(probes), coefficients))
    normals = mesh.normals[probes].astype(np.float64)
    origins = mesh.vertices[probes] + LIFT * NormalisedMesh(mesh).half_diagonal * normals
    poses, same = np.unique(np.concatenate([origins, normals], axis=1), axis=0, return_inverse=True)
    of_mesh = value(poses[:, :3], poses[:, 3:])[same.ravel(), :coefficients]
    tessellation = np.abs(of_mesh - exact).max(axis=1)
    kept = np.zeros_like(mesh.normals)
    kept[probes] = mesh.normals[probes]
    mesh = mesh._replace(normals=kept)
    if rotation is not None:
        turned = ((array @ rotation.T).astype(np.float32) for array in mesh[:2])
        mesh = Mesh(next(turned), next(turned), mesh.faces)
        d = rotation9(rotation)[:coefficients, :coefficients]
        exact, of_mesh, name = exact @ d.T, of_mesh @ d.T, name + " turned"
    return ClosedFormScene(name, mesh, probes, exact, tessellation, of_mesh)


def turned_by(seed: int) -> np.ndarray:
    """A rotation, random but always the same."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def side(count: int) -> int:
    """Resolution of a patch of at least `count` vertices."""
    return int(np.ceil(np.sqrt(count))) - 1


def first(count: int) -> np.ndarray:
    """Probes that come first in the mesh."""
    return np.arange(count)


def ao(values: np.ndarray | float) -> np.ndarray:
    """Ambient occlusion, one or (p,), as an array of the one coefficient t_0."""
    return Y00 * np.asarray(values, np.float64)[..., None]


def free_scene(mesh: Mesh, name: str, step: int) -> ClosedFormScene:
    """Item 8: a convex closed mesh alone, with the normals of its faces, is unshadowed (item 1)."""
    probes = np.arange(0, len(mesh.vertices), step)
    exact = free_transfer(mesh.normals[probes].astype(np.float64))
    return make_scene(name, mesh, probes, exact, lambda _, normals: free_transfer(normals))


def funnel_scene(degrees: float, count: int, segments: int, rotation: np.ndarray | None = None) -> ClosedFormScene:
    """Item 2: a funnel, its probes a tenth above the tip, its rim a circle around them."""
    a = np.radians(degrees)
    cone = lathe([0.0, np.sin(a)], [-0.1, np.cos(a)], segments)
    rim = cone.vertices[-segments:].astype(np.float64)
    mesh = concatenate([dust(np.zeros((count, 3)), UP), cone])
    return make_scene(
        f"funnel {degrees}", mesh, first(count), cone_transfer(a), lambda p, n: polygon_transfer(p, n, rim), rotation
    )


def pot_scene(degrees: float, count: int, segments: int) -> ClosedFormScene:
    """Item 2: under a round hole in the lid of a pot, on its floor."""
    hole = np.tan(np.radians(degrees))
    pot = lathe([0.0, hole + 1, hole + 1, hole], [0.0, 0.0, 1.0, 1.0], segments)
    rim = pot.vertices[-segments:].astype(np.float64)
    mesh = concatenate([dust(np.zeros((count, 3)), UP), pot])
    exact = cone_transfer(np.radians(degrees))
    return make_scene(f"pot {degrees}", mesh, first(count), exact, lambda p, n: polygon_transfer(p, n, rim))


def cavity_scene(degrees: float, count: int, resolution: int) -> ClosedFormScene:
    """Item 3: vertices all over the inside of a sphere with an opening, the pole and the rim among them."""
    bowl = spherical_bowl(np.radians(degrees), resolution)
    rim = bowl.vertices[-4 * resolution :].astype(np.float64)
    probes = np.round(np.linspace(0, len(bowl.vertices) - 1, count)).astype(int)
    exact = ao(cavity_ao(np.radians(degrees)))

    def value(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        opening = polygon_transfer(points, normals, rim)
        # lifted from the rim of a shallow bowl, a ray starts outside: what it does not see lies behind the opening
        outside = points[:, 1] > rim[0, 1]
        return np.where(outside[:, None], free_transfer(normals) - opening, opening)

    return make_scene(f"cavity {degrees}", bowl, probes, exact, value)


def groove_scene(degrees: float, count: int, rotation: np.ndarray | None = None) -> ClosedFormScene:
    """Item 5, all nine coefficients."""
    w = np.radians(degrees)
    mesh = v_groove(w, 1e4, side(count))
    face = mesh.vertices[-4:].astype(np.float64)[[0, 1, 3, 2]]
    value = lambda p, n: free_transfer(n) - polygon_transfer(p, n, face)  # noqa: E731
    return make_scene(f"groove {degrees}", mesh, first(count), groove_transfer(w), value, rotation)


def wall_scene(height: float, distance: float, count: int) -> ClosedFormScene:
    """Item 6: ground at `distance` to 2 * distance from a wall, 40 times as wide as it is far or high."""
    half = 20 * (height + distance)
    ground = patch(
        np.array([distance, -distance / 2, 0]), distance * np.eye(3)[0], distance * np.eye(3)[1], side(count)
    )
    front = patch(np.array([0, -half, 0]), np.array([0, 2 * half, 0]), np.array([0, 0, height]))
    mesh = concatenate([ground, front])
    face = front.vertices.astype(np.float64)[[0, 1, 3, 2]]
    value = lambda p, n: free_transfer(n) - polygon_transfer(p, n, face)  # noqa: E731
    exact = ao(wall_ao(height, ground.vertices[:count, 0].astype(np.float64)))
    return make_scene(f"wall {height} at {distance}", mesh, first(count), exact, value)


def corner_scene(count: int, rotation: np.ndarray | None = None) -> ClosedFormScene:
    """Item 6: where three square walls of side 1 meet. Probes on the floor, 1e-4 from both edges.

    What they see is the opening of the box: the outer edges of the three walls, a bent hexagon.
    """
    x, y, z = np.eye(3)
    walls = [patch(np.zeros(3), *sides) for sides in ((x, y), (y, z), (z, x))]
    rim = np.array([x, x + y, y, y + z, z, z + x])
    place = 1e-4 * (x + y)
    mesh = concatenate([dust(np.broadcast_to(place, (count, 3)), UP), *walls])
    return make_scene("corner", mesh, first(count), ao(0.25), lambda p, n: polygon_transfer(p, n, rim), rotation)


def sphere_scene(radius: float, distance: float, count: int, subdivisions: int, zonal: bool) -> ClosedFormScene:
    """Item 7: probes below a sphere; their normals straight up (nine coefficients), or leaning until it sets (AO)."""
    ball = icosphere(subdivisions)
    area = face_areas(ball.vertices, ball.faces).sum()
    ball = moved(ball, radius * np.sqrt(4 * np.pi / area), distance * UP)
    lean = np.zeros(count) if zonal else np.linspace(0, np.pi / 2 - np.arcsin(1.01 * radius / distance), count)
    azimuth = 2.4 * np.arange(count)
    normals = np.stack([np.sin(lean) * np.cos(azimuth), np.sin(lean) * np.sin(azimuth), np.cos(lean)], axis=1)
    mesh = concatenate([dust(np.zeros((count, 3)), normals), ball])
    exact = sphere_transfer(radius, distance) if zonal else ao(sphere_ao(radius, distance, lean))
    name = f"sphere {radius} at {distance}" + (" above" if zonal else " all around")
    return make_scene(name, mesh, first(count), exact, lambda p, n: free_transfer(n) - convex_transfer(p, n, ball))


def convex_on_plane_scene(step: int, subdivisions: int, rotation: np.ndarray | None = None) -> ClosedFormScene:
    """Item 8: a faceted ball of radius 1 whose lowest point is 1 above a plane of side 20000."""
    ball = flat_shaded(moved(icosphere(subdivisions), 1.0, 2 * UP))
    ground = patch(np.array([-1e4, -1e4, 0]), np.array([2e4, 0, 0]), np.array([0, 2e4, 0]))
    face = ground.vertices.astype(np.float64)[[0, 1, 3, 2]]
    probes = np.arange(0, len(ball.vertices), step)
    exact = ao(convex_on_plane_ao(ball.normals[probes].astype(np.float64), UP))
    value = lambda p, n: free_transfer(n) - polygon_transfer(p, n, face)  # noqa: E731
    return make_scene("convex on plane", concatenate([ball, ground]), probes, exact, value, rotation)


def disk_scene(radius: float, height: float, count: int, segments: int) -> ClosedFormScene:
    """Item 9 and, taken from the free vertex, item 2: below a disk."""
    lid = lathe([0.0, radius], [height, height], segments)
    rim = lid.vertices[-segments:].astype(np.float64)
    mesh = concatenate([dust(np.zeros((count, 3)), UP), lid])
    exact = ao(1 - disk_form_factor(radius, height))
    value = lambda p, n: free_transfer(n) - polygon_transfer(p, n, rim)  # noqa: E731
    return make_scene(f"disk {radius} at {height}", mesh, first(count), exact, value)


def rectangle_scene(a: float, b: float, height: float, count: int) -> ClosedFormScene:
    """Item 9: below the corner of a rectangle."""
    lid = patch(np.array([0, 0, height]), np.array([a, 0, 0]), np.array([0, b, 0]))
    corners = lid.vertices.astype(np.float64)[[0, 1, 3, 2]]
    mesh = concatenate([dust(np.zeros((count, 3)), UP), lid])
    exact = ao(1 - rectangle_form_factor(a, b, height))
    value = lambda p, n: free_transfer(n) - polygon_transfer(p, n, corners)  # noqa: E731
    return make_scene(f"rectangle {a} x {b} at {height}", mesh, first(count), exact, value)


def polygon_scene(corners: np.ndarray, name: str, count: int) -> ClosedFormScene:
    """Item 9: a square of ground of side 2 below a polygon, a fan around the mean of its corners."""
    ground = patch(np.array([-1.0, -1, 0]), np.array([2.0, 0, 0]), np.array([0, 2.0, 0]), side(count))
    points = np.concatenate([corners.mean(axis=0)[None], corners]).astype(np.float32)
    ring = 1 + np.arange(len(corners))
    fan = np.stack([np.zeros_like(ring), ring, np.roll(ring, -1)], axis=1).astype(np.int32)
    mesh = concatenate([ground, Mesh(points, np.zeros_like(points), fan)])
    probes, rim = first(count), points[1:].astype(np.float64)
    below, up = (array[:count].astype(np.float64) for array in ground[:2])
    exact = ao(1 - polygon_form_factor(below, up, rim))
    return make_scene(name, mesh, probes, exact, lambda p, n: free_transfer(n) - polygon_transfer(p, n, rim))


def star(points: int, inner: float, center: np.ndarray, tilt: float) -> np.ndarray:
    """Corners of a plane star around a centre, turned by `tilt` about x; a regular polygon where inner = 1."""
    angle = np.pi * np.arange(2 * points) / points
    radius = np.where(np.arange(2 * points) % 2, inner, 1.0)
    x, y = radius * np.cos(angle), radius * np.sin(angle)
    return center + np.stack([x, y * np.cos(tilt), y * np.sin(tilt)], axis=1)


def closed_form_scenes(coarse: bool = False) -> list[ClosedFormScene]:
    """All scenes; `coarse` has 8 probes and few facets, for a backend that tries every ray on every face."""
    count, segments, body, ball, bowl = (8, 24, 0, 1, 6) if coarse else (36, 96, 1, 5, 80)
    quad = np.array([[-0.7, -0.4, 0.6], [0.9, -0.5, 0.8], [1.1, 0.8, 1.5], [-0.5, 0.9, 1.3]])  # a parallelogram
    free = flat_shaded(icosphere(body)), flat_shaded(box((1.0, 2.0, 3.0)))
    steps = [-(-len(mesh.vertices) // (8 if coarse else 60)) for mesh in free]
    return [
        free_scene(free[0], "convex alone", steps[0]),
        free_scene(free[1], "box alone", steps[1]),
        *(funnel_scene(a, count, segments) for a in (20, 45, 75)),
        funnel_scene(60, count, segments, turned_by(1)),
        *(pot_scene(a, count, segments) for a in (30, 65)),
        *(cavity_scene(a, count, bowl) for a in (40, 85, 130)),
        *(groove_scene(w, count) for w in (40, 75, 90, 140)),
        *(groove_scene(w, count, turned_by(w)) for w in (60, 110)),
        *(wall_scene(h, d, count) for h, d in ((1.5, 1.0), (1.0, 3.0))),
        corner_scene(count),
        corner_scene(count, turned_by(3)),
        *(sphere_scene(r, d, count, ball, True) for r, d in ((0.5, 1.0), (1.0, 1.2))),
        *(sphere_scene(r, d, count, ball, False) for r, d in ((0.5, 1.5), (1.0, 1.2), (0.3, 2.0))),
        convex_on_plane_scene(steps[0], body),
        convex_on_plane_scene(steps[0], body, turned_by(2)),
        *(disk_scene(r, h, count, segments) for r, h in ((1.0, 1.0), (0.4, 1.0))),
        *(rectangle_scene(a, b, h, count) for a, b, h in ((1.0, 2.0, 1.0), (3.0, 0.5, 0.7))),
        polygon_scene(quad, "tilted quad", count),
        polygon_scene(star(5, 0.5, np.array([0.2, -0.1, 0.9]), 0.5), "star", count),
    ]
