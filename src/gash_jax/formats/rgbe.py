"""The pixels of Radiance pictures: four bytes r, g, b, e in scanlines of three codings, told apart line by line.

value = mantissa * 2^(e - 136), black where e = 0 (Ward, "Real Pixels", Graphics Gems II; the decoding without a half
added to the mantissa, as in Walter's rgbe.c, so that 1.0 is 1.0). A scanline is run-length coded by channels (it starts
with 2, 2, width high, width low), coded by old runs (a pixel 1, 1, 1, n repeats the one before it n times, following
ones n * 256 times) or flat.

Where a run-length coded line ends is known only after following its runs. Lines that may be some, as they start like
one, are followed all at once, a run of each at a time; which of them are lines the order in the file tells.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8

from gash_jax.formats.picture import Progress

BRIGHTEST = math.ldexp(255, 119)
_RLE_WIDTHS = range(8, 32768)
_AT_ONCE = 1 << 23  # bytes of pixels decoded together
_SCALES = np.where(np.arange(256) > 0, np.ldexp(1.0, np.arange(256) - 136), 0.0).astype(np.float32)


def read_scanlines(data: bytes, lines: int, width: int, progress: Progress | None = None) -> UInt8[np.ndarray, "h 4 w"]:
    """Bytes of all pixels in file order, channel by channel in each line.

    Raises IndexError or ValueError where the data end or break. `progress(done, total)` counts lines.
    """
    source, position, line = np.frombuffer(data, np.uint8), 0, 0
    pixels = np.empty((lines, 4, width), np.uint8)
    coded = width in _RLE_WIDTHS
    candidates = _candidates(source, width) if coded else np.zeros(0, np.int64)
    batch = max(_AT_ONCE // (4 * width), 16)
    while line < lines:
        start = data[position : position + 4]
        if coded and start[:2] == b"\x02\x02" and start[2] < 128:
            first = int(np.searchsorted(candidates, position))
            if first == len(candidates) or candidates[first] != position:
                raise ValueError  # of another width
            runs = _follow(source, candidates[first : first + min(batch, lines - line)], width)
            chosen, position = _chain(runs, position, lines - line)
            _expand(runs, source, chosen, pixels[line : line + len(chosen)])
            line += len(chosen)
        else:
            position += _read_old_line(source[position : position + 4 * width], pixels[line].T)
            line += 1
        if progress:
            progress(line, lines)
    return pixels


def decode(pixels: UInt8[np.ndarray, "h 4 w"]) -> Float[np.ndarray, "h w 3"]:
    """Radiance of the pixels of some lines, float32."""
    image = np.empty((len(pixels), pixels.shape[2], 3), np.float32)
    for line, out in zip(pixels, image, strict=True):  # one line at a time stays in the cache
        scales = _SCALES[line[3]]
        for channel in range(3):
            np.multiply(line[channel], scales, out=out[:, channel])
    return image


def encode(image: Float[np.ndarray, "h w 3"]) -> bytes:
    """Scanlines of radiance that is finite, not negative and at most `BRIGHTEST`, rounded to nearest."""
    brightest = image.max(axis=-1, keepdims=True)
    exponent = np.frexp(brightest)[1]
    # rounding may carry the brightest mantissa to 256: then the next exponent holds it
    exponent = exponent + (np.rint(np.ldexp(brightest, 8 - exponent)) > 255)
    mantissas = np.rint(np.ldexp(image, 8 - exponent))
    pixels = np.concatenate([mantissas, exponent + 128], axis=-1)
    pixels = np.where((brightest > 0) & (exponent > -128), pixels, 0).astype(np.uint8)
    if image.shape[1] not in _RLE_WIDTHS:
        return pixels.tobytes()
    return b"".join(_coded_line(line) for line in pixels)


class _Runs(NamedTuple):
    """Runs of lines that may be some."""

    starts: Int[np.ndarray, "l"]  # of each line, in bytes of the source
    ends: Int[np.ndarray, "l"]  # of each line; -1 where it breaks
    line: Int[np.ndarray, "r"]  # number of the run's line
    head: Int[np.ndarray, "r"]  # its first byte, which says how long it is
    repeats: Int[np.ndarray, "r"]  # how often the byte after the head stands; 1 where the following ones differ


def _candidates(source: UInt8[np.ndarray, "_"], width: int) -> Int[np.ndarray, "c"]:
    """Where the four bytes stand that start a coded line."""
    places = np.flatnonzero(source[:-3] == 2) if len(source) > 3 else np.zeros(0, np.int64)
    for offset, byte in enumerate((2, width >> 8, width & 255), start=1):
        places = places[source[places + offset] == byte]
    return places


def _follow(source: UInt8[np.ndarray, "_"], starts: Int[np.ndarray, "l"], width: int) -> _Runs:
    """All runs of the lines that start at the given places, a run of each line in every round."""
    ends, found = np.full(len(starts), -1), []
    line, at, place = np.arange(len(starts)), starts + 4, np.zeros(len(starts), np.int64)
    while len(line):
        head = source[np.minimum(at, len(source) - 1)].astype(np.int64)
        repeated = head > 128
        count = head - 128 * repeated
        used = np.where(repeated, 1, count)
        whole = (count > 0) & (place % width + count <= width) & (at + used < len(source))
        if not whole.all():
            line, at, place, count, used, repeated = (a[whole] for a in (line, at, place, count, used, repeated))
        found.append((line, at, np.where(repeated, count, 1)))
        at, place = at + 1 + used, place + count
        done = place == 4 * width
        if done.any():
            ends[line[done]] = at[done]
            line, at, place = line[~done], at[~done], place[~done]
    columns = (np.concatenate(column) for column in zip(*found, strict=True))
    return _Runs(starts, ends, *columns)


def _chain(runs: _Runs, position: int, most: int) -> tuple[Int[np.ndarray, "n"], int]:
    """Numbers of the lines that follow each other from `position` on, and where the last one ends."""
    places = {int(start): k for k, start in enumerate(runs.starts)}
    chosen = []
    while len(chosen) < most and position in places:
        chosen.append(places[position])
        position = int(runs.ends[chosen[-1]])
    if position < 0:
        raise ValueError
    return np.array(chosen), position


def _expand(
    runs: _Runs, source: UInt8[np.ndarray, "_"], chosen: Int[np.ndarray, "n"], pixels: UInt8[np.ndarray, "n 4 w"]
) -> None:
    """Write the chosen lines, which follow each other: every byte once, but heads never and repeated ones often."""
    start, end = int(runs.starts[chosen[0]]), int(runs.ends[chosen[-1]])
    among = np.zeros(len(runs.starts), bool)
    among[chosen] = True
    among = among[runs.line]
    heads = runs.head[among] - start
    times = np.ones(end - start, np.int64)
    times[heads + 1] = runs.repeats[among]
    times[heads] = 0
    times[(runs.starts[chosen] - start)[:, None] + np.arange(4)] = 0
    pixels.reshape(-1)[:] = np.repeat(source[start:end], times)


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
