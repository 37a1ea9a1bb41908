"""Where rays start, and the two questions that every backend answers: does a ray meet anything, and what first.

Rays are traced in *trace space*: the mesh moved to the centre of its bounding box and scaled so that half the
box's diagonal is 1, computed in float64 and rounded once. Scales from 1e-6 to 1e6 and meshes far from the origin
then look the same to a float32 ray tracer.

Origins are lifted along the vertex normal. Too little and a surface shadows itself through rounding; too much and
crevices are skipped. All vertices are lifted by `ray_offset`, the larger of `MIN_OFFSET` (about 100 float32 spacings
of a coordinate of size 1) and four spacings of the coordinates *in the file*, which bounds the staircase that
rounding has put into a mesh stored far from the origin.

Vertices of slivers are lifted further, by `sliver_lifts`. A ray that starts at height d over a face of area A, at
one of its corners, meets the face or not by the sign of N·(corner - origin) = 2 A d, where float32 rounds
N = a x b, a cross product of two edges, by up to u (|a_j b_k| + |a_k b_j|) in component i, u = 2^-24. Over the
extents e_i of the face the sum of e_i times that bound, divided by 2 A, is the height up to which the sign may be
wrong. Twice that, for the worst two edges, is the lift: a height of about u length³ / A at most, and next to 0 for
faces along the axes, whose N is rounded in no other direction. It exceeds `MIN_OFFSET` from slivers of 1 : 1000 or
so on. Without it convex bodies of random slivers lose 1 ray of 100 at 1 : 1e4 and 1 of 12 at 1 : 1e5, with it 2 of
1e5, and flat sheets none. It ends at `MAX_LIFT`: at 3e-4, bodies of 1 : 1e6 lose 4 rays of 1e4 again, and twice as
high gains little while a lone sliver between good faces, which needs no lift, is lifted off its crevices. Faces
without area (as the health report counts them) lift nothing: their N is rounding, of any length.
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
    """A mesh in trace space, with the origin of every vertex's rays and the least lift, that of all but slivers."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    origins: Float[np.ndarray, "v 3"]
    offset: float


def ray_offset(largest: float, scale: float) -> float:
    """Distance, in trace space, between a vertex of no sliver and the origin of its rays.

    `largest` is the greatest coordinate of a face in the file, `scale` what is 1 in trace space.
    """
    return max(MIN_OFFSET, 4.0 * float(np.spacing(np.float32(largest))) / scale)


def sliver_lifts(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "v"]:
    """Least lift, in trace space, that keeps a vertex clear of what float32 makes of its thinnest face.

    Zero where it is below a thousandth of `MIN_OFFSET`.
    """
    corners, area = vertices[faces], face_areas(vertices, faces)
    size = np.ptp(corners, axis=1).max(axis=1)
    # the error below is at most 12 ROUNDING size^3: most faces are far from a lift that counts; the diagonal is 2
    thin = (6 * ROUNDING * size**3 > 1e-3 * MIN_OFFSET * area) & (area > DEGENERATE_AREA * 2**2)
    corners = corners[thin].astype(np.float64)
    a = np.abs(np.roll(corners, -1, axis=1) - corners)  # (f, edge, 3)
    b = np.roll(a, -1, axis=1)
    products = np.roll(a, -1, axis=2) * np.roll(b, -2, axis=2) + np.roll(a, -2, axis=2) * np.roll(b, -1, axis=2)
    error = 2 * ROUNDING * np.einsum("fi,fi->f", products.max(axis=1), a.max(axis=1))
    height = np.minimum(error / (2 * area[thin]), MAX_LIFT)
    lifts = np.zeros(len(vertices))
    np.maximum.at(lifts, faces[thin].ravel(), np.repeat(height, 3))
    return lifts


def trace_geometry(mesh: Mesh) -> TraceGeometry:
    """Move a mesh to trace space and lift the ray origins off its surface.

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
    return TraceGeometry(rounded, mesh.faces, origins.astype(np.float32), offset)
