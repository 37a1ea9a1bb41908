"""Environment maps in: the door through which every picture of a light comes."""

from pathlib import Path

from gash_jax.formats.hdr import open_hdr
from gash_jax.formats.picture import FORMATS, LightError, Picture, Progress

SUFFIXES = (".hdr", ".pic", ".exr")


def read_map(path: str | Path, progress: Progress | None = None) -> Picture:
    """Radiance of a map (.hdr, .pic, .exr), with notes on what reading decided.

    `progress(done, total)` counts rows of a .hdr map while they are read; an .exr map is read at once. Raises
    LightError, one line.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES and path.is_file():
        raise LightError(f"{path} has no known light format: readable are {FORMATS}, convert it to .hdr")
    if suffix != ".exr":
        return open_hdr(path, progress)
    from gash_jax.formats.exr import open_exr  # a library of its own, which no other map needs

    return open_exr(path)
