"""The door for environment maps: what readers note, what they refuse, and that damage is never another error."""

import shutil
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.maps import read_map
from gash_jax.formats.picture import LightError, without_negatives
from gash_jax.light.environment import load_light
from tests.helpers.shared_data import shared_case

GREY = bytes([128, 128, 128, 129])  # 1
ORANGE = bytes([128, 64, 32, 129])  # 1, 0.5, 0.25
AP0 = (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.077, 0.32168, 0.33767)
HERE = Path("map.exr")


def _hdr(path: Path, lines: str = "", end: str = "\n", magic: str = "#?RADIANCE", pixel: bytes = ORANGE) -> Path:
    head = [magic, *lines.split("\n"), "FORMAT=32-bit_rle_rgbe", "", "-Y 4 +X 8", ""]
    path.write_bytes(end.join(line for k, line in enumerate(head) if line or k > 1).encode() + pixel * 32)
    return path


def _exr(path: Path, image: np.ndarray, **header) -> Path:
    channels = {"RGB": image.astype(np.float32)} if image.ndim == 3 else {"Y": image.astype(np.float32)}
    OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels).write(str(path))
    return path


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("magic", ["#?RADIANCE", "#?Radiance", "#?rgbe", "\ufeff#?RADIANCE", "#?RADIANCE v2"])
@pytest.mark.parametrize("first", [10, 13])
def test_line_ends_marks_and_letters_of_hdr_headers(tmp_path: Path, end: str, magic: str, first: int) -> None:
    """The first byte of the pixels is one of a line end."""
    pixel = bytes([first, 20, 40, 129])
    picture = read_map(_hdr(tmp_path / "map.hdr", "EXPOSURE=2", end, magic, pixel))
    np.testing.assert_array_equal(picture.radiance[0, 0], np.array([first, 20, 40]) / 256)
    assert picture.radiance.shape == (4, 8, 3) and picture.notes == ()


def test_primaries_of_hdr_headers(tmp_path: Path) -> None:
    """ACES AP0 is converted and noted; those of Rec. 709 are not touched; numbers that are none are refused."""
    found = read_map(_hdr(tmp_path / "a.hdr", f"PRIMARIES= {' '.join(map(str, AP0))}"))
    np.testing.assert_allclose(found.radiance[2, 3], [1.86, 0.386, 0.2], atol=3e-3)
    assert "converted to Rec. 709" in found.notes[0]
    plain = read_map(_hdr(tmp_path / "b.hdr", "PRIMARIES=0.640 0.330 0.300 0.600 0.150 0.060 0.3127 0.3290"))
    np.testing.assert_array_equal(plain.radiance[2, 3], [1, 0.5, 0.25])
    assert plain.notes == ()
    for bad in ("1 2 3", "red green blue white x y z w", "1 2 3 4 5 6 7 8 9"):
        with pytest.raises(LightError, match="header line that is not numbers"):
            read_map(_hdr(tmp_path / "c.hdr", f"PRIMARIES={bad}"))
    odd = read_map(_hdr(tmp_path / "d.hdr", "PRIMARIES=0 0 0 0 0 0 0 0"))
    assert "no colour space" in odd.notes[0]


def test_chromaticities_of_exr_pictures(tmp_path: Path) -> None:
    image = np.full((4, 8, 3), [1, 0.5, 0.25])
    found = read_map(_exr(tmp_path / "a.exr", image, chromaticities=AP0))
    np.testing.assert_allclose(found.radiance[1, 5], [1.86, 0.386, 0.2], atol=3e-3)
    assert "converted to Rec. 709" in found.notes[0]
    grey = read_map(_exr(tmp_path / "b.exr", image[..., 1], chromaticities=AP0))
    np.testing.assert_array_equal(grey.radiance, 0.5)
    assert grey.notes == ()
    white = read_map(_exr(tmp_path / "c.exr", np.ones((4, 8, 3)), chromaticities=AP0))
    np.testing.assert_allclose(white.radiance, 1.0, atol=1e-6)


def test_notes_reach_the_metadata_of_the_light(tmp_path: Path) -> None:
    image = np.full((4, 8, 3), [1, 0.5, 0.25])
    image[2, 2, 0] = -1e-3
    light = load_light(_exr(tmp_path / "a.exr", image, chromaticities=AP0))
    assert [note.split()[0] for note in light.metadata["notes"]] == ["1", "colours"]
    np.testing.assert_allclose(light.coefficients[0] / (2 * np.sqrt(np.pi)), [1.86, 0.386, 0.2], rtol=0.1)
    assert load_light(_hdr(tmp_path / "a.hdr")).metadata["notes"] == []


def test_tiny_negatives_are_read_as_0_up_to_a_hundredth() -> None:
    image = np.ones((10, 10, 3), np.float32)
    image[3, 4] = [-1, -0.5, 1]
    found, notes = without_negatives(image.copy(), HERE)
    np.testing.assert_array_equal(found[3, 4], [0, 0, 1])
    assert found.sum() == 298 and notes == ("2 negative values, 5.0e-03 of the light: read as 0",)
    image[0, 0, 0] = -1.49  # 2.99 of 297
    with pytest.raises(LightError, match=r"negative \(2 pixels, the first in row 0, column 0\): set it to 0"):
        without_negatives(image.copy(), HERE)
    image[0, 0, 0] = -1.46  # 2.96
    assert without_negatives(image.copy(), HERE)[0].min() == 0
    untouched, none = without_negatives(np.zeros((2, 2, 3), np.float32), HERE)
    assert none == () and not untouched.any()
    for dark in (np.full((2, 2, 3), -1e-9, np.float32), -np.eye(3, dtype=np.float32)[None]):
        with pytest.raises(LightError, match="negative"):
            without_negatives(dark, HERE)


def test_negative_exposures_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LightError, match="negative"):
        read_map(_hdr(tmp_path / "map.hdr", "EXPOSURE=-1"))


def test_wide_text_is_refused_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "map.hdr").write_bytes("#?RADIANCE\n\n-Y 1 +X 1\n".encode("utf-16"))
    with pytest.raises(LightError, match="UTF-16"):
        read_map(tmp_path / "map.hdr")


@pytest.mark.parametrize("kind", ["rle.hdr", "flat.hdr", "zip.exr", "none.exr", "piz.exr"])
def test_damaged_bytes_never_end_in_another_error(tmp_path: Path, kind: str, capfd: pytest.CaptureFixture) -> None:
    """Cut anywhere, or a few bytes overwritten: a picture or one line, and nothing printed."""
    rng = np.random.default_rng(sum(kind.encode()))
    image = rng.random((6, 12, 3)).astype(np.float32)
    path = tmp_path / f"whole{Path(kind).suffix}"
    if kind == "rle.hdr":
        write_hdr(path, np.repeat(image, 3, axis=1))
    elif kind == "flat.hdr":
        _hdr(path, "EXPOSURE=2\nCOLORCORR=1 2 3\nPRIMARIES=0.7 0.3 0.2 0.7 0.1 0.1 0.3 0.3")
    else:
        coding = {"zip": OpenEXR.ZIP_COMPRESSION, "none": OpenEXR.NO_COMPRESSION, "piz": OpenEXR.PIZ_COMPRESSION}
        _exr(path, image, compression=coding[kind.split(".")[0]], chromaticities=AP0, envmap=OpenEXR.ENVMAP_LATLONG)
    data, damaged_path = path.read_bytes(), path.with_name(f"damaged{path.suffix}")
    refused = 0
    for trial in range(250):
        damaged = bytearray(data)
        for place in rng.integers(0, len(data), size=rng.integers(1, 5)):
            damaged[place] = rng.integers(256)
        damaged_path.write_bytes(damaged[: rng.integers(len(data))] if trial % 3 == 0 else damaged)
        try:
            assert np.isfinite(read_map(damaged_path).radiance).all()
        except LightError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 80
    assert capfd.readouterr() == ("", "")


def test_other_formats_folders_and_nothing(tmp_path: Path) -> None:
    (tmp_path / "map.tif").write_bytes(b"II*\0")
    for name, words in (
        ("map.tif", "no known light format"),
        ("none.hdr", "no such file"),
        ("none.exr", "no such file"),
    ):
        with pytest.raises(LightError, match=words):
            read_map(tmp_path / name)
    shutil.rmtree(tmp_path / "map.pic", ignore_errors=True)
    (tmp_path / "map.pic").mkdir()
    with pytest.raises(LightError, match="is a folder"):
        read_map(tmp_path / "map.pic")


def test_the_aces_case() -> None:
    picture = read_map(shared_case("aces.exr"))
    np.testing.assert_allclose(picture.radiance, np.broadcast_to([1.86, 0.386, 0.2], picture.radiance.shape), atol=3e-3)
    assert "converted to Rec. 709" in picture.notes[0]


def test_the_tiny_negative_case() -> None:
    picture = read_map(shared_case("tiny_negative.exr"))
    assert picture.radiance.min() == 0 and picture.notes == ("1 negative value, 2.6e-10 of the light: read as 0",)


def test_the_case_of_other_line_ends() -> None:
    picture = read_map(shared_case("crlf.hdr"))
    np.testing.assert_array_equal(picture.radiance, np.broadcast_to([1, 0.5, 0.25], (8, 16, 3)))
