"""Panels, captions, colours, files."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gash_jax.apps.pictures.montage import CAPTION, GAP, montage, signed_colors, write_picture
from gash_jax.files.atomic import FileError


def test_colours_tell_the_sign() -> None:
    colors = signed_colors(np.array([[-9.0, -0.1, 0.0, 0.1, 9.0]]), 0.2)[0]
    assert colors[2].tolist() == [247, 247, 247]
    assert colors[0, 2] > colors[0, 0] and colors[4, 0] > colors[4, 2]  # blue below, red above
    assert colors[0].tolist() == [33, 102, 172] and colors[4].tolist() == [178, 24, 43]
    assert colors[1].min() > colors[0].min()


def test_panels_lie_where_their_captions_are(tmp_path: Path) -> None:
    panels = [(f"panel {i}\nsecond line", np.full((20, 30, 3), 50 * i, np.uint8)) for i in range(3)]
    write_picture(tmp_path / "m.png", montage(panels, columns=2))
    with Image.open(tmp_path / "m.png") as picture:
        sheet = np.asarray(picture)
    assert sheet.shape == (2 * (20 + CAPTION + GAP) + GAP, 2 * (30 + GAP) + GAP, 3)
    for index, (x, y) in enumerate([(0, 0), (1, 0), (0, 1)]):
        top = GAP + y * (20 + CAPTION + GAP) + CAPTION
        block = sheet[top : top + 20, GAP + x * (30 + GAP) : GAP + x * (30 + GAP) + 30]
        assert (block == 50 * index).all()
    assert [p.name for p in tmp_path.iterdir()] == ["m.png"]


def test_the_name_of_a_picture_says_its_format(tmp_path: Path) -> None:
    ramp = np.repeat(np.arange(0, 240, 4, dtype=np.uint8)[None, :, None], 3, axis=2).repeat(40, axis=0)
    sheet = montage([("", ramp)])
    for name, kind in (("a.png", "PNG"), ("a.jpg", "JPEG"), ("a.JPEG", "JPEG")):
        write_picture(tmp_path / name, sheet)
        with Image.open(tmp_path / name) as picture:
            assert picture.format == kind
            off = np.asarray(picture, float) - np.asarray(sheet, float)
        assert np.abs(off).max() <= (0 if kind == "PNG" else 12) and np.sqrt(np.mean(off**2)) < 1.5
    for name in ("a.gif", "a", "a.npz"):
        with pytest.raises(FileError, match="written as .png, .jpg, .jpeg, choose such a name"):
            write_picture(tmp_path / name, sheet)
        assert not (tmp_path / name).exists()
