"""What `--albedo` says: a number, a colour, the colours of the vertices, or a file."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_array
from gash_jax.formats.meshes import vertex_colors


def read_albedo(text: str, meshes: Sequence[Path]) -> Any:
    """The albedo for a bake of the mesh files, of which all but the first are occluders. Raises ValueError.

    "vertex" reads the colours of each of them; a file holds one number or colour for each vertex of the mesh and then
    of the occluders.
    """
    if text == "vertex":
        return np.concatenate([vertex_colors(path) for path in meshes])
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        return _from_file(Path(text))
    if len(numbers) not in (1, 3):
        raise ValueError(f"--albedo {text} has {len(numbers)} numbers: give one, or three as R,G,B")
    return numbers[0] if len(numbers) == 1 else numbers


def albedo_file(text: str | None) -> Path | None:
    """The file that `--albedo` names, if it names one."""
    return None if text is None or not Path(text).is_file() else Path(text)


def _from_file(path: Path) -> np.ndarray:
    if path.suffix not in (".npy", ".npz"):
        raise FileError(f"--albedo {path} is no albedo: give a number, R,G,B, vertex, or a .npy or .npz file")
    return read_array(path)
