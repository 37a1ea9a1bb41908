"""Where rays start, and the two questions that every backend answers: does a ray meet anything, and what first.

Rays are traced in *trace space*: the mesh moved to the centre of its bounding box and scaled so that half the
box's diagonal is 1, computed in float64 and rounded once. Scales from 1e-6 to 1e6 and meshes far from the origin
then look the same to a float32 ray tracer.

Origins are lifted along the vertex normal. Too little and a surface shadows itself through rounding; too much and
crevices are skipped. All vertices are lifted by `ray_offset`, the larger of `MIN_OFFSET` (about 100 float32 spacings
of a coordinate of size 1) and four spacings of the coordinates *in the file*, which bounds the staircase that
rounding has put into a mesh stored far from the origin.

Vertices of slivers (long thin faces) are lifted further, by `sliver_lifts`. Whether a ray starts above a face or below
is decided by the sign of N.(corner - origin), N = a x b the cross product of two edges of the face. From a height d
above one of its corners that product is 2 A d, A the area of the face. But float32 rounds component i of N by up to u
(|a_j b_k| + |a_k b_j|), u = 2^-24, and so the product by up to the sum over i of that times the face's extent e_i. As
long as 2 A d is smaller than this error the sign may be wrong, and the ray meets the face that it starts on. The lift
is twice the height at which they are equal, for the worst pair of edges of the worst face at a vertex: at most about
u length³ / A. It is more than `MIN_OFFSET` from slivers of 1 : 1000 or so on, but next to nothing for faces in the
planes of the axes, whose N has one component. Measured on convex bodies of random slivers: without it 1 ray of 100 is
lost at 1 : 1e4 and 1 of 12 at 1 : 1e5, with it 2 of 1e5; of flat sheets none.

Points that are no vertices of the mesh are lifted along their normals by as much as the vertex nearest to them.

A lift ends at `MAX_LIFT`. With 3e-4 bodies of 1 : 1e6 lose 4 rays of 1e4 again; twice as much gains little, and lifts a
lone sliver between good faces, which needs no lift, out of its crevices. Faces without area (as the health report
counts them) lift nothing: their N is nothing but rounding.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.geometry.health import DEGENERATE_AREA
from gash_jax.geometry.mesh import Mesh, face_areas
from gash_jax.geometry.normalised import NormalisedMesh

MIN_OFFSET = 1.2e-5
MAX_LIFT = 1e-3
ROUNDING = 2.0**-24  # of float32, relative
FACES_AT_ONCE = 1 << 14


class Hits(NamedTuple):
    """What rays meet first: face -1 where nothing; barycentric weights u, v of the face's second and third corner.

    `distance` counts in lengths of the direction; where nothing is met it is beyond 1e36.
    """

    face: Int[np.ndarray, "*r"]
    u: Float[np.ndarray, "*r"]
    v: Float[np.ndarray, "*r"]
    distance: Float[np.ndarray, "*r"]


# (origins "r 3", directions "r 3") -> answer of every ray; directions need not be unit vectors
VisibilityFn = Callable[[Float[np.ndarray, "r 3"], Float[np.ndarray, "r 3"]], Bool[np.ndarray, "r"]]  # True: free
ClosestHitFn = Callable[[Float[np.ndarray, "r 3"], Float[np.ndarray, "r 3"]], Hits]
RayQuery = VisibilityFn | ClosestHitFn


class TraceGeometry(NamedTuple):
    """A mesh in trace space, with the origin of every vertex's rays, those of the points beside it that were asked for,
    and the least lift, that of all but slivers."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    origins: Float[np.ndarray, "o 3"]
    offset: float


def ray_offset(largest: float, scale: float) -> float:
    """Distance, in trace space, between a vertex of no sliver and the origin of its rays.

    `largest` is the greatest coordinate of a face in the file, `scale` what is 1 in trace space.
    """
    return max(MIN_OFFSET, 4.0 * float(np.spacing(np.float32(largest))) / scale)


def _thin_faces(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "t"]:
    """Faces that may lift a corner by half of `MIN_OFFSET` or more, and few others; coordinates are in [-1, 1].

    The float32 rounding of a product is at most 12 ROUNDING size^3 (module docstring), size the longest side of the
    face's box. One contiguous array a coordinate, in blocks that stay in the cache: the whole is a tenth of what
    the exact lifts of all faces would take.
    """
    points, corners, found = np.ascontiguousarray(vertices.T), np.ascontiguousarray(faces.T), []
    for start in range(0, len(faces), FACES_AT_ONCE):
        first, second, third = (points[:, corner[start : start + FACES_AT_ONCE]] for corner in corners)
        a, b = second - first, third - first
        size = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.abs(a - b)).max(axis=0)
        normal = [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]
        area = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2) / 2
        # a quarter for what float32 does to the area itself
        found.append(start + np.flatnonzero(6 * ROUNDING * size**3 > MIN_OFFSET / 4 * area))
    return np.concatenate(found) if found else np.zeros(0, np.int64)


def sliver_lifts(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "v"]:
    """Least lift, in trace space, that keeps a vertex clear of what float32 makes of its thinnest face.

    Zero where it is below half of `MIN_OFFSET`, by which all vertices are lifted.
    """
    thin = _thin_faces(vertices, faces)
    area, corners = face_areas(vertices, faces[thin]), vertices[faces[thin]].astype(np.float64)
    kept = area > DEGENERATE_AREA * 2**2
    thin, area, corners = thin[kept], area[kept], corners[kept]
    a = np.abs(np.roll(corners, -1, axis=1) - corners)  # (f, edge, 3)
    b = np.roll(a, -1, axis=1)
    products = np.roll(a, -1, axis=2) * np.roll(b, -2, axis=2) + np.roll(a, -2, axis=2) * np.roll(b, -1, axis=2)
    error = 2 * ROUNDING * np.einsum("fi,fi->f", products.max(axis=1), a.max(axis=1))
    height = np.minimum(error / (2 * area), MAX_LIFT)
    lifts = np.zeros(len(vertices))
    np.maximum.at(lifts, faces[thin].ravel(), np.repeat(height, 3))
    return lifts


def trace_geometry(mesh: Mesh, points: Mesh | None = None) -> TraceGeometry:
    """Move a mesh to trace space and lift the ray origins off its surface: those of its vertices, then of `points`.

    Isolated vertices may lie anywhere, so they are moved to the centre: no ray of theirs is ever asked for,
    and a coordinate of 1e30 must not reach the tracer's bounding boxes.
    """
    shape = NormalisedMesh(mesh)
    vertices = shape.positions(shape.half_diagonal)
    vertices[~shape.referenced] = 0.0
    rounded = vertices.astype(np.float32)
    offset = ray_offset(float(np.abs(shape.box).max()), shape.half_diagonal)
    lifts = np.maximum(offset, sliver_lifts(rounded, mesh.faces))
    origins = vertices + lifts[:, None] * mesh.normals.astype(np.float64)
    if points is not None:
        places = (points.vertices.astype(np.float64) - shape.center) / shape.half_diagonal
        heights = np.full(len(places), offset)
        if lifts.max() > offset:
            from scipy.spatial import KDTree  # slow to import, and most bakes have no points

            heights = lifts[KDTree(vertices).query(places)[1]]
        origins = np.concatenate([origins, places + heights[:, None] * points.normals.astype(np.float64)])
    return TraceGeometry(rounded, mesh.faces, origins.astype(np.float32), offset)
