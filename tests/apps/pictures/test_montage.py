"""Panels, captions, colours, files."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gash_jax.apps.pictures.montage import BAR, GAP, Panel, color_bar, montage, signed_colors, write_picture
from gash_jax.files.atomic import FileError


def test_colours_tell_the_sign() -> None:
    colors = signed_colors(np.array([[-9.0, -0.1, 0.0, 0.1, 9.0]]), 0.2)[0]
    assert colors[2].tolist() == [247, 247, 247]
    assert colors[0, 2] > colors[0, 0] and colors[4, 0] > colors[4, 2]  # blue below, red above
    assert colors[0].tolist() == [33, 102, 172] and colors[4].tolist() == [178, 24, 43]
    assert colors[1].min() > colors[0].min()


def test_the_mesh_stands_out_where_nothing_differs() -> None:
    colors = signed_colors(np.zeros((1, 2)), 0.2, np.array([[1.0, 0.0]]))[0]
    assert colors[0].tolist() == [247] * 3 and colors[1].tolist() == [200] * 3


def test_a_colour_bar_runs_from_too_dark_to_too_bright() -> None:
    bar = np.asarray(color_bar(201, 0.2))
    values = np.linspace(-0.2, 0.2, 201)[None]
    assert (bar[:BAR] == signed_colors(values, 0.2)).all()
    assert [(bar[BAR + 2 :, part] < 128).any() for part in (slice(60), slice(95, 105), slice(140, 201))] == [True] * 3


COLORS = np.array([[200, 100, 0], [0, 200, 100], [100, 0, 200]], np.uint8)  # that no text has


def _place(sheet: np.ndarray, color: np.ndarray) -> list[slice]:
    """Where the pixels of one colour are: rows, columns."""
    found = np.argwhere((sheet == color).all(-1))
    return [slice(low, high + 1) for low, high in zip(found.min(0), found.max(0), strict=True)]


def test_panels_lie_where_their_captions_are(tmp_path: Path) -> None:
    panels = [(f"panel {i}\nsecond line", np.tile(color, (20, 130, 1))) for i, color in enumerate(COLORS)]
    write_picture(tmp_path / "m.png", montage(panels, columns=2))
    with Image.open(tmp_path / "m.png") as picture:
        sheet = np.asarray(picture)
    assert sheet.shape[1] == 2 * (130 + GAP) + GAP
    places = [_place(sheet, color) for color in COLORS]
    assert all(rows.stop - rows.start == 20 and columns.stop - columns.start == 130 for rows, columns in places)
    assert [columns.start for _, columns in places] == [GAP, 130 + 2 * GAP, GAP]
    assert places[0][0] == places[1][0] and places[2][0].start > places[0][0].stop
    for rows, columns in places:  # ink above every panel, nothing between ink and picture but paper
        assert (sheet[rows.start - 40 : rows.start, columns] < 128).any()
        assert (sheet[rows.start - 2 : rows.start, columns] == 250).all()
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


def test_a_bar_stands_under_a_difference_and_nowhere_else() -> None:
    pixels = np.tile(COLORS[0], (20, 150, 1))
    sheet = np.asarray(montage([Panel("a", pixels), Panel("b", pixels, 0.3)]))
    bottom = _place(sheet, COLORS[0])[0].stop
    assert (sheet[bottom:, : 150 + GAP] == 250).all()
    assert (sheet[bottom + GAP // 2, 150 + 2 * GAP : 300 + 2 * GAP] == np.asarray(color_bar(150, 0.3))[0]).all()


def test_long_captions_stay_within_their_panels() -> None:
    """No ink between two panels, where a caption that is too long would run into the next one."""
    panels = [("a caption that is wide", np.full((20, 110, 3), 60, np.uint8))] * 2
    sheet = np.asarray(montage(panels))
    assert (sheet[:, 110 + GAP : 110 + 2 * GAP] == 250).all() and (sheet < 40).any()
