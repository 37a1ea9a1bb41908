"""Radiance pictures: bytes by hand, all codings, all orientations, round trips, everything that can be broken."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gash_jax.formats.hdr import LightError, open_hdr, write_hdr
from tests.helpers.shared_data import shared_file

GREY = bytes([128, 128, 128, 129])  # 128 * 2^(129 - 136) = 1
ORANGE = bytes([200, 100, 50, 131])  # mantissas / 32
BLACK = bytes([9, 9, 9, 0])


def picture(pixels: bytes, axes: str = "-Y 1 +X 2", lines: str = "FORMAT=32-bit_rle_rgbe\n") -> bytes:
    return f"#?RADIANCE\n{lines}\n{axes}\n".encode() + pixels


def read(tmp_path: Path, data: bytes) -> np.ndarray:
    path = tmp_path / "map.hdr"
    path.write_bytes(data)
    return open_hdr(path).radiance


def test_flat_pixels_by_hand(tmp_path: Path) -> None:
    image = read(tmp_path, picture(GREY + ORANGE + BLACK, "-Y 1 +X 3"))
    assert image.dtype == np.float32
    np.testing.assert_array_equal(image, [[[1, 1, 1], [6.25, 3.125, 1.5625], [0, 0, 0]]])


def test_old_runs_repeat_the_pixel_before_them_and_carry(tmp_path: Path) -> None:
    line = GREY + bytes([1, 1, 1, 3]) + ORANGE + bytes([1, 1, 1, 2]) + bytes([1, 1, 1, 1])
    image = read(tmp_path, picture(line + GREY * 263, f"-Y 2 +X {1 + 3 + 1 + 2 + 256}"))
    np.testing.assert_array_equal(image[0, :, 1], [1.0] * 4 + [3.125] * 259)
    np.testing.assert_array_equal(image[1], 1.0)


def test_coded_channels_by_hand(tmp_path: Path) -> None:
    runs = bytes([2, 2, 0, 8]) + bytes([128 + 8, 128]) + bytes([3, 128, 64, 32, 128 + 5, 16])
    runs += bytes([8, *range(8)]) + bytes([128 + 4, 129, 128 + 4, 130])
    image = read(tmp_path, picture(runs, "-Y 1 +X 8"))
    scale = np.array([1.0] * 4 + [2.0] * 4) / 128
    np.testing.assert_array_equal(image[0, :, 0], 128 * scale)
    np.testing.assert_array_equal(image[0, :, 1], [128, 64, 32, 16, 16, 16, 16, 16] * scale)
    np.testing.assert_array_equal(image[0, :, 2], np.arange(8) * scale)


def test_codings_may_change_from_line_to_line(tmp_path: Path) -> None:
    coded = bytes([2, 2, 0, 8]) + b"".join(bytes([128 + 8, value]) for value in GREY)
    image = read(tmp_path, picture(GREY * 8 + coded + ORANGE + bytes([1, 1, 1, 7]) + coded, "-Y 4 +X 8"))
    np.testing.assert_array_equal(image[:, 5, 0], [1, 1, 6.25, 1])


@pytest.mark.parametrize(
    ("axes", "expected"),
    [
        ("-Y 2 +X 3", [[1, 2, 3], [4, 5, 6]]),
        ("+Y 2 +X 3", [[4, 5, 6], [1, 2, 3]]),
        ("-Y 2 -X 3", [[3, 2, 1], [6, 5, 4]]),
        ("+Y 2 -X 3", [[6, 5, 4], [3, 2, 1]]),
        ("+X 2 -Y 3", [[1, 4], [2, 5], [3, 6]]),
        ("-X 2 -Y 3", [[4, 1], [5, 2], [6, 3]]),
        ("+X 2 +Y 3", [[3, 6], [2, 5], [1, 4]]),
        ("-X 2 +Y 3", [[6, 3], [5, 2], [4, 1]]),
    ],
)
def test_orientations(tmp_path: Path, axes: str, expected: list[list[int]]) -> None:
    pixels = b"".join(bytes([16 * value, 0, 0, 132]) for value in range(1, 7))
    np.testing.assert_array_equal(read(tmp_path, picture(pixels, axes))[..., 0], expected)


def test_exposures_and_colour_corrections_are_divided_out(tmp_path: Path) -> None:
    lines = "SOFTWARE=x=y\nEXPOSURE=2.0\nEXPOSURE= 4\nCOLORCORR=1 2 0.5\nFORMAT=32-bit_rle_rgbe\n"
    image = read(tmp_path, picture(GREY * 2, lines=lines))
    np.testing.assert_array_equal(image[0, 0], [1 / 8, 1 / 16, 1 / 4])


@pytest.mark.parametrize("shape", [(1, 1), (3, 7), (2, 8), (5, 300)])
def test_what_was_written_is_read_to_half_a_step(tmp_path: Path, shape: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    image = np.exp(rng.normal(scale=4, size=(*shape, 3)))
    image[0, : shape[1] // 2] = 7.5  # runs
    write_hdr(tmp_path / "map.hdr", image)
    again = open_hdr(tmp_path / "map.hdr").radiance
    assert again.shape == image.shape
    assert (np.abs(again - image) <= image.max(axis=-1, keepdims=True) * 2.0**-8 * (1 + 1e-6)).all()
    write_hdr(tmp_path / "again.hdr", again)
    np.testing.assert_array_equal(open_hdr(tmp_path / "again.hdr").radiance, again)


def test_extremes_are_written(tmp_path: Path) -> None:
    values = np.array([0.0, 1e-45, 2.0**-126, 0.99999, 255.9999, 1.6e38])
    write_hdr(tmp_path / "map.hdr", np.repeat(values[None, :, None], 3, axis=2))
    np.testing.assert_allclose(
        open_hdr(tmp_path / "map.hdr").radiance[0, :, 0], np.where(values < 1e-40, 0, values), rtol=2.0**-8
    )


@settings(max_examples=40, deadline=None)
@given(st.integers(8, 400), st.integers(1, 300), st.integers(0, 10**6))
def test_run_length_coding_returns_every_line(
    tmp_path_factory: pytest.TempPathFactory, width: int, run: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    values = 2.0 ** rng.integers(-3, 3, size=width // run + 1)
    image = np.repeat(values, run)[:width][None, :, None] * np.ones(3)
    path = tmp_path_factory.mktemp("runs") / "map.hdr"
    write_hdr(path, image)
    np.testing.assert_array_equal(open_hdr(path).radiance, image)


def test_a_constant_map_is_small(tmp_path: Path) -> None:
    write_hdr(tmp_path / "map.hdr", np.ones((10, 1000, 3)))
    assert (tmp_path / "map.hdr").stat().st_size < 10 * (4 + 4 * 8 * 2) + 100


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a Radiance picture"),
        (b"\x76\x2f\x31\x01 exr", "convert it to .hdr"),
        (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n", "not a whole Radiance picture"),
        (b"#?RADIANCE\n\n-Y 1 +X 2", "not a whole Radiance picture"),
        (picture(GREY * 2, "-Y 1 +Y 2"), "not a whole Radiance picture"),
        (picture(GREY * 2, lines="FORMAT=32-bit_rle_xyze\n"), "only RGBE"),
        (picture(GREY * 2, lines="EXPOSURE=bright\n"), "not numbers"),
        (picture(GREY * 2, lines="COLORCORR=1 2\n"), "not numbers"),
        (picture(GREY * 2, lines="EXPOSURE=0\n"), "not finite"),
        (picture(GREY * 2, lines="EXPOSURE=nan\n"), "not finite"),
        (picture(b"", "-Y 0 +X 2"), "0 x 2 pixels"),
        (picture(GREY, "-Y 99999 +X 99999"), "99999 x 99999 pixels"),
        (picture(GREY), "truncated"),
        (picture(GREY * 2 + GREY, "-Y 2 +X 2"), "truncated"),
        (picture(bytes([1, 1, 1, 2])), "truncated"),
        (picture(GREY + bytes([1, 1, 1, 9])), "truncated"),
        (picture(bytes([2, 2, 0, 9]) + GREY * 20, "-Y 1 +X 8"), "truncated"),
        (picture(bytes([2, 2, 0, 8, 0, 0]), "-Y 1 +X 8"), "truncated"),
        (picture(bytes([2, 2, 0, 8, 128 + 9, 0]), "-Y 1 +X 8"), "truncated"),
        (picture(bytes([2, 2, 0, 8, 8, 1, 2, 3]), "-Y 1 +X 8"), "truncated"),
    ],
)
def test_broken_files_are_refused_in_one_line(tmp_path: Path, data: bytes, words: str) -> None:
    with pytest.raises(LightError, match=words) as error:
        read(tmp_path, data)
    assert "\n" not in str(error.value) and isinstance(error.value, ValueError)


def test_missing_files_and_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(LightError, match="no such file"):
        open_hdr(tmp_path / "none.hdr")
    with pytest.raises(LightError, match="is a folder"):
        open_hdr(tmp_path)


@pytest.mark.parametrize(
    "image",
    [
        np.ones((2, 2)),
        np.ones((2, 2, 4)),
        np.ones((0, 2, 3)),
        np.full((1, 1, 3), np.nan),
        -np.ones((1, 1, 3)),
        np.full((1, 1, 3), 2e38),
    ],
    ids=["no colours", "alpha", "empty", "nan", "negative", "beyond the format"],
)
def test_bad_images_are_not_written(tmp_path: Path, image: np.ndarray) -> None:
    with pytest.raises(LightError):
        write_hdr(tmp_path / "map.hdr", image)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "peak"), [("grace_256", 3504), ("venice_sunset_1k", 6496)])
def test_real_maps(name: str, peak: float) -> None:
    image = open_hdr(shared_file(f"hdr/{name}.hdr")).radiance
    assert image.shape[1] == 2 * image.shape[0]
    assert image.max() == pytest.approx(peak, abs=0.5)
