"""Where rays start, and the one contract that every visibility backend answers.

Rays are traced in *trace space*: the mesh moved to the centre of its bounding box and scaled so that half the
box's diagonal is 1, computed in float64 and rounded once. Scales from 1e-6 to 1e6 and meshes far from the origin
then look the same to a float32 ray tracer.

Origins are lifted along the vertex normal by `ray_offset`. Too small and a surface shadows itself through
rounding; too large and crevices are skipped. The offset is the larger of `MIN_OFFSET` (about 100 float32 spacings
of a coordinate of size 1) and four spacings of the coordinates *in the file*, which bounds the staircase that
rounding has put into a mesh stored far from the origin.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.geometry.mesh import Mesh, center_and_scale

MIN_OFFSET = 1.2e-5

# (origins "r 3", directions "r 3") -> True where the ray meets nothing; directions need not be unit vectors
VisibilityFn = Callable[[Float[np.ndarray, "r 3"], Float[np.ndarray, "r 3"]], Bool[np.ndarray, "r"]]


class TraceGeometry(NamedTuple):
    """A mesh in trace space, with the origin of every vertex's rays."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    origins: Float[np.ndarray, "v 3"]
    offset: float


def ray_offset(mesh: Mesh, scale: float) -> float:
    """Distance, in trace space, between a vertex and the origin of its rays."""
    largest = float(np.abs(mesh.vertices[mesh.faces]).max())
    return max(MIN_OFFSET, 4.0 * float(np.spacing(np.float32(largest))) / scale)


def trace_geometry(mesh: Mesh) -> TraceGeometry:
    """Move a mesh to trace space and lift the ray origins off its surface.

    Isolated vertices may lie anywhere, so they are moved to the centre: no ray of theirs is ever asked for,
    and a coordinate of 1e30 must not reach the tracer's bounding boxes.
    """
    center, scale = center_and_scale(mesh)
    vertices = (mesh.vertices.astype(np.float64) - center) / scale
    used = np.zeros(len(vertices), bool)
    used[mesh.faces.ravel()] = True
    vertices[~used] = 0.0
    offset = ray_offset(mesh, scale)
    origins = vertices + offset * mesh.normals.astype(np.float64)
    return TraceGeometry(vertices.astype(np.float32), mesh.faces, origins.astype(np.float32), offset)
