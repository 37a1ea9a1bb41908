"""Panels with captions side by side, and colour bars under those that show a difference; written as PNG or JPEG."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from gash_jax.files.atomic import FileError, whole_file

_JPEG = ("JPEG", {"quality": 92, "subsampling": 0})  # captions stay sharp
FORMATS: dict[str, tuple[str, dict[str, int]]] = {".png": ("PNG", {}), ".jpg": _JPEG, ".jpeg": _JPEG}
GAP, INK, PAPER = 12, (20, 20, 20), (250, 250, 250)
TEXT, LEAST_TEXT = 17, 8  # pixels; text that is too wide for its panel shrinks as far as the second
SPACING = 2  # pixels between lines
BAR = 12  # height of a colour bar without its words
BESIDE = 200.0  # grey beside the mesh where differences are drawn, darker than the white of no difference


class Panel(NamedTuple):
    """A picture and its caption; of a difference also where its colours are full, which gives it a colour bar."""

    caption: str  # up to two lines
    pixels: UInt8[np.ndarray, "h w 3"]
    limit: float | None = None


def signed_colors(
    values: Float[np.ndarray, "h w"], limit: float, coverage: Float[np.ndarray, "h w"] | None = None
) -> UInt8[np.ndarray, "h w 3"]:
    """Blue below zero, white at zero, red above, saturated at +-limit; with `coverage` grey beside the mesh."""
    x = np.clip(values / limit, -1.0, 1.0)[..., None]
    red, blue, white = np.array([178.0, 24, 43]), np.array([33.0, 102, 172]), np.array([247.0, 247, 247])
    colors = np.where(x > 0, white + x * (red - white), white - x * (blue - white))
    if coverage is not None:
        colors = BESIDE + coverage[..., None] * (colors - BESIDE)
    return np.round(colors).astype(np.uint8)


def color_bar(width: int, limit: float) -> Image.Image:
    """The colours of `signed_colors` from -limit to limit, with their meaning in words below."""
    words = (f"-{limit:g} too dark", "0", f"+{limit:g} too bright")
    font = _font(["   ".join(words)], width)
    bar = Image.new("RGB", (width, BAR + 2 + _height(1, font)), PAPER)
    bar.paste(Image.fromarray(signed_colors(np.tile(np.linspace(-limit, limit, width), (BAR, 1)), limit)))
    draw = ImageDraw.Draw(bar)
    for text, share, anchor in zip(words, (0.0, 0.5, 1.0), ("la", "ma", "ra"), strict=True):
        draw.text((share * (width - 1), BAR + 2), text, fill=INK, font=font, anchor=anchor)
    return bar


def montage(
    panels: Sequence[Panel | tuple[str, UInt8[np.ndarray, "h w 3"]]], columns: int | None = None
) -> Image.Image:
    """Panels of one size, each with its caption above it, and its colour bar below where it has a limit."""
    shown = [panel if isinstance(panel, Panel) else Panel(*panel) for panel in panels]
    columns = columns or len(shown)
    height, width = shown[0].pixels.shape[:2]
    font = _font([line for panel in shown for line in panel.caption.splitlines()], width)
    caption = _height(max(panel.caption.count("\n") + 1 for panel in shown), font)
    bars = {panel.limit: color_bar(width, panel.limit) for panel in shown if panel.limit is not None}
    below = max((bar.height + GAP for bar in bars.values()), default=0)
    pitch = caption + height + below + GAP
    size = (columns * (width + GAP) + GAP, -(-len(shown) // columns) * pitch + GAP)
    sheet = Image.new("RGB", size, PAPER)
    draw = ImageDraw.Draw(sheet)
    for index, panel in enumerate(shown):
        x, y = GAP + index % columns * (width + GAP), GAP + index // columns * pitch
        draw.multiline_text((x, y), panel.caption, fill=INK, font=font, spacing=SPACING)
        sheet.paste(Image.fromarray(panel.pixels), (x, y + caption))
        if panel.limit is not None:
            sheet.paste(bars[panel.limit], (x, y + caption + height + GAP // 2))
    return sheet


def _font(lines: Sequence[str], width: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """The largest font, up to TEXT, in which every line is at most so wide."""
    for size in range(TEXT, LEAST_TEXT, -1):
        font = ImageFont.load_default(size)
        if max((font.getlength(line) for line in lines), default=0) <= width:
            return font
    return ImageFont.load_default(LEAST_TEXT)


def _height(lines: int, font: ImageFont.FreeTypeFont | ImageFont.ImageFont) -> int:
    """Pixels that so many lines take, with a little room below."""
    return int(lines * (font.getbbox("Ag")[3] + SPACING) + 4)


def check_picture(path: str | Path) -> None:
    """Raise FileError for a name that says no format we write."""
    if Path(path).suffix.lower() not in FORMATS:
        raise FileError(f"cannot write {path}: pictures are written as {', '.join(FORMATS)}, choose such a name")


def write_picture(path: str | Path, picture: Image.Image) -> None:
    """Write the picture in the format of its name, whole or not at all. Raises FileError for another name."""
    check_picture(path)
    kind, options = FORMATS[Path(path).suffix.lower()]
    with whole_file(path) as temporary:
        picture.save(temporary, format=kind, **options)
