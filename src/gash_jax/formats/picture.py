"""What readers of environment maps share: the picture they hand over, its errors, bytes from a disk, signs.

A photograph in a wide gamut, or a filter that sharpened it, can hold tiny negative values. They are read as 0 where
they are less than 1 % of the light, with a note; beyond that something else is wrong with the file.
"""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.files.atomic import FileError

FORMATS = "Radiance .hdr maps, OpenEXR .exr maps and light .npz files"
MOST_PIXELS = 1 << 28
NEGATIVE_SHARE = 0.01
Progress = Callable[[int, int], None]


class LightError(FileError):
    """A light or an environment map cannot be read, written or used; one line that says what to do."""


class Picture(NamedTuple):
    """Linear radiance of a file, and what reading had to decide."""

    radiance: Float[np.ndarray, "h w 3"]  # float32, Rec. 709, top row first, left pixel first
    notes: tuple[str, ...]
    layout: str | None = None  # how the directions lie in it, if the file says so


def read_bytes(path: Path, count: int = -1) -> bytes:
    """All bytes of an environment map or its first `count`; LightError if it is missing, a folder or not readable."""
    if path.is_dir():
        raise LightError(f"{path} is a folder: name one environment map (.hdr, .exr) in it")
    try:
        with open(path, "rb") as file:
            return file.read(count)
    except FileNotFoundError:
        raise LightError(f"no such file: {path}") from None
    except OSError as error:
        raise LightError(f"cannot read {path}: {error.strerror}") from None


def without_negatives(
    image: Float[np.ndarray, "h w 3"], path: Path
) -> tuple[Float[np.ndarray, "h w 3"], tuple[str, ...]]:
    """The image with its few negative values set to 0 (in place), and a note with their share.

    Raises LightError where values are not finite, or negative ones are a hundredth of the light or more.
    """
    if image.size and np.isfinite(lowest := image.min()) and lowest >= 0 and np.isfinite(image.max()):
        return image, ()
    bad = ~np.isfinite(image)
    if bad.any():
        raise LightError(
            f"{path} holds radiance that is not finite ({_places(bad)}): a half float ends at 65504, save 32-bit floats"
        )
    bad = image < 0
    light, lack = float(image[~bad].sum(dtype=np.float64)), float(-image[bad].sum(dtype=np.float64))
    if lack >= NEGATIVE_SHARE * light:
        raise LightError(f"{path} holds radiance that is negative ({_places(bad)}): set it to 0 when saving")
    image[bad] = 0.0
    count = int(bad.sum())
    noun = "negative value" if count == 1 else "negative values"
    return image, (f"{count} {noun}, {lack / light:.1e} of the light: read as 0",)


def _places(bad: np.ndarray) -> str:
    rows = bad.any(axis=-1)
    row, column = np.argwhere(rows)[0]
    return f"{rows.sum()} pixels, the first in row {row}, column {column}"
