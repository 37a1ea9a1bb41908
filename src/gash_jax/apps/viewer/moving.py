"""Transfer of every frame of an animation, as `gash view` reads it: an npz file with

    coefficients (t, v, k) or (t, v, k, 3)      vertices (t, v, 3), or (v, 3) where only the light on them changes
    faces (f, 3)                                metadata, JSON (may be missing)

in any type of floats; `verts` is read as `vertices`. On the page positions are whole numbers of 16 bits on the grid
that `metadata["grid"]` names (value = low + number * step), which is 1.5e-5 of the size of the whole motion.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int, Num

from gash_jax.algebra.sh import bands_of
from gash_jax.apps.viewer.contents import PageFile, as_half
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import open_npz

_STEPS = 65535


class Moving(NamedTuple):
    """A transfer for every frame (module docstring); the large arrays may lie in the file."""

    coefficients: Num[np.ndarray, "t v k"] | Num[np.ndarray, "t v k 3"]
    vertices: Num[np.ndarray, "_ v 3"]  # of all frames, or of one for all
    faces: Int[np.ndarray, "f 3"]
    metadata: dict[str, Any]

    @property
    def bands(self) -> int:
        """Bands B of the B² coefficients."""
        return bands_of(self.coefficients.shape[2])

    @property
    def frame_size(self) -> int:
        """Bytes of a frame on a page."""
        positions = 6 * self.vertices.shape[1] if len(self.vertices) > 1 else 0
        return 2 * self.coefficients[0].size + positions


def read_moving(path: Path) -> Moving | None:
    """The transfer of every frame, or None for a file that holds one transfer or something else.

    Raises FileError, one line, where the arrays do not fit together.
    """
    arrays = open_npz(path, "transfer")
    found, motion = arrays.get("coefficients"), arrays.get("vertices", arrays.get("verts"))
    if found is None and motion is not None and motion.ndim == 3:
        raise FileError(f"{path} has vertices of {len(motion)} frames, but no transfer: run gash animate on it first")
    if found is None or found.ndim < 3 or (found.ndim == 3 and found.shape[-1] == 3):
        return None
    faces = arrays.get("faces")
    if motion is None or faces is None:
        raise FileError(f"{path} has transfer of {len(found)} frames, but no vertices or faces: write it with both")
    vertices = motion[None] if motion.ndim == 2 else motion
    _check(path, found, vertices, faces)
    try:
        metadata = json.loads(str(arrays["metadata"])) if "metadata" in arrays else {}
    except ValueError:
        raise FileError(f"{path}: its metadata is no JSON, write it again") from None
    return Moving(found, vertices, np.asarray(faces, np.int32), metadata)


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
        for number, frame in enumerate(array):
            if frame.dtype.kind != "f" or not np.isfinite(frame).all():
                raise FileError(f"{path} holds {name} that are not finite in frame {number}: repair or leave it out")


def moving_file(moving: Moving, name: str, frames: Sequence[int], *, mesh: bool) -> PageFile:
    """The page's file of the frames that are kept."""
    kept = list(frames)
    arrays = {"coefficients": as_half(np.asarray(moving.coefficients[kept]))}
    if not mesh:
        return PageFile("transfer", name, arrays)
    vertices = np.asarray(moving.vertices[kept] if len(moving.vertices) > 1 else moving.vertices, np.float64)
    corners = vertices[:, np.unique(moving.faces)].reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    step = np.where(high > low, (high - low) / _STEPS, 1.0)
    grid = np.clip(np.rint((vertices - low) / step), 0, _STEPS).astype(np.uint16)
    arrays |= {"vertices": grid if len(vertices) > 1 else grid[0], "faces": moving.faces}
    total = len(moving.coefficients)
    thinned = f"{len(kept)} of {total} frames: a page of all of them would be too large"
    notes = [f"{vertices.shape[1]} vertices, {len(moving.faces)} faces, {total} frames"]
    notes += [thinned] if len(kept) < total else []
    return PageFile("transfer", name, arrays, {"notes": notes, "grid": {"low": low.tolist(), "step": step.tolist()}})
