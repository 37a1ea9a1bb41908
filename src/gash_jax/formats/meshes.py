"""Mesh files in, PLY out. Vertex i of a mesh is vertex i of its file: nothing is merged or reordered, ever.

The world is right-handed with +y up. A file with another up axis is turned by a proper rotation on the way in:
z up (x, y, z) -> (x, z, -y), x up (x, y, z) -> (-y, x, z).

All readers work on whole arrays of bytes or numbers. They are the project's own because the order of vertices and
the normals of the file must survive, which general loaders do not promise. Formats they do not know are read by one
(`others`), and the report says so.
"""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from gash_jax.formats.gltf import read_gltf
from gash_jax.formats.gltf_document import named_files
from gash_jax.formats.obj import read_obj
from gash_jax.formats.off import read_off
from gash_jax.formats.others import OTHERS, read_other
from gash_jax.formats.ply import read_ply, write_ply
from gash_jax.formats.raw_mesh import RawMesh
from gash_jax.formats.stl import read_stl
from gash_jax.geometry.health import HealthReport, prepare_mesh
from gash_jax.geometry.mesh import Mesh, MeshError

READERS: dict[str, Callable[[bytes, Path], RawMesh]] = {
    ".ply": lambda data, folder: read_ply(data),
    ".obj": lambda data, folder: read_obj(data),
    ".stl": lambda data, folder: read_stl(data),
    ".off": lambda data, folder: read_off(data),
    ".glb": read_gltf,
    ".gltf": read_gltf,
}

TO_Y_UP = {
    "x": np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    "y": np.eye(3, dtype=np.int64),
    "z": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
}


def load_mesh(path: str | os.PathLike[str], up: str = "y") -> Mesh:
    """The mesh in a file, `up` being the file's up axis: "x", "y" or "z". Raises MeshError, one line."""
    return read_mesh(path, up)[0]


def read_mesh(path: str | os.PathLike[str], up: str = "y") -> tuple[Mesh, HealthReport]:
    """As `load_mesh`, with the report of what is odd about the mesh."""
    if up not in TO_Y_UP:
        raise MeshError(f"unknown up axis {up!r}: choose one of {', '.join(TO_Y_UP)}")
    raw = _read(Path(path))
    vertices, normals = raw.vertices, raw.normals
    if up != "y":
        with np.errstate(all="ignore"):
            vertices = vertices.astype(np.float64) @ TO_Y_UP[up].T
            normals = None if normals is None else normals.astype(np.float64) @ TO_Y_UP[up].T
    try:
        mesh, report = prepare_mesh(vertices, raw.faces, normals)
    except MeshError as error:
        raise MeshError(f"{os.fspath(path)}: {error}") from None
    return mesh, report._replace(notes=raw.notes + report.notes)


def mesh_files(path: str | os.PathLike[str]) -> list[Path]:
    """The mesh file and those that it names: a .gltf keeps its data and pictures beside itself."""
    path = Path(path)
    if READERS.get(path.suffix.lower()) is not read_gltf or not path.is_file():
        return [path]
    return [path, *named_files(path.read_bytes(), path.parent)]


def save_mesh(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Write a mesh with its normals as binary PLY. Raises MeshError for another extension, FileError if it cannot."""
    if Path(path).suffix.lower() != ".ply":
        raise MeshError(f"{os.fspath(path)}: meshes are written as .ply, choose such a name")
    write_ply(path, mesh)


def _read(path: Path) -> RawMesh:
    """The arrays in a file, or MeshError naming it."""
    if path.is_dir():
        raise MeshError(f"{path} is a folder: give a mesh file ({' '.join(READERS)})")
    suffix = path.suffix.lower()
    reader = READERS.get(suffix)
    if reader is None and suffix not in OTHERS:
        known = f"{' '.join(READERS)} (and by trimesh {' '.join(OTHERS)})"
        raise MeshError(f"{path}: unknown mesh format {path.suffix!r}, known are {known}")
    if not path.exists():
        raise MeshError(f"no such file: {path}")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"cannot read {path}: {error.strerror}") from None
    if not data:
        raise MeshError(f"{path}: the file is empty, copy or export it again")
    try:
        with np.errstate(all="ignore"):  # damaged numbers are found by the checks that follow
            return reader(data, path.parent) if reader else read_other(data, suffix)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, MemoryError, RecursionError):
        raise MeshError(f"{path}: not a readable {path.suffix[1:].upper()} file, damaged or cut off") from None
