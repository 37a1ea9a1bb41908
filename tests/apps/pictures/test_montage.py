"""Panels, captions, colours, files."""

from pathlib import Path

import numpy as np
from PIL import Image

from gash_jax.apps.pictures.montage import CAPTION, GAP, montage, signed_colors, write_png


def test_colours_tell_the_sign() -> None:
    colors = signed_colors(np.array([[-9.0, -0.1, 0.0, 0.1, 9.0]]), 0.2)[0]
    assert colors[2].tolist() == [247, 247, 247]
    assert colors[0, 2] > colors[0, 0] and colors[4, 0] > colors[4, 2]  # blue below, red above
    assert colors[0].tolist() == [33, 102, 172] and colors[4].tolist() == [178, 24, 43]
    assert colors[1].min() > colors[0].min()


def test_panels_lie_where_their_captions_are(tmp_path: Path) -> None:
    panels = [(f"panel {i}\nsecond line", np.full((20, 30, 3), 50 * i, np.uint8)) for i in range(3)]
    write_png(tmp_path / "m.png", montage(panels, columns=2))
    with Image.open(tmp_path / "m.png") as picture:
        sheet = np.asarray(picture)
    assert sheet.shape == (2 * (20 + CAPTION + GAP) + GAP, 2 * (30 + GAP) + GAP, 3)
    for index, (x, y) in enumerate([(0, 0), (1, 0), (0, 1)]):
        top = GAP + y * (20 + CAPTION + GAP) + CAPTION
        block = sheet[top : top + 20, GAP + x * (30 + GAP) : GAP + x * (30 + GAP) + 30]
        assert (block == 50 * index).all()
    assert [p.name for p in tmp_path.iterdir()] == ["m.png"]
