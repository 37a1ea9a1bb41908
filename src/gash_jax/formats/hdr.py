"""Radiance pictures (.hdr, .pic): linear radiance from and to a file.

A header of text lines, an empty line, a line with the resolution, then the pixels (`rgbe`). `EXPOSURE` and `COLORCORR`
lines say what the pixels were multiplied by; both are divided out. A `PRIMARIES` line names other colours than those of
Rec. 709 and has the pixels converted. The resolution line names the axes, slow one first: `-Y height +X width` is top
row first, left pixel first. Lines may end in LF, CR LF or CR.
"""

import codecs
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike, as_array
from gash_jax.files.atomic import whole_file
from gash_jax.formats.picture import FORMATS, MOST_PIXELS, LightError, Picture, Progress, read_bytes, without_negatives
from gash_jax.formats.primaries import REC_709, in_rec_709
from gash_jax.formats.rgbe import BRIGHTEST, decode, encode, read_scanlines

_MAGIC = re.compile(rb"#\?(RADIANCE|RGBE)[^\r\n]*(\r\n|\n|\r)", re.IGNORECASE)
_AXES = re.compile(rb"([+-])([XY]) (\d+) ([+-])([XY]) (\d+)")


def open_hdr(path: str | Path, progress: Progress | None = None) -> Picture:
    """A Radiance picture, with a note where its colours were converted; `progress(done, total)` counts its lines.

    Raises LightError if the file is missing, a folder, of another format, truncated or not finite.
    """
    path = Path(path)
    data = read_bytes(path).removeprefix(codecs.BOM_UTF8)
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise LightError(f"{path} is UTF-16 text, which no Radiance picture is: fetch it again as it was")
    magic = _MAGIC.match(data)
    if magic is None:
        raise LightError(f"{path} is not a Radiance picture: readable are {FORMATS}, convert it to .hdr")
    header = _read_header(data, magic[2], path)
    try:
        pixels = read_scanlines(data[header.start :], header.slow, header.fast, progress)
    except (IndexError, ValueError):
        raise LightError(f"{path} is truncated or damaged: its pixels end or break early, fetch it again") from None
    image = decode(pixels)
    if not np.all(header.scale == 1):
        with np.errstate(all="ignore"):  # what EXPOSURE=0 does is reported below
            image /= header.scale
        if not np.isfinite(image).all():
            raise LightError(f"{path} holds radiance that is not finite: check its EXPOSURE and COLORCORR lines")
    image, notes = without_negatives(image, path)
    image, note = in_rec_709(image, header.primaries)
    return Picture(np.ascontiguousarray(_upright(image, header)), notes + note)


def write_hdr(path: str | Path, image: ArrayLike) -> None:
    """Write linear radiance (h, w, 3), finite and not negative, as a run-length coded picture; whole or not at all.

    >>> gash_jax.write_hdr("grey.hdr", np.full((16, 32, 3), 0.5))
    >>> round(float(gash_jax.load_light("grey.hdr").coefficients[0, 0]), 3)
    1.772
    """
    image = np.asarray(as_array(image))
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape or image.dtype.kind not in "fiu":
        raise LightError(f"an environment map has shape (height, width, 3), this image {image.shape} {image.dtype}")
    image = image.astype(np.float64)
    if not np.isfinite(image).all() or image.min() < 0 or image.max() > BRIGHTEST:
        raise LightError("the image holds radiance that is not finite, negative or beyond 1.6e38: clean it first")
    height, width = image.shape[:2]
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode()
    with whole_file(path) as temporary:
        temporary.write_bytes(header + encode(image))


class _Header(NamedTuple):
    slow: int  # scanlines
    fast: int  # pixels of a scanline
    columns: bool  # scanlines are columns of the picture
    bottom_up: bool
    right_to_left: bool
    scale: np.ndarray  # float32 (3,), what the pixels were multiplied by
    primaries: np.ndarray  # x and y of red, green, blue, white
    start: int  # of the pixels, in bytes


def _read_header(data: bytes, line_end: bytes, path: Path) -> _Header:
    # after line ends of one character, a byte of a pixel may look like the second of two
    end = rb"\r" if line_end == b"\r" else rb"\r?\n"
    blank = re.search(end + rb"[ \t]*" + end, data)
    resolution = re.compile(rb"[^\r\n]*" + end).match(data, blank.end()) if blank else None
    axes = _AXES.match(resolution[0]) if resolution else None
    if blank is None or resolution is None or axes is None or axes[2] == axes[5]:
        raise LightError(f"{path} is not a whole Radiance picture: no line such as '-Y 512 +X 1024' after its header")
    scale, primaries = _header_values(re.split(rb"\r\n|\n|\r", data[: blank.start()]), path)
    slow, fast = int(axes[3]), int(axes[6])
    if not 0 < slow * fast <= MOST_PIXELS:
        raise LightError(f"{path} has {slow} x {fast} pixels: use a map with 1 to {MOST_PIXELS}")
    signs = {axes[2]: axes[1], axes[5]: axes[4]}
    turns = axes[2] == b"X", signs[b"Y"] == b"+", signs[b"X"] == b"-"
    return _Header(slow, fast, *turns, scale.astype(np.float32), primaries, resolution.end())


def _header_values(lines: list[bytes], path: Path) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "8"]]:
    """What the pixels were multiplied by, and the chromaticities of their colours."""
    scale, primaries = np.ones(3), REC_709
    for line in lines:
        name, _, value = line.partition(b"=")
        try:
            if name == b"EXPOSURE":
                scale = scale * float(value)
            elif name == b"COLORCORR":
                scale = scale * np.array([float(word) for word in value.split()]).reshape(3)
            elif name == b"PRIMARIES":
                primaries = np.array([float(word) for word in value.split()]).reshape(8)
        except ValueError:
            raise LightError(f"{path} has a header line that is not numbers: {line[:60]!r}") from None
        if name == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise LightError(f"{path} is coded as {value[:40].decode(errors='replace')}: only RGBE, convert it")
    return scale, primaries


def _upright(image: Float[np.ndarray, "h w 3"], header: _Header) -> Float[np.ndarray, "_ _ 3"]:
    """Turn file order into rows from the top, pixels from the left."""
    image = image.transpose(1, 0, 2) if header.columns else image
    return image[:: -1 if header.bottom_up else 1, :: -1 if header.right_to_left else 1]
