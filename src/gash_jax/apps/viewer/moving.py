"""Transfer of every frame of an animation, as `gash animate` writes it and `gash view` reads it: an npz file with

    coefficients (t, v, k) or (t, v, k, 3)      vertices (t, v, 3), or (v, 3) where only the light on them changes
    normals, as vertices (may be missing)       visibility (t, v, (2B-1)²) of a glossy bake (may be missing)
    faces (f, 3)                                metadata, JSON (may be missing)

in any type of floats; `verts` is read as `vertices`. Without normals they are the angle-weighted ones of every frame.
"""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int, Num

from gash_jax.algebra.sh import bands_of
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import open_npz
from gash_jax.geometry.mesh import angle_weighted_normals


class Moving(NamedTuple):
    """A transfer for every frame (module docstring); the large arrays may lie in the file."""

    coefficients: Num[np.ndarray, "t v k"] | Num[np.ndarray, "t v k 3"]
    vertices: Num[np.ndarray, "_ v 3"]  # of all frames, or of one for all
    normals: Float[np.ndarray, "_ v 3"]  # as many as there are vertices
    faces: Int[np.ndarray, "f 3"]
    visibility: Num[np.ndarray, "t v j"] | None
    metadata: dict[str, Any]

    @property
    def bands(self) -> int:
        """Bands B of the B² coefficients."""
        return bands_of(self.coefficients.shape[2])


def read_moving(path: Path) -> Moving | None:
    """The transfer of every frame, or None for a file that holds one transfer or something else.

    Raises FileError, one line, where the arrays do not fit together.
    """
    arrays = open_npz(path, "transfer")
    found, motion = arrays.get("coefficients"), arrays.get("vertices", arrays.get("verts"))
    if found is None and "radiance" in arrays:
        raise FileError(f"{path} has radiance under one light, which a page cannot turn: shade it, docs/deforming.md")
    if found is None and motion is not None and motion.ndim == 3:
        raise FileError(f"{path} has vertices of {len(motion)} frames, but no transfer: run gash animate on it first")
    if found is None or found.ndim < 3 or (found.ndim == 3 and found.shape[-1] == 3):
        return None
    faces = arrays.get("faces")
    if motion is None or faces is None:
        raise FileError(f"{path} has transfer of {len(found)} frames, but no vertices or faces: write it with both")
    vertices = motion[None] if motion.ndim == 2 else motion
    _check(path, found, vertices, faces)
    corners = np.asarray(faces, np.int32)
    try:
        metadata = json.loads(str(arrays["metadata"])) if "metadata" in arrays else {}
    except ValueError:
        raise FileError(f"{path}: its metadata is no JSON, write it again") from None
    normals = _normals(path, arrays.get("normals"), vertices, corners)
    return Moving(found, vertices, normals, corners, _visibility(path, arrays.get("visibility"), found), metadata)


def _normals(
    path: Path, found: np.ndarray | None, vertices: Num[np.ndarray, "t v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "t v 3"]:
    """The file's own normals, or angle-weighted ones, float16."""
    if found is None:
        each = (angle_weighted_normals(np.asarray(frame, np.float64), faces) for frame in vertices)
        return np.stack([normals.astype(np.float16) for normals in each])
    normals = found[None] if found.ndim == 2 else found
    if normals.shape != vertices.shape:
        raise FileError(
            f"{path}: normals {found.shape} do not fit its vertices: leave them out, or write them for each"
        )
    _check_finite(path, "normals", normals)
    return normals


def _visibility(path: Path, found: np.ndarray | None, coefficients: np.ndarray) -> np.ndarray | None:
    if found is None:
        return None
    wanted = (*coefficients.shape[:2], (2 * bands_of(coefficients.shape[2]) - 1) ** 2)
    if found.shape != wanted:
        raise FileError(f"{path}: its visibility has shape {found.shape}, not {wanted}: bake it again")
    _check_finite(path, "visibility", found)
    return found


def _check(path: Path, found: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> None:
    count = found.shape[1]
    fits = found.ndim == 3 or (found.ndim == 4 and found.shape[3] == 3)
    if not fits or vertices.ndim != 3 or vertices.shape[1:] != (count, 3) or len(vertices) not in (1, len(found)):
        raise FileError(
            f"{path}: coefficients {found.shape} and vertices {vertices.shape} do not fit: "
            "give (frames, vertices, bands²) and (frames, vertices, 3)"
        )
    try:
        bands_of(found.shape[2])
    except ValueError as error:
        raise FileError(f"{path} is not a transfer of frames: {error}; make it again") from None
    if faces.ndim != 2 or faces.shape[1:] != (3,) or faces.dtype.kind not in "iu" or not faces.size:
        raise FileError(f"{path}: faces are {faces.dtype} {faces.shape}: give whole numbers (f, 3)")
    if faces.min() < 0 or faces.max() >= count:
        raise FileError(f"{path}: faces name vertices that do not exist, write it again")
    for name, array in (("coefficients", found), ("vertices", vertices)):
        _check_finite(path, name, array)


def _check_finite(path: Path, name: str, array: np.ndarray) -> None:
    for number, frame in enumerate(array):
        if frame.dtype.kind != "f" or not np.isfinite(frame).all():
            raise FileError(f"{path} holds {name} that are not finite in frame {number}: repair or leave it out")
