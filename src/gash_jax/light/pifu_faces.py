"""The triangles of an OBJ file as the loaders of PIFu and its kin make them.

They keep the order of the `f` lines, and of four corners 1 2 3 4 make (1, 2, 3) and (3, 4, 1); of more corners they see
the first four (PIFu, lib/renderer/mesh.py, load_obj_mesh). Our own reader cuts (1, 2, 3) and (1, 3, 4), or the other
diagonal where a quad is concave. As their renderer fetches a row of coefficients for every corner of every triangle,
`face.npy` must follow them.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Int

from gash_jax.files.atomic import FileError
from gash_jax.formats.obj import obj_polygons


def pifu_faces(path: Path, vertices: int) -> Int[np.ndarray, "f 3"]:
    """Those triangles, from 0. Raises FileError where the file is no OBJ of so many `v` lines or fewer."""
    if path.suffix.lower() != ".obj":
        raise FileError(f"{path}: the loaders that read face.npy read .obj files: give that file")
    if not path.is_file():
        raise FileError(f"no such file: {path}")
    corners, sizes = obj_polygons(path.read_bytes())
    faces = triangles_of(corners, sizes)
    if not len(faces) or faces.min() < 0 or faces.max() >= vertices:
        raise FileError(f"{path} is not the mesh of {vertices} vertices that was baked: bake it, then convert")
    return faces


def triangles_of(corners: Int[np.ndarray, "c"], sizes: Int[np.ndarray, "p"]) -> Int[np.ndarray, "f 3"]:
    """Triangles of polygons by that rule; those of fewer than three corners give none."""
    first = np.cumsum(sizes) - sizes
    kept = np.repeat(first[sizes > 2], np.minimum(sizes[sizes > 2] - 2, 2))
    second = np.append(False, kept[1:] == kept[:-1])
    return corners[np.where(second[:, None], kept[:, None] + [2, 3, 0], kept[:, None] + [0, 1, 2])]
