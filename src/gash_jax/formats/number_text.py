"""The text of mesh files: its coding and line ends, and the numbers in it, row by row."""

import codecs
import re
import warnings

import numpy as np
from jaxtyping import Float, Int, Num

from gash_jax.geometry.mesh import MeshError

_SAMPLE = 64  # bytes in which the zeros of wide text are looked for
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE)


def plain_text(data: bytes) -> bytes:
    """The text of a file without a byte order mark, its lines ended by line feeds alone.

    Raises MeshError for UTF-16 and UTF-32.
    """
    refuse_wide_text(data)
    return data.removeprefix(codecs.BOM_UTF8).replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def refuse_wide_text(data: bytes) -> None:
    """Raise MeshError for text of two or four bytes a character, with or without a byte order mark."""
    head = data[:_SAMPLE]
    zeros = [len(head) >= 8 and not any(head[start::2]) for start in (0, 1)]
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) or any(zeros) and any(head):
        raise MeshError("the file is UTF-16 text: save it as UTF-8 or plain ASCII")


def whole_numbers(numbers: Num[np.ndarray, "n"], what: str) -> Int[np.ndarray, "n"]:
    """The numbers as integers; MeshError, naming them as `what`, if one is a fraction, not finite or beyond 2^53."""
    if numbers.dtype.kind == "f" and np.any(~(np.abs(numbers) < 2.0**53) | (numbers != np.rint(numbers))):
        raise MeshError(f"{what} that is not a whole number: the file is damaged")
    return numbers.astype(np.int64)


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
