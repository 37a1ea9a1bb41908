"""Panels with captions, side by side, written as PNG."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from gash_jax.files.atomic import whole_file

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


def write_png(path: str | Path, picture: Image.Image) -> None:
    """Write the picture whole or not at all."""
    with whole_file(path) as temporary:
        picture.save(temporary, format="PNG")
