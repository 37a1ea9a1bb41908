"""What file readers hand over before any check, and the parsing they share."""

import re
import warnings
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Num

from gash_jax.geometry.mesh import MeshError

_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)


class RawMesh(NamedTuple):
    """The arrays of a file as they are: vertex i is the file's vertex i, nothing is checked yet."""

    vertices: Num[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Num[np.ndarray, "v 3"] | None  # not finite or 0 where a vertex has none
    notes: tuple[str, ...]  # what reading had to decide


def fan_triangulate(
    corners: Int[np.ndarray, "c"], sizes: Int[np.ndarray, "p"]
) -> tuple[Int[np.ndarray, "f 3"], tuple[str, ...]]:
    """Triangles (0, i, i+1) of polygons given as their corners in a row and their sizes, in order.

    Also a note, where there are any, on polygons of fewer than three corners: they make no triangle.
    """
    triangles = np.maximum(sizes - 2, 0)
    base = np.repeat(np.cumsum(sizes) - sizes, triangles)
    step = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    faces = np.stack([corners[base], corners[base + step + 1], corners[base + step + 2]], axis=1)
    few = np.count_nonzero(sizes < 3)
    note = f"{few} {'polygon' if few == 1 else 'polygons'} of fewer than three corners: left out"
    return faces.astype(np.int64), (note,) if few else ()


def parse_rows(text: bytes) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "s"]]:
    """All numbers of a text, and the number each non-empty line starts with (the total follows as last).

    Raises MeshError if a word is not a number.
    """
    characters = np.frombuffer(text, dtype=np.uint8)
    solid = characters > 32
    first = solid.copy()
    first[1:] &= ~solid[:-1]
    line = np.cumsum(characters == 10)[first]
    numbers = _numbers(text) if len(line) else np.zeros(0)
    if len(numbers) != len(line):
        word = next((word for word in text.split() if not _NUMBER.fullmatch(word)), b"a word")
        raise MeshError(f"{word[:30].decode(errors='replace')!r} is not a number: the file is damaged")
    new = np.ones(len(line), dtype=bool)
    new[1:] = line[1:] != line[:-1]
    return numbers, np.append(np.flatnonzero(new), len(line))


def _numbers(text: bytes) -> Float[np.ndarray, "n"]:
    """The numbers of a text up to the first word that is none; nothing at all if NumPy is of a strict version."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            return np.fromstring(text, dtype=np.float64, sep=" ")
        except ValueError:
            return np.zeros(0)


def leading_columns(
    numbers: Float[np.ndarray, "n"], starts: Int[np.ndarray, "s"], columns: int
) -> Float[np.ndarray, "r {columns}"]:
    """The first `columns` numbers of each row; MeshError if a row has fewer."""
    if np.any(np.diff(starts) < columns):
        row = int(np.argmax(np.diff(starts) < columns))
        raise MeshError(f"vertex {row} has fewer than {columns} numbers: the file is damaged or cut off")
    return numbers[starts[:-1, None] + np.arange(columns)]
