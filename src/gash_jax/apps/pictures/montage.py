"""Panels with captions, side by side, written as PNG or JPEG."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from gash_jax.files.atomic import FileError, whole_file

_JPEG = ("JPEG", {"quality": 92, "subsampling": 0})  # captions stay sharp
FORMATS: dict[str, tuple[str, dict[str, int]]] = {".png": ("PNG", {}), ".jpg": _JPEG, ".jpeg": _JPEG}
CAPTION, GAP, INK, PAPER = 52, 6, (20, 20, 20), (250, 250, 250)


def signed_colors(values: Float[np.ndarray, "h w"], limit: float) -> UInt8[np.ndarray, "h w 3"]:
    """Blue below zero, white at zero, red above; saturated at +-limit."""
    x = np.clip(values / limit, -1.0, 1.0)[..., None]
    red, blue, white = np.array([178.0, 24, 43]), np.array([33.0, 102, 172]), np.array([247.0, 247, 247])
    return np.round(np.where(x > 0, white + x * (red - white), white - x * (blue - white))).astype(np.uint8)


def montage(panels: list[tuple[str, UInt8[np.ndarray, "h w 3"]]], columns: int | None = None) -> Image.Image:
    """Panels of one size with their captions (up to two lines) above them."""
    columns = columns or len(panels)
    height, width = panels[0][1].shape[:2]
    rows = -(-len(panels) // columns)
    sheet = Image.new("RGB", (columns * (width + GAP) + GAP, rows * (height + CAPTION + GAP) + GAP), PAPER)
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(17)
    for index, (caption, pixels) in enumerate(panels):
        x = GAP + index % columns * (width + GAP)
        y = GAP + index // columns * (height + CAPTION + GAP)
        draw.multiline_text((x + 4, y + 2), caption, fill=INK, font=font, spacing=2)
        sheet.paste(Image.fromarray(pixels), (x, y + CAPTION))
    return sheet


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
