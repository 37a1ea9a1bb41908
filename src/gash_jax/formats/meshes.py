"""The door for meshes: whatever a public function takes as one comes in here and is checked; PLY goes out.

A mesh is given as a path, as arrays (vertices, faces) or (vertices, faces, normals), as a trimesh.Trimesh or Scene, or
as a `Mesh`. Vertex i stays vertex i: nothing is merged or reordered, ever.

The world is right-handed with +y up. A mesh with another up axis is turned by a proper rotation on the way in:
z up (x, y, z) -> (x, z, -y), x up (x, y, z) -> (-y, x, z).
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import shown
from gash_jax.files.atomic import as_path
from gash_jax.formats.gltf import read_gltf
from gash_jax.formats.gltf_document import named_files
from gash_jax.formats.mesh_files import READERS, read_mesh_file, read_point_file
from gash_jax.formats.others import from_trimesh, is_trimesh
from gash_jax.formats.ply import write_ply
from gash_jax.geometry.checks import checked_mesh, checked_points
from gash_jax.geometry.health import HealthReport, prepare_mesh
from gash_jax.geometry.mesh import Mesh, MeshError, RawMesh, normalized, transform

if TYPE_CHECKING:
    import trimesh

    _Arrays: TypeAlias = tuple[Any, Any] | tuple[Any, Any, Any] | list[Any]
    MeshLike: TypeAlias = str | os.PathLike[str] | Mesh | trimesh.Trimesh | trimesh.Scene | _Arrays
else:  # naming trimesh's types would import it
    MeshLike = Any

TO_Y_UP = {
    "x": np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "y": np.eye(3, dtype=np.int64),
    "z": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
}


def as_mesh(source: MeshLike) -> Mesh:
    """The mesh that a public function was given (module docstring), checked. Raises MeshError, one line."""
    return checked_mesh(source) if isinstance(source, Mesh) else read_mesh(source)[0]


def is_mesh_like(value: object) -> bool:
    """Whether a value is one of the things that are taken as a mesh; whether it is a good one is for `as_mesh`."""
    return isinstance(value, str | os.PathLike | Mesh) or type(value) in (tuple, list) or is_trimesh(value)


def load_mesh(source: MeshLike, up: str = "y") -> Mesh:
    """The mesh in a file, or made of arrays; `up` is the axis that points up in it: "x", "y" or "z".

    Raises MeshError, one line that says what to do.

    >>> mesh = gash_jax.load_mesh("bunny.ply")
    >>> corner = gash_jax.load_mesh(([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), up="z")
    >>> corner.vertices[2].tolist()
    [0.0, 0.0, -1.0]
    """
    return read_mesh(source, up)[0]


def read_mesh(source: MeshLike, up: str = "y") -> tuple[Mesh, HealthReport]:
    """As `load_mesh`, with the report of what is odd about the mesh.

    >>> mesh, report = gash_jax.read_mesh(([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2]]))
    >>> report.counts["isolated_vertices"], report.planar
    (1, True)
    """
    _check_up(up)
    if isinstance(source, Mesh):
        mesh = checked_mesh(source)
        mesh = mesh if up == "y" else transform(mesh, TO_Y_UP[up].astype(np.float64))
        return mesh, prepare_mesh(mesh.vertices, mesh.faces, mesh.normals)[1]
    raw = _raw(source)
    vertices, normals = raw.vertices, raw.normals
    if up != "y":
        with np.errstate(all="ignore"):
            vertices = vertices.astype(np.float64) @ TO_Y_UP[up].T
            normals = None if normals is None else normals.astype(np.float64) @ TO_Y_UP[up].T
    try:
        mesh, report = prepare_mesh(vertices, raw.faces, normals)
    except MeshError as error:
        if isinstance(source, str | os.PathLike):
            raise MeshError(f"{os.fspath(source)}: {error}") from None
        raise
    return mesh, report._replace(notes=raw.notes + report.notes)


def vertex_colors(source: MeshLike) -> Float[np.ndarray, "v 3"]:
    """Linear RGB of every vertex of a mesh file or a trimesh.Trimesh. Raises MeshError where it has none.

    Colours of whole numbers in PLY files, of OBJ files and of trimesh are sRGB and decoded; floats in PLY files and
    glTF's COLOR_0 are linear already.
    """
    colors = None if isinstance(source, Mesh) else _raw(source).colors
    if colors is None:
        name = os.fspath(source) if isinstance(source, str | os.PathLike) else "the mesh"
        raise MeshError(f"{name} has no colours of vertices: give the albedo as a number, a colour or an array")
    return colors.astype(np.float32)


def texture_coordinates(source: MeshLike) -> Float[np.ndarray, "f 3 2"] | None:
    """(u, v) of every corner of the faces of a mesh file or a trimesh.Trimesh, u to the right, v downwards.

    They are the file's own numbers, but for v, which OBJ, PLY and trimesh count from below; not finite at corners that
    have none. None where the mesh has none at all.
    """
    return None if isinstance(source, Mesh) else _raw(source).uv


def read_points(path: str | os.PathLike[str], up: str = "y") -> tuple[Mesh, bool]:
    """Points with unit normals in a PLY file, as a mesh without faces, and whether their normals have no sign.

    Those of Gaussian splats are shortest axes, which point either way. Normals of any length are made unit; 0 stays 0.
    Raises MeshError where there are none, or where one is not finite.
    """
    _check_up(up)
    points, normals, unsigned = read_point_file(Path(path))
    bad = np.any(~np.isfinite(normals), axis=1)
    if bad.any():
        raise MeshError(
            f"{path}: {bad.sum()} of {len(normals)} normals are not finite (first: {np.argmax(bad)}): repair them"
        )
    upright = normalized(normals.astype(np.float64)) @ TO_Y_UP[up].T
    try:
        return checked_points(points.astype(np.float64) @ TO_Y_UP[up].T, upright), unsigned
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None


def _check_up(up: object) -> None:
    if not isinstance(up, str) or up not in TO_Y_UP:
        raise MeshError(f"unknown up axis {shown(up)}: choose one of {', '.join(TO_Y_UP)}")


def mesh_files(path: str | os.PathLike[str]) -> list[Path]:
    """The mesh file and those that it names: a .gltf keeps its data and pictures beside itself."""
    path = Path(path)
    if READERS.get(path.suffix.lower()) is not read_gltf or not path.is_file():
        return [path]
    return [path, *named_files(path.read_bytes(), path.parent)]


def save_mesh(path: str | os.PathLike[str], mesh: MeshLike) -> None:
    """Write a mesh with its normals as binary PLY. Raises MeshError for another extension, FileError if it cannot.

    >>> gash_jax.save_mesh("triangle.ply", ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    >>> gash_jax.load_mesh("triangle.ply").faces.tolist()
    [[0, 1, 2]]
    """
    if as_path(path).suffix.lower() != ".ply":
        raise MeshError(f"{path}: meshes are written as .ply, choose such a name")
    write_ply(path, as_mesh(mesh))


def _raw(source: MeshLike) -> RawMesh:
    """The arrays of a file, of a trimesh object, or as they were given."""
    if isinstance(source, str | os.PathLike):
        return read_mesh_file(Path(source))
    if is_trimesh(source):
        return from_trimesh(source)
    if not isinstance(source, tuple | list):
        raise MeshError(
            f"a {type(source).__name__} is no mesh: give a path, a Mesh, a trimesh.Trimesh or Scene, "
            "or arrays (vertices, faces[, normals])"
        )
    if len(source) not in (2, 3):
        raise MeshError(
            f"a mesh of arrays is (vertices, faces) or (vertices, faces, normals), not {len(source)} of them"
        )
    normals = None if len(source) == 2 or source[2] is None else _array(source[2], "normals")
    return RawMesh(_array(source[0], "vertices"), _array(source[1], "faces"), normals)


def _array(values: object, name: str) -> np.ndarray:
    try:
        return np.asarray(values)
    except (TypeError, ValueError):  # ragged lists; arrays that JAX is tracing
        raise MeshError(
            f"{name} are no array of numbers: give a NumPy or JAX array outside of jit, grad and vmap"
        ) from None
