"""Who receives light, and what stands in its way.

A *scene* is a mesh, occluders that cast shadows and bounce light but get no coefficients, and receivers: the vertices
of the mesh, or points that were given with their normals and are no part of any surface. All surfaces are joined into
one, the mesh first; rays start from its vertices and from the points.
"""

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import as_array
from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.formats.meshes import MeshLike, as_mesh, read_points
from gash_jax.geometry.checks import checked_points
from gash_jax.geometry.mesh import Mesh, MeshError, concatenate
from gash_jax.prt.rays import TraceGeometry, trace_geometry
from gash_jax.prt.tracing import checked_frames

if TYPE_CHECKING:
    from gash_jax.algebra.arguments import ArrayLike


class Scene(NamedTuple):
    """Surfaces, and everything that rays may start from."""

    surface: Mesh  # the mesh, then the occluders
    starts: Mesh  # vertices of the surface, then the points; no faces
    geometry: TraceGeometry  # the surface in trace space, and the origins of the rays of all starts
    receivers: slice  # the starts that get coefficients

    def receivers_alone(self) -> "Scene":
        """The scene without the starts that get no coefficients; what rays meet stays."""
        vertices, normals, faces = self.starts
        alone = Mesh(vertices[self.receivers], normals[self.receivers], faces)
        geometry = self.geometry._replace(origins=self.geometry.origins[self.receivers])
        return self._replace(starts=alone, geometry=geometry, receivers=slice(0, len(alone.vertices)))


def make_scene(mesh: Mesh, points: Mesh | None = None, occluders: Sequence[Mesh] = ()) -> Scene:
    """The scene of a mesh: its vertices receive light, or `points` in their place."""
    surface = concatenate([mesh, *occluders]) if occluders else mesh
    geometry, count = trace_geometry(surface, points), len(surface.vertices)
    starts, receivers = surface._replace(faces=mesh.faces[:0]), slice(0, len(mesh.vertices))
    if points is not None:
        starts, receivers = concatenate([starts, points]), slice(count, count + len(points.vertices))
    return Scene(surface, starts, geometry, receivers)


def frames_of_all(frames: object, scene: Scene) -> Float[np.ndarray, "o 3 3"] | None:
    """Frames of all starts, given those of the receivers; None if none are given. Raises ValueError."""
    receivers = scene.receivers_alone().starts
    if frames is None or len(receivers.vertices) == len(scene.starts.vertices):
        return frames  # type: ignore[return-value]
    active = np.flatnonzero(np.any(receivers.normals != 0, axis=1))
    every = np.array(orthonormal_frame(scene.starts.normals))
    every[scene.receivers][active] = checked_frames(frames, receivers, active)
    return every


def as_points(points: "ArrayLike | None", normals: "ArrayLike | None") -> Mesh | None:
    """Points (p, 3) with normals (p, 3) of length 1 or 0 as a mesh without faces; None if there are none.

    Raises MeshError for anything else.
    """
    if points is None and normals is None:
        return None
    if points is None or normals is None:
        raise MeshError("points and normals go together: give one normal for each point, or neither")
    return checked_points(*(np.asarray(as_array(array)) for array in (points, normals)))


def load_points(
    path: str | os.PathLike[str], mesh: Mesh, up: str = "y"
) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"]]:
    """Points of a PLY file and their unit normals, to be baked against a mesh. Raises MeshError.

    A 3D Gaussian splat (Kerbl et al. 2023) is flat along its shortest axis, which has no sign: of its two normals it
    gets the one on the side of the normal of the nearest vertex of the mesh.
    """
    from scipy.spatial import KDTree  # slow to import, and most bakes have no points

    points, unsigned = read_points(path, up)
    if not unsigned:
        return points.vertices, points.normals
    upright = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    if not len(upright):
        return points.vertices, points.normals
    nearest = upright[KDTree(mesh.vertices[upright]).query(points.vertices)[1]]
    against = np.einsum("pi,pi->p", points.normals, mesh.normals[nearest]) < 0
    return points.vertices, np.where(against[:, None], -points.normals, points.normals)


def as_occluders(occluders: Sequence[MeshLike]) -> list[Mesh]:
    """The meshes of a list, whatever each is given as. Raises MeshError."""
    if type(occluders) not in (list, tuple):
        raise MeshError(f"occluders are a {type(occluders).__name__}: give a list of meshes")
    return [as_mesh(occluder) for occluder in occluders]
