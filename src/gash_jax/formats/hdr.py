"""Radiance RGBE pictures (.hdr, .pic): linear radiance from and to a file.

A pixel is four bytes r, g, b, e: value = mantissa * 2^(e - 136), black where e = 0 (Ward, "Real Pixels", Graphics
Gems II; the decoding without a half added to the mantissa, as in Walter's rgbe.c, so that 1.0 is 1.0). Scanlines
come in three codings, told apart line by line: run-length coded channels (the line starts with 2, 2, width high,
width low), old runs (a pixel 1, 1, 1, n repeats the one before it n times, following ones n * 256 times) and flat.
`EXPOSURE` and `COLORCORR` lines say what the pixels were multiplied by; both are divided out. The resolution line
names the axes, slow one first: `-Y height +X width` is top row first, left pixel first. The writer rounds to nearest.
"""

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped, UInt8

from gash_jax.files.atomic import FileError, whole_file

FORMATS = "Radiance .hdr maps, OpenEXR .exr maps and light .npz files"
MOST_PIXELS = 1 << 28
_AXES = re.compile(rb"([+-])([XY]) (\d+) ([+-])([XY]) (\d+)")
_BRIGHTEST = math.ldexp(255, 119)
_RLE_WIDTHS = range(8, 32768)


class LightError(FileError):
    """A light or an environment map cannot be read, written or used; one line that says what to do."""


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


def read_hdr(path: str | Path) -> Float[np.ndarray, "h w 3"]:
    """Linear radiance of a Radiance picture, float32, top row first, left pixel first.

    Raises LightError if the file is missing, a folder, of another format, truncated or not finite.
    """
    path = Path(path)
    data = read_bytes(path)
    if not data.startswith((b"#?RADIANCE", b"#?RGBE")):
        raise LightError(f"{path} is not a Radiance picture: readable are {FORMATS}, convert it to .hdr")
    header = _read_header(data, path)
    try:
        pixels = _read_scanlines(data[header.start :], header.slow, header.fast)
    except (IndexError, ValueError):
        raise LightError(f"{path} is truncated or damaged: its pixels end or break early, fetch it again") from None
    with np.errstate(all="ignore"):  # what EXPOSURE=0 does is reported below
        image = _decode(_upright(pixels, header)) / header.scale
    if not np.isfinite(image).all():
        raise LightError(f"{path} holds radiance that is not finite: check its EXPOSURE and COLORCORR lines")
    return image


def write_hdr(path: str | Path, image: Shaped[np.ndarray, "..."]) -> None:
    """Write linear radiance (h, w, 3), finite and not negative, as a run-length coded picture; whole or not at all."""
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape or image.dtype.kind not in "fiu":
        raise LightError(f"an environment map has shape (height, width, 3), this image {image.shape} {image.dtype}")
    image = image.astype(np.float64)
    if not np.isfinite(image).all() or image.min() < 0 or image.max() > _BRIGHTEST:
        raise LightError("the image holds radiance that is not finite, negative or beyond 1.6e38: clean it first")
    height, width = image.shape[:2]
    pixels = _encode(image)
    lines = (_coded_line(line) for line in pixels) if width in _RLE_WIDTHS else (pixels.tobytes(),)
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n".encode()
    with whole_file(path) as temporary:
        temporary.write_bytes(header + b"".join(lines))


class _Header(NamedTuple):
    slow: int  # scanlines
    fast: int  # pixels of a scanline
    columns: bool  # scanlines are columns of the picture
    bottom_up: bool
    right_to_left: bool
    scale: np.ndarray  # float32 (3,), what the pixels were multiplied by
    start: int  # of the pixels, in bytes


def _read_header(data: bytes, path: Path) -> _Header:
    head, separator, rest = data.partition(b"\n\n")
    resolution, end, _ = rest.partition(b"\n")
    axes = _AXES.match(resolution)
    if not separator or not end or axes is None or axes[2] == axes[5]:
        raise LightError(f"{path} is not a whole Radiance picture: no line such as '-Y 512 +X 1024' after its header")
    scale = np.ones(3)
    for line in head.split(b"\n"):
        name, _, value = line.partition(b"=")
        try:
            if name == b"EXPOSURE":
                scale = scale * float(value)
            elif name == b"COLORCORR":
                scale = scale * np.array([float(word) for word in value.split()]).reshape(3)
        except ValueError:
            raise LightError(f"{path} has a header line that is not numbers: {line[:60]!r}") from None
        if name == b"FORMAT" and value.strip() != b"32-bit_rle_rgbe":
            raise LightError(f"{path} is coded as {value[:40].decode(errors='replace')}: only RGBE, convert it")
    slow, fast = int(axes[3]), int(axes[6])
    if not 0 < slow * fast <= MOST_PIXELS:
        raise LightError(f"{path} has {slow} x {fast} pixels: use a map with 1 to {MOST_PIXELS}")
    signs = {axes[2]: axes[1], axes[5]: axes[4]}
    turns = axes[2] == b"X", signs[b"Y"] == b"+", signs[b"X"] == b"-"
    return _Header(slow, fast, *turns, scale.astype(np.float32), len(head) + 2 + len(resolution) + 1)


def _read_scanlines(data: bytes, lines: int, width: int) -> UInt8[np.ndarray, "h w 4"]:
    """Bytes of all pixels in file order; IndexError or ValueError where the data ends or breaks."""
    source, position = np.frombuffer(data, np.uint8), 0
    pixels = np.empty((lines, width, 4), np.uint8)
    for line in pixels:
        start = data[position : position + 4]
        if width in _RLE_WIDTHS and start[:2] == b"\x02\x02" and start[2] < 128:
            if start[2] * 256 + start[3] != width:
                raise ValueError
            position = _read_coded_line(data, source, position + 4, line)
        else:
            position += _read_old_line(source[position : position + 4 * width], line)
    return pixels


def _read_coded_line(data: bytes, source: UInt8[np.ndarray, "_"], position: int, line: UInt8[np.ndarray, "w 4"]) -> int:
    """Fill one scanline of four run-length coded channels; returns the position after it."""
    width = len(line)
    for channel in range(4):
        filled = 0
        while filled < width:
            count = data[position]
            run = count > 128
            count -= 128 * run
            values = source[position + 1 : position + 2 + (0 if run else count - 1)]
            if count == 0 or filled + count > width or len(values) != (1 if run else count):
                raise ValueError
            line[filled : filled + count, channel] = values
            position += 1 + len(values)
            filled += count
    return position


def _read_old_line(source: UInt8[np.ndarray, "_"], line: UInt8[np.ndarray, "w 4"]) -> int:
    """Fill one flat or old-coded scanline; returns the number of bytes used."""
    quads = source[: len(source) // 4 * 4].reshape(-1, 4)
    repeats = (quads[:, :3] == 1).all(axis=1)
    index = np.arange(len(quads))
    last_pixel = np.maximum.accumulate(np.where(repeats, -1, index))
    digit = index - last_pixel - 1  # place of a repeat among its neighbours: each counts 256 times the one before
    counts = np.where(repeats, quads[:, 3].astype(np.int64) << np.minimum(8 * digit, 32), 1)
    reached = np.cumsum(counts)
    end = int(np.searchsorted(reached, len(line)))
    if reached[end] != len(line) or repeats[0]:
        raise ValueError
    line[:] = np.repeat(quads[last_pixel[: end + 1]], counts[: end + 1], axis=0)
    return 4 * (end + 1)


def _upright(pixels: UInt8[np.ndarray, "h w 4"], header: _Header) -> UInt8[np.ndarray, "_ _ 4"]:
    """Turn file order into rows from the top, pixels from the left."""
    pixels = pixels.transpose(1, 0, 2) if header.columns else pixels
    return pixels[:: -1 if header.bottom_up else 1, :: -1 if header.right_to_left else 1]


def _decode(pixels: UInt8[np.ndarray, "h w 4"]) -> Float[np.ndarray, "h w 3"]:
    exponents = pixels[..., 3:].astype(np.int32)
    return np.where(exponents > 0, np.ldexp(pixels[..., :3].astype(np.float32), exponents - 136), np.float32(0.0))


def _encode(image: Float[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 4"]:
    brightest = image.max(axis=-1, keepdims=True)
    exponent = np.frexp(brightest)[1]
    # rounding may carry the brightest mantissa to 256: then the next exponent holds it
    exponent = exponent + (np.rint(np.ldexp(brightest, 8 - exponent)) > 255)
    mantissas = np.rint(np.ldexp(image, 8 - exponent))
    pixels = np.concatenate([mantissas, exponent + 128], axis=-1)
    return np.where((brightest > 0) & (exponent > -128), pixels, 0).astype(np.uint8)


def _coded_line(line: UInt8[np.ndarray, "w 4"]) -> bytes:
    """Run-length coded channels of one scanline: runs from four equal bytes on, literals between."""
    width = len(line)
    parts = [bytes([2, 2, width >> 8, width & 255])]
    for channel in line.T:
        edges = np.concatenate([[0], np.flatnonzero(np.diff(channel)) + 1, [width]])
        long = np.flatnonzero(np.diff(edges) >= 4)
        position = 0
        for start, end in [*zip(edges[long], edges[long + 1], strict=True), (width, width)]:
            parts += _literals(channel[position:start].tobytes())
            whole, rest = divmod(int(end - start), 127)
            value = channel[start : start + 1].tobytes()
            parts += [b"\xff" + value] * whole + ([bytes([128 + rest]) + value] if rest else [])
            position = end
    return b"".join(parts)


def _literals(values: bytes) -> list[bytes]:
    count = math.ceil(len(values) / 128)
    pieces = [values[128 * i : 128 * (i + 1)] for i in range(count)]
    return [bytes([len(piece)]) + piece for piece in pieces]
