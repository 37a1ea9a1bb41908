"""Scanlines of Radiance pictures: all codings mixed, against a decoder that reads byte by byte; damage; speed."""

import time

import numpy as np
import pytest

from gash_jax.formats import rgbe
from gash_jax.formats.rgbe import decode, encode, read_scanlines


def _slow(data: bytes, lines: int, width: int) -> np.ndarray:
    """The definition, one byte after the other."""
    out, at = [], 0
    for _ in range(lines):
        if width >= 8 and data[at : at + 2] == b"\x02\x02" and data[at + 2] < 128:
            assert data[at + 2] * 256 + data[at + 3] == width
            at += 4
            channels = []
            for _ in range(4):
                values: list[int] = []
                while len(values) < width:
                    head = data[at]
                    if head > 128:
                        values += [data[at + 1]] * (head - 128)
                        at += 2
                    else:
                        values += data[at + 1 : at + 1 + head]
                        at += 1 + head
                channels.append(values)
            out.append(np.array(channels, np.uint8))
            continue
        pixels: list[bytes] = []
        shift = 0
        while len(pixels) < width:
            quad = data[at : at + 4]
            at += 4
            if quad[:3] == b"\x01\x01\x01":
                pixels += [pixels[-1]] * (quad[3] << shift)
                shift += 8
            else:
                pixels.append(quad)
                shift = 0
        out.append(np.frombuffer(b"".join(pixels), np.uint8).reshape(width, 4).T)
    return np.array(out)


def _line(rng: np.random.Generator, width: int, coding: str) -> bytes:
    """A line whose values are often 2, 2 and the width, as at the start of a coded one."""
    tempting = np.array([2, 2, width >> 8, width & 255, 1, 128, 255], np.uint8)
    values = rng.choice(tempting, size=(4, width))
    if coding == "flat":
        values[0] = 77  # no repeat marker, no start of a coded line
        return values.T.tobytes()
    if coding == "old":
        low, high = (width - 1) & 255, (width - 1) >> 8
        return bytes([9, 8, 7, 140, 1, 1, 1, low]) + (bytes([1, 1, 1, high]) if high else b"")
    parts = [bytes([2, 2, width >> 8, width & 255])]
    for channel in values:
        place = 0
        while place < width:
            count = int(min(rng.integers(1, 128), width - place))
            run = rng.random() < 0.4
            parts.append(
                bytes([128 + count, channel[place]])
                if run
                else bytes([count]) + channel[place : place + count].tobytes()
            )
            place += count
    return b"".join(parts)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("at_once", [1, 1 << 23])
def test_every_coding_against_the_definition(seed: int, at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rgbe, "_AT_ONCE", at_once)
    rng = np.random.default_rng(seed)
    width = int(rng.choice([8, 9, 50, 300, 700]))
    codings = rng.choice(["coded", "coded", "coded", "flat", "old"], size=70)
    data = b"".join(_line(rng, width, coding) for coding in codings)
    np.testing.assert_array_equal(read_scanlines(data, 70, width), _slow(data, 70, width))


@pytest.mark.parametrize("width", [1, 7, 32768])
def test_widths_that_are_never_coded(width: int) -> None:
    pixels = np.random.default_rng(0).integers(2, 256, size=(3, width, 4), dtype=np.uint8)
    np.testing.assert_array_equal(read_scanlines(pixels.tobytes(), 3, width), pixels.transpose(0, 2, 1))


def test_every_truncation_and_many_damages_are_noticed() -> None:
    """IndexError or ValueError, or as many pixels as announced; never another error."""
    rng = np.random.default_rng(1)
    data = b"".join(_line(rng, 20, coding) for coding in ("coded", "flat", "coded", "old", "coded"))
    for length in range(len(data)):
        with pytest.raises((IndexError, ValueError)):
            read_scanlines(data[:length], 5, 20)
    for _ in range(2000):
        damaged = bytearray(data)
        for place in rng.integers(0, len(data), size=rng.integers(1, 4)):
            damaged[place] = rng.integers(256)
        try:
            assert read_scanlines(bytes(damaged), 5, 20).shape == (5, 4, 20)
        except (IndexError, ValueError):
            pass


def test_values_by_hand() -> None:
    pixels = np.array([[[128, 1, 255, 9], [64, 0, 255, 9], [0, 0, 255, 9], [129, 1, 255, 0]]], np.uint8)
    expected = [[[1, 0.5, 0], [2.0**-135, 0, 0], [255 * 2.0**119] * 3, [0, 0, 0]]]
    np.testing.assert_array_equal(decode(pixels), np.array(expected, np.float32))


def test_encoding_is_undone() -> None:
    image = np.exp(np.random.default_rng(2).normal(scale=3, size=(40, 200, 3)))
    image[:, 50:150] = 3.0
    again = decode(read_scanlines(encode(image), 40, 200))
    assert (np.abs(again - image) <= image.max(axis=-1, keepdims=True) * 2.0**-8 * (1 + 1e-6)).all()


def test_progress_counts_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rgbe, "_AT_ONCE", 1)
    seen: list[tuple[int, int]] = []
    read_scanlines(encode(np.ones((70, 16, 3))), 70, 16, lambda done, total: seen.append((done, total)))
    assert seen == sorted(seen) and len(seen) > 3 and seen[-1] == (70, 70)


def test_large_pictures_are_read_in_arrays() -> None:
    """8 million pixels of noise, a quarter of the largest map in use, in a fraction of its six seconds."""
    width, lines = 4096, 2048
    literals = np.random.default_rng(3).integers(0, 256, size=(lines, 4 * width // 128, 129), dtype=np.uint8)
    literals[..., 0] = 128
    starts = np.tile(np.array([2, 2, width >> 8, width & 255], np.uint8), (lines, 1))
    data = np.concatenate([starts, literals.reshape(lines, -1)], axis=1).tobytes()
    start = time.process_time()
    pixels = read_scanlines(data, lines, width)
    assert time.process_time() - start < 1.5
    np.testing.assert_array_equal(pixels.reshape(lines, -1, 128), literals[..., 1:])
