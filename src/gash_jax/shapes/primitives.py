"""Procedural meshes with known visibility, for tests and closed forms. Right-handed, +y up, faces outward CCW.

Where a closed form holds at some vertices only, these come first: meshes named *scene* below begin with a patch of
(resolution + 1)² *probe* vertices, row by row, and the occluders follow, as coarse as they may be and exact: a quad
is a wall. Normals are exact on spheres, tori and planes, angle-weighted on the bumpy sphere.
"""

import numpy as np
from jaxtyping import Float, Int

from gash_jax.geometry.mesh import Mesh, angle_weighted_normals, concatenate, face_areas, normalized


def plane(size: float, resolution: int) -> Mesh:
    """A square of side `size` in y = 0 around the origin, facing up: (resolution + 1)² vertices."""
    corner = np.array([-size / 2, 0.0, -size / 2])
    return patch(corner, np.array([0.0, 0.0, size]), np.array([size, 0.0, 0.0]), resolution)


def patch(
    corner: Float[np.ndarray, "3"], right: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"], resolution: int = 1
) -> Mesh:
    """A parallelogram from `corner` along `right` and `up`, facing right x up: (resolution + 1)² vertices."""
    u, w, faces = grid(resolution, resolution)
    vertices = corner + u[:, None] * right + w[:, None] * up
    normals = np.broadcast_to(normalized(np.cross(right, up)[None]), vertices.shape)
    return _mesh(vertices, normals, faces)


def grid(columns: int, rows: int) -> tuple[Float[np.ndarray, "v"], Float[np.ndarray, "v"], Int[np.ndarray, "f 3"]]:
    """Parameters u, w in [0, 1] of (columns + 1)(rows + 1) vertices, u fastest, and their faces, CCW in (u, w)."""
    w, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    low = np.stack([first, first + 1, first + columns + 2], axis=1)
    high = np.stack([first, first + columns + 2, first + columns + 1], axis=1)
    return u.ravel(), w.ravel(), np.stack([low, high], axis=1).reshape(-1, 3)


def box(size: tuple[float, float, float] = (1.0, 1.0, 1.0), resolution: int = 1) -> Mesh:
    """A box around the origin; each side has vertices of its own, so that vertex normals are face normals."""
    extent, sides = np.array(size), []
    for axis in range(3):
        for sign in (1.0, -1.0):
            out, right, up = np.roll(np.eye(3), -axis, axis=0)
            right, up = (right, up) if sign > 0 else (up, right)
            corner = (sign * out - right - up) * extent / 2
            sides.append(patch(corner, right * extent, up * extent, resolution))
    return concatenate(sides)


def icosphere(subdivisions: int) -> Mesh:
    """The unit sphere from an icosahedron, each edge in 2^subdivisions parts: 10 * 4^subdivisions + 2 vertices."""
    points, faces = _geodesic(2**subdivisions)
    return _mesh(points, points, faces)


def uv_sphere(rings: int, segments: int) -> Mesh:
    """The unit sphere by latitude and longitude: vertex 0 is the pole +y, then rings - 1 circles, the pole -y last."""
    polar = np.pi * np.arange(1, rings) / rings
    points, faces = _cap(polar, segments)
    south, last = len(points), len(points) - segments + np.arange(segments)
    close = np.stack([last, np.full(segments, south), np.roll(last, -1)], axis=1)
    points = np.concatenate([points, [[0.0, -1.0, 0.0]]])
    return _mesh(points, points, np.concatenate([faces, close]))


def torus(major: float = 1.0, minor: float = 0.4, segments: int = 48, rings: int = 24) -> Mesh:
    """A torus around the y axis: circle of radius `major`, tube of radius `minor`; rings * segments vertices."""
    u, w = np.meshgrid(np.arange(segments) / segments, np.arange(rings) / rings, indexing="ij")
    around, along = 2 * np.pi * w.ravel(), 2 * np.pi * u.ravel()
    axis = np.stack([np.cos(along), np.zeros_like(along), -np.sin(along)], axis=1)
    normals = np.cos(around)[:, None] * axis + np.sin(around)[:, None] * [0.0, 1.0, 0.0]
    i, j = np.meshgrid(np.arange(segments), np.arange(rings), indexing="ij")
    a, b = i * rings + j, (i + 1) % segments * rings + j
    c, d = (i + 1) % segments * rings + (j + 1) % rings, i * rings + (j + 1) % rings
    faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return _mesh(major * axis + minor * normals, normals, faces)


def bumpy_sphere(resolution: int, amplitude: float = 0.48, frequency: float = 8.0) -> Mesh:
    """A sphere with smooth bumps, r = 1 + amplitude mean(sin(frequency (x, y, z))): 10 resolution² + 2 vertices.

    With the default bumps about 18 % of the cosine-weighted hemisphere is occluded on the average.
    """
    points, faces = _geodesic(resolution)
    vertices = points * (1 + amplitude * np.sin(frequency * points).mean(axis=1, keepdims=True))
    return _mesh(vertices, angle_weighted_normals(vertices, faces), faces)


def spherical_bowl(opening_half_angle: float, resolution: int) -> Mesh:
    """The inside of a unit sphere with a circular opening of the given half-angle (radians) around +y.

    Normals point inward. Ambient occlusion is (1 - cos a)/2 at every vertex (the polygonal rim of 4 * resolution
    corners makes the opening smaller by the factor sin(s)/s, s = pi/(2 resolution)).
    """
    polar = (np.pi - opening_half_angle) * np.arange(1, resolution + 1) / resolution
    points, faces = _cap(polar, 4 * resolution)
    return _mesh(-points, points, faces)  # the point reflection turns the faces inward


def v_groove(opening_angle: float, length: float = 400.0, resolution: int = 8) -> Mesh:
    """Scene: a groove along y with the given opening w (radians), seen from its face in the xy plane with n = z.

    Probes at x in [0.5, 1], |y| <= 0.25; the other face is one quad from the edge x = z = 0 to `length` at angle w
    from +x, and 2 * length along y. Ambient occlusion at the probes is sin²(w/2) of the endless groove plus at most
    (sin² w / 2 + 0.07) x / length.
    """
    face = patch(np.array([0.5, -0.25, 0.0]), np.array([0.5, 0.0, 0.0]), np.array([0.0, 0.5, 0.0]), resolution)
    up = length * np.array([np.cos(opening_angle), 0.0, np.sin(opening_angle)])
    other = patch(np.array([0.0, -length, 0.0]), up, np.array([0.0, 2 * length, 0.0]))
    return concatenate([face, other])


def two_plates(distance: float, size: float, resolution: int = 8) -> Mesh:
    """Scene: a square of probes in y = 0 facing up, and one quad of the same size at y = distance facing down.

    Ambient occlusion at a probe is 1 minus the form factors of the four rectangles above it that meet over it.
    """
    half = size / 2
    lid = patch(np.array([-half, distance, -half]), np.array([size, 0.0, 0.0]), np.array([0.0, 0.0, size]))
    return concatenate([plane(size, resolution), lid])


def sphere_above_plane(radius: float, distance: float, resolution: int = 8, subdivisions: int = 4) -> Mesh:
    """Scene: probes on a square of side `radius` in y = 0, and a sphere around (0, distance, 0).

    With D the distance of a probe from the centre, ambient occlusion is 1 - (distance/D) (radius/D)². The sphere is
    faceted; its vertices lie a little outside, so that its surface, and with it its mean shadow, is that of the sphere.
    """
    ball = icosphere(subdivisions)
    grown = radius * np.sqrt(4 * np.pi / face_areas(ball.vertices, ball.faces).sum())
    vertices = grown * ball.vertices.astype(np.float64) + [0.0, distance, 0.0]
    return concatenate([plane(radius, resolution), _mesh(vertices, ball.normals, ball.faces)])


def wall(height: float, distance: float, resolution: int = 8) -> Mesh:
    """Scene: probes in y = 0 facing up, x in [0, distance], and a wall at x = -distance, 100 times as wide as needed.

    With d = distance + x, ambient occlusion of the endless wall is 1 - (1 - 1/sqrt(1 + (height/d)²))/2; the ends of
    this one leave out less than 1e-6.
    """
    strip = np.array([distance, 0.0, 0.0])
    ground = patch(np.array([0.0, 0.0, -distance / 2]), np.array([0.0, 0.0, distance]), strip, resolution)
    half = 50 * (height + distance)
    front = patch(np.array([-distance, 0.0, half]), np.array([0.0, 0.0, -2 * half]), np.array([0.0, height, 0.0]))
    return concatenate([ground, front])


def _geodesic(frequency: int) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """Icosahedron with every face cut into frequency² triangles, on the unit sphere."""
    golden = (1 + np.sqrt(5)) / 2
    corners = [[0, s, t * golden] for s in (-1, 1) for t in (-1, 1)]
    corners = normalized(np.array([np.roll(c, shift) for shift in range(3) for c in corners]))
    near = corners @ corners.T > 0.4  # the five neighbours of a corner, and itself
    triples = np.argwhere(near[:, :, None] & near[:, None, :] & near[None])
    a, b, c = np.moveaxis(corners[triples], 1, 0)
    outward = np.einsum("fi,fi->f", np.cross(a, b), c) > 0.1
    triples = triples[outward & (triples[:, 0] == triples.min(axis=1))]
    i, j = np.divmod(np.arange((frequency + 1) ** 2), frequency + 1)
    inside = i + j <= frequency
    number = np.full((frequency + 2, frequency + 2), -1)
    number[i[inside], j[inside]] = np.arange(inside.sum())
    weights = np.stack([frequency - i - j, i, j], axis=1)[inside] / frequency
    at = np.stack([i, j], axis=1)[i + j < frequency]
    up = [number[tuple((at + d).T)] for d in ([0, 0], [1, 0], [0, 1])]
    down = [number[tuple((at + d).T)] for d in ([1, 0], [1, 1], [0, 1])]
    small = np.concatenate([np.stack(up, axis=1), np.stack(down, axis=1)])
    small = small[(small >= 0).all(axis=1)]
    points = np.einsum("wc,fci->fwi", weights, corners[triples]).reshape(-1, 3)
    faces = (small + len(weights) * np.arange(20)[:, None, None]).reshape(-1, 3)
    _, first, inverse = np.unique(np.round(points, 9) + 0.0, axis=0, return_index=True, return_inverse=True)
    return normalized(points[first]), inverse.ravel()[faces]


def _cap(polar: Float[np.ndarray, "n"], segments: int) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """The unit sphere from its pole at +y (vertex 0) down to the last of the polar angles, one circle for each."""
    azimuth = 2 * np.pi * np.arange(segments) / segments
    sine = np.sin(polar)[:, None]
    height = np.broadcast_to(np.cos(polar)[:, None], (len(polar), segments))
    circles = np.stack([sine * np.cos(azimuth), height, -sine * np.sin(azimuth)], axis=-1)
    ring = 1 + np.arange(len(polar) * segments).reshape(len(polar), segments)
    ahead = np.roll(ring, -1, axis=1)
    top = np.stack([np.zeros(segments, dtype=np.int64), ring[0], ahead[0]], axis=1)
    a, b, c, d = ring[:-1], ring[1:], ahead[1:], ahead[:-1]
    sides = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    return np.concatenate([[[0.0, 1.0, 0.0]], circles.reshape(-1, 3)]), np.concatenate([top, sides])


def _mesh(vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> Mesh:
    return Mesh(vertices.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32))
