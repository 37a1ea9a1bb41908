"""Mesh files as arrays, not checked yet: which reader reads which format.

All readers work on whole arrays of bytes or numbers. They are the project's own because the order of vertices and
the normals of the file must survive, which general loaders do not promise. Formats they do not know are read by one
(`others`), and the report says so.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from gash_jax.files.atomic import FileError, as_path
from gash_jax.formats.gltf import read_gltf
from gash_jax.formats.obj import read_obj
from gash_jax.formats.off import read_off
from gash_jax.formats.others import OTHERS, read_other
from gash_jax.formats.ply import read_ply, read_ply_points
from gash_jax.formats.stl import read_stl
from gash_jax.geometry.mesh import MeshError, RawMesh

READERS: dict[str, Callable[[bytes, Path], RawMesh]] = {
    ".ply": lambda data, folder: read_ply(data),
    ".obj": lambda data, folder: read_obj(data),
    ".stl": lambda data, folder: read_stl(data),
    ".off": lambda data, folder: read_off(data),
    ".glb": read_gltf,
    ".gltf": read_gltf,
}


def read_mesh_file(path: Path) -> RawMesh:
    """The arrays in a file, or MeshError naming it."""
    path = _checked_path(path)
    suffix = path.suffix.lower()
    reader = READERS.get(suffix)
    if reader is None and suffix not in OTHERS:
        known = f"{' '.join(READERS)} (and by trimesh {' '.join(OTHERS)})"
        raise MeshError(f"{path}: unknown mesh format {path.suffix!r}, known are {known}")
    data = _content(path)
    with _naming(path):
        return reader(data, path.parent) if reader else read_other(data, suffix)


def read_point_file(path: Path) -> tuple[np.ndarray, np.ndarray, bool]:
    """Points, normals and whether these have no sign (`read_ply_points`) of a file, or MeshError naming it."""
    path = _checked_path(path)
    if path.suffix.lower() != ".ply":
        raise MeshError(f"{path}: points are read from .ply files, write them as one")
    data = _content(path)
    with _naming(path):
        return read_ply_points(data)


def _checked_path(path: Path) -> Path:
    try:
        path = as_path(path)
    except FileError as error:
        raise MeshError(str(error)) from None
    if path.is_dir():
        raise MeshError(f"{path} is a folder: give a mesh file ({' '.join(READERS)})")
    return path


def _content(path: Path) -> bytes:
    if not path.exists():
        raise MeshError(f"no such file: {path}")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"cannot read {path}: {error.strerror}") from None
    if not data:
        raise MeshError(f"{path}: the file is empty, copy or export it again")
    return data


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """Whatever a reader stumbles over becomes a MeshError that names the file."""
    try:
        with np.errstate(all="ignore"):  # damaged numbers are found by the checks that follow
            yield
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from None
    except (ValueError, LookupError, TypeError, AttributeError, OverflowError, MemoryError, RecursionError):
        raise MeshError(f"{path}: not a readable {path.suffix[1:].upper()} file, damaged or cut off") from None
