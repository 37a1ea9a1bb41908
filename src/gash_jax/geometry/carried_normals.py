"""Normals of a mesh that deforms, its faces staying: those of one pose carried along to the others.

The normals of that pose, a file's own smooth or hard ones too, keep their coordinates in the frames that the
angle-weighted normal of each vertex and one edge there span. So the pose has them exactly, a pose that is turned has
them turned, and where they were the angle-weighted normals they stay so in every pose. A vertex without such a frame
(its faces cancel, or it has none) keeps its normal as it is.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.geometry.mesh import Mesh, angle_weighted_normals, lengths, normalized


class CarriedNormals(NamedTuple):
    """Normals as coordinates in the frames of their vertices (module docstring)."""

    local: Float[np.ndarray, "v 3"]  # along the angle-weighted normal, the edge across it, and across both
    neighbour: Int[np.ndarray, "v"]  # the other end of the edge
    fixed: Float[np.ndarray, "v 3"]  # normals of the vertices without a frame; 0 elsewhere


# angle-weighted normals of float32 vertices agree to this, whoever computes them: such a normal is the frame's own
_SAME = 1e-5


def carried_normals(mesh: Mesh, faces: Int[np.ndarray, "f 3"]) -> CarriedNormals:
    """The normals of a mesh in the frames of its pose, each with the edge that is longest across its normal."""
    vertices, own = mesh.vertices.astype(np.float64), mesh.normals.astype(np.float64)
    normals, neighbour = angle_weighted_normals(vertices, faces), np.arange(len(vertices))
    tail = np.concatenate([faces.ravel(), faces.ravel()])
    head = np.concatenate([faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()])
    across = lengths(_across(vertices[head] - vertices[tail], normals[tail]))
    rising = np.argsort(across, kind="stable")
    neighbour[tail[rising]] = head[rising]  # the last one stays
    frames = vertex_frames(vertices, normals, neighbour, normalized)
    framed = frames.any(axis=2).all(axis=1)
    local = np.einsum("vij,vj->vi", frames, own) * framed[:, None]
    local[np.abs(own - normals).max(axis=1) < _SAME] = (1.0, 0.0, 0.0)
    fixed = np.where(framed[:, None], 0, own)
    return CarriedNormals(local.astype(np.float32), neighbour, fixed.astype(np.float32))


def _across(vectors: Any, normals: Any) -> Any:
    """What of the vectors is perpendicular to the unit normals."""
    return vectors - (vectors * normals).sum(axis=1)[:, None] * normals


def vertex_frames(positions: Any, normals: Any, neighbour: Any, unit: Callable[[Any], Any]) -> Any:
    """Rows of the frames (v, 3, 3): normal, edge across it, across both; 0 where there is no such direction."""
    xp = positions.__array_namespace__()  # NumPy, or jax.numpy
    tangent = unit(_across(positions[neighbour] - positions, normals))
    return xp.stack([normals, tangent, xp.cross(normals, tangent)], axis=1)


def posed_mesh(positions: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], carried: CarriedNormals) -> Mesh:
    """A pose as a mesh, with its normals; 0 where the pose has made a frame vanish."""
    wide = positions.astype(np.float64)
    normals = angle_weighted_normals(wide, faces)
    other = np.flatnonzero((carried.local != (1, 0, 0)).any(axis=1))  # than the angle-weighted normal itself
    if len(other):
        frames = vertex_frames(wide, normals, carried.neighbour, normalized)[other]
        normals[other] = normalized(np.einsum("vij,vi->vj", frames, carried.local[other].astype(np.float64)))
    return Mesh(positions, (normals + carried.fixed).astype(np.float32), faces)
