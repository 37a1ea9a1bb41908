"""OpenEXR pictures (.exr): linear radiance from a file; the only file that imports OpenEXR.

Of a file with several parts the first flat (not deep) one with colour is read. Of its channels (half, float or uint):
R, G, B without a layer name, else Y alone as grey, else the only layer with R, G, B (`layer.R`; letters of either
case). Alpha is left out: colours are premultiplied by it (OpenEXR, "Technical Introduction"), so they are the radiance
that arrives. The display window is the picture: of the data window what lies outside is cropped, what is missing is
black. Row 0 is up whatever the line order. Colours are those of `chromaticities` (Rec. 709 without it) and converted to
Rec. 709; values are in the file's own unit, like those of .hdr maps: `whiteLuminance` is not applied. The attribute
`envmap` = latlong defines other directions than those of everything else here, and files differ in whether they mean
it: it is noted, the picture is not turned.
"""

import contextlib
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import OpenEXR
from jaxtyping import Shaped

from gash_jax.formats.picture import FORMATS, MOST_PIXELS, LightError, Picture, read_bytes, without_negatives
from gash_jax.formats.primaries import in_rec_709

_MAGIC = b"\x76\x2f\x31\x01"
# the C++ exceptions as Python sees them, and names in a damaged header that are not UTF-8
_FAILURES = (RuntimeError, ValueError, LookupError, ArithmeticError, MemoryError)
_ENVMAP_NOTE = (
    "by its attribute envmap = latlong the centre of the picture is +z and its left quarter +x; it is read like every "
    "map here, centre -z: turn the light by 180 degrees about y if the file means it"
)
_DEEP = (OpenEXR.deepscanline, OpenEXR.deeptile)


def open_exr(path: str | Path) -> Picture:
    """An OpenEXR picture with notes on its colours, its negative values and its directions.

    Raises LightError if the file is missing, a folder, of another format, truncated, a cube map, without one clear
    colour, or holds radiance that is not finite or negative in more than one hundredth.
    """
    path = Path(path)
    if read_bytes(path, len(_MAGIC)) != _MAGIC:
        raise LightError(f"{path} is not an OpenEXR picture: readable are {FORMATS}, convert it to .hdr or .exr")
    try:
        return _read(path)
    except LightError:
        raise
    except (*_FAILURES, TypeError, AttributeError):  # attributes of another type than their names have
        raise LightError(f"{path} is damaged: its header makes no sense, fetch it again") from None


def _read(path: Path) -> Picture:
    part, names = _colour_part(_open(path, header_only=True), path)
    if any((part.channels[name].xSampling, part.channels[name].ySampling) != (1, 1) for name in names):
        raise LightError(f"{path} has subsampled colour channels: save it as RGB at full resolution")
    if part.header.get("envmap") == OpenEXR.ENVMAP_CUBE:
        raise LightError(f"{path} is a cube map: convert it to a latitude-longitude map")
    # a part that breaks is left out by the library
    whole = [p for p in _open(path, header_only=False) if p.number == part.number]
    if not whole:
        raise LightError(f"{path} is truncated or damaged: its pixels end or break early, fetch it again")
    pixels = np.stack([whole[0].channels[name].pixels for name in names], axis=-1, dtype=np.float32)
    image, notes = without_negatives(_in_display_window(pixels, part.header, path), path)
    if len(set(names)) == 3 and "chromaticities" in part.header:  # grey has no colour to convert
        image, note = in_rec_709(image, np.array(part.header["chromaticities"], dtype=np.float64).reshape(8))
        notes += note
    if part.header.get("envmap") == OpenEXR.ENVMAP_LATLONG:
        return Picture(image, (*notes, _ENVMAP_NOTE), "latlong")
    return Picture(image, notes)


class _Part(NamedTuple):
    number: int  # in the file
    header: dict[str, Any]
    channels: dict[str, Any]  # OpenEXR.Channel by name, without pixels if only the header was read


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Keep off the terminal what the library prints to both streams, from Python and from C, before it fails."""
    with open(os.devnull, "w") as null, contextlib.redirect_stdout(null):
        kept = os.dup(2)
        os.dup2(null.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def _open(path: Path, header_only: bool) -> list[_Part]:
    try:
        with _silence():
            parts = OpenEXR.File(str(path), separate_channels=True, header_only=header_only).parts
            channels = [part.header["channels"] if header_only else part.channels.values() for part in parts]
            named = [{channel.name: channel for channel in own} for own in channels]
        return [_Part(part.part_index, part.header, own) for part, own in zip(parts, named, strict=True)]
    except _FAILURES:
        raise LightError(f"{path} is truncated or damaged: OpenEXR cannot read it, fetch it again") from None


def _colour_part(parts: list[_Part], path: Path) -> tuple[_Part, tuple[str, str, str]]:
    """The first flat part with colour and the names of its colour channels, once all sizes are known to be sane."""
    for part in parts:
        for window in ("dataWindow", "displayWindow"):
            height, width = _shape(part.header[window])
            if not (height > 0 and width > 0 and height * width <= MOST_PIXELS):
                raise LightError(f"{path} has {height} x {width} pixels: use a map with 1 to {MOST_PIXELS}")
    flat = [part for part in parts if part.header.get("type") not in _DEEP]
    for part in flat:
        names = _colour_names(part.channels, path)
        if names:
            return part, names
    if len(flat) < len(parts):
        raise LightError(f"{path} has no colour outside its deep data: flatten it to one RGB picture")
    found = ", ".join(sorted({name for part in flat for name in part.channels}))
    raise LightError(f"{path} has no colour channels (R, G, B or Y), only {found}: save the map as RGB")


def _colour_names(names: Iterable[str], path: Path) -> tuple[str, str, str] | None:
    """Channels to read as red, green, blue; None without colour."""
    layers: dict[str, dict[str, str]] = {}
    for name in names:
        layer, _, letter = name.rpartition(".")
        layers.setdefault(layer, {})[letter.upper()] = name
    plain = layers.get("", {})
    coloured = {layer: (own["R"], own["G"], own["B"]) for layer, own in layers.items() if own.keys() >= set("RGB")}
    if "" in coloured:
        return coloured[""]
    if "Y" in plain and plain.keys() & {"RY", "BY"}:
        raise LightError(f"{path} is coded as luminance and chroma: save it as RGB")
    if "Y" in plain and not plain.keys() & {"X", "Z"}:  # X, Y, Z are a vector or CIE colour, not grey
        return plain["Y"], plain["Y"], plain["Y"]
    if len(coloured) > 1:
        raise LightError(f"{path} has colour in the layers {', '.join(sorted(coloured))}: save the map's layer alone")
    return next(iter(coloured.values()), None)


def _shape(window: tuple[np.ndarray, np.ndarray]) -> tuple[int, int]:
    """Height and width of a window, whose corners (x, y) are both inside."""
    (left, top), (right, bottom) = (corner.tolist() for corner in window)
    return bottom - top + 1, right - left + 1


def _in_display_window(
    image: Shaped[np.ndarray, "_ _ 3"], header: dict[str, Any], path: Path
) -> Shaped[np.ndarray, "h w 3"]:
    data, display = header["dataWindow"], header["displayWindow"]
    height, width = _shape(display)
    left, top = (int(a) - int(b) for a, b in zip(data[0], display[0], strict=True))
    rows, columns = (
        slice(max(start, 0), min(start + size, limit))
        for start, size, limit in zip((top, left), image.shape, (height, width), strict=False)
    )
    if rows.start >= rows.stop or columns.start >= columns.stop:
        raise LightError(f"{path} has all its pixels outside its display window: save it without windows")
    if image.shape[:2] == (height, width) and (left, top) == (0, 0):
        return image
    whole = np.zeros((height, width, 3), image.dtype)
    whole[rows, columns] = image[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    return whole
