"""What every mesh must pass, wherever it comes from: real finite numbers, faces of existing vertices, a size.

Messages are one line that says what to do.
"""

import numpy as np
from jaxtyping import Bool, Float, Int, Num, Shaped

from gash_jax.geometry.mesh import Mesh, MeshError, lengths, referenced

_UNIT = 1e-3  # how far from 1 the length of a unit normal may be: float16 keeps three digits


def checked_vertices(vertices: Shaped[np.ndarray, "..."]) -> Float[np.ndarray, "v 3"]:
    """Vertices as finite float64 that float32 can hold. Raises MeshError."""
    if vertices.size == 0:
        raise MeshError("the mesh has no vertices: nothing to bake")
    if vertices.ndim != 2 or vertices.shape[1] != 3 or vertices.dtype.kind not in "fiu":
        raise MeshError(f"vertices must be real numbers of shape (v, 3), not {vertices.dtype} {vertices.shape}")
    points = vertices.astype(np.float64)
    bad = np.any(~(np.abs(points) < np.finfo(np.float32).max), axis=1)
    if bad.any():
        raise MeshError(
            f"{bad.sum()} of {len(points)} vertices are not finite (first: {np.argmax(bad)}): "
            "repair or remove them in the program that wrote the mesh"
        )
    return points


def checked_faces(faces: Shaped[np.ndarray, "..."], vertex_count: int) -> Int[np.ndarray, "f 3"]:
    """Faces as int32 indices of existing vertices. Raises MeshError."""
    if faces.size == 0:
        raise MeshError("the mesh has no faces: point clouds and curves cannot be baked, give a triangle mesh")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise MeshError(f"faces must be integers of shape (f, 3), not {faces.dtype} {faces.shape}: give triangles")
    bad = ((faces < 0) | (faces >= vertex_count)).any(axis=1)
    if bad.any():
        worst = faces[np.argmax(bad)].tolist()
        raise MeshError(
            f"{bad.sum()} of {len(faces)} faces name a vertex that does not exist (first: face {np.argmax(bad)} "
            f"{worst}, the mesh has {vertex_count} vertices from 0): export the mesh again"
        )
    return faces.astype(np.int32)


def checked_normals(normals: Shaped[np.ndarray, "..."], vertex_count: int) -> Num[np.ndarray, "v 3"]:
    """Normals of any length, one for each vertex; not finite or 0 where it has none. Raises MeshError."""
    if normals.shape != (vertex_count, 3):
        raise MeshError(f"normals have shape {normals.shape}, vertices {(vertex_count, 3)}: give one per vertex")
    if normals.dtype.kind not in "fiu":
        raise MeshError(f"normals must be real numbers, not {normals.dtype}")
    return normals


def checked_box(
    points: Float[np.ndarray, "v 3"], used: Bool[np.ndarray, "v"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Lowest and highest coordinates of the vertices of faces. Raises MeshError where they are one point."""
    low, high = points[used].min(axis=0), points[used].max(axis=0)
    if not np.any(low.astype(np.float32) != high.astype(np.float32)):
        raise MeshError("all faces lie in one point: the mesh has no size; check its coordinates and units")
    return low, high


def checked_mesh(mesh: Mesh) -> Mesh:
    """A mesh that somebody made as it must be: float32 vertices, float32 normals of length 1 or 0, int32 faces.

    Its arrays may be NumPy's or JAX's, of any real type. Raises MeshError.
    """
    vertices, normals, faces = (np.asarray(array) for array in mesh)
    points = checked_vertices(vertices)
    faces, normals = checked_faces(faces, len(points)), checked_normals(normals, len(points)).astype(np.float32)
    _check_lengths(normals, "normalise them, or give (vertices, faces, normals), which does")
    checked = Mesh(vertices.astype(np.float32, copy=False), normals, faces)
    checked_box(points, referenced(checked))
    return checked


def checked_points(points: Shaped[np.ndarray, "..."], normals: Shaped[np.ndarray, "..."]) -> Mesh:
    """Points with normals of length 1 or 0, as a mesh without faces; in float32. Raises MeshError."""
    if points.ndim != 2 or points.shape[1:] != (3,) or not len(points) or points.dtype.kind not in "fiu":
        raise MeshError(f"points must be real numbers of shape (p, 3), not {points.dtype} {points.shape}")
    if normals.shape != points.shape or normals.dtype.kind not in "fiu":
        raise MeshError(
            f"normals have shape {normals.shape} {normals.dtype}, points {points.shape}: give one per point"
        )
    bad = np.any(~(np.abs(points.astype(np.float64)) < np.finfo(np.float32).max), axis=1)
    if bad.any():
        raise MeshError(f"{bad.sum()} of {len(points)} points are not finite (first: {np.argmax(bad)}): leave them out")
    upright = normals.astype(np.float32)
    _check_lengths(upright, "normalise them; 0 stands for none")
    return Mesh(points.astype(np.float32), upright, np.zeros((0, 3), np.int32))


def _check_lengths(normals: Float[np.ndarray, "v 3"], advice: str) -> None:
    """Raise MeshError unless all normals are of length 1 or 0."""
    length = lengths(normals)
    bad = ~((np.abs(length - 1) <= _UNIT) | (length == 0))
    if bad.any():
        first = int(np.argmax(bad))
        raise MeshError(
            f"{bad.sum()} of {len(normals)} normals are not of length 1 (first: {first}, {length[first]:.3g}): {advice}"
        )
