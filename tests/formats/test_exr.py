"""OpenEXR pictures: every pixel type, coding, window, layer and part, and everything that can be broken."""

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from gash_jax.apps.cli import gash
from gash_jax.formats.exr import open_exr
from gash_jax.formats.hdr import LightError, open_hdr, write_hdr
from gash_jax.formats.meshes import save_mesh
from gash_jax.light.environment import load_light
from gash_jax.light.studio import studio_light
from gash_jax.shapes.primitives import icosphere
from tests.helpers.shared_data import shared_file

LOSSLESS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ")
LOSSY = ("PXR24", "B44", "B44A", "DWAA", "DWAB")
RNG = np.random.default_rng(0)
# smooth, as lossy codings are made for pictures
IMAGE = (8 + np.cumsum(np.cumsum(RNG.normal(size=(33, 70, 3)), axis=0), axis=1) / 100).astype(np.float32)
# a pixel is its place: 10 * row + column, in three scales
PLACES = (10 * np.arange(4)[:, None, None] + np.arange(8)[:, None] + [0, 100, 200]).astype(np.float32)


def write(path: Path, channels: dict[str, Any], compression: str = "ZIP", **header: Any) -> Path:
    coding = getattr(OpenEXR, f"{compression}_COMPRESSION")
    header = {"type": OpenEXR.scanlineimage, "compression": coding, **header}
    OpenEXR.File(header, channels).write(str(path))
    return path


def rgb(image: np.ndarray, names: str = "RGB", prefix: str = "") -> dict[str, np.ndarray]:
    return {prefix + name: np.ascontiguousarray(image[..., i]) for i, name in enumerate(names)}


def part(name: str, channels: dict[str, Any], **header: Any) -> Any:
    return OpenEXR.Part({"type": OpenEXR.scanlineimage, **header}, channels, name)


def window(left: int, top: int, right: int, bottom: int) -> tuple[np.ndarray, np.ndarray]:
    return np.array([left, top], np.int32), np.array([right, bottom], np.int32)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.uint32])
@pytest.mark.parametrize("compression", LOSSLESS)
@pytest.mark.parametrize("tiled", [False, True])
def test_lossless_codings_return_every_value(tmp_path: Path, compression: str, dtype: type, tiled: bool) -> None:
    header = {"type": OpenEXR.tiledimage, "tiles": OpenEXR.TileDescription()} if tiled else {}
    image = IMAGE.astype(dtype)
    found = open_exr(write(tmp_path / "map.exr", rgb(image), compression, **header)).radiance
    assert found.dtype == np.float32 and found.shape == (33, 70, 3)
    np.testing.assert_array_equal(found, image.astype(np.float32))


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("compression", LOSSY)
def test_lossy_codings_return_nearly_every_value(tmp_path: Path, compression: str, dtype: type) -> None:
    found = open_exr(write(tmp_path / "map.exr", rgb(IMAGE.astype(dtype)), compression)).radiance
    np.testing.assert_allclose(found, IMAGE, rtol=0.02)  # B44 keeps 6 bits of a difference inside 4 x 4 pixels


def test_types_may_differ_between_channels(tmp_path: Path) -> None:
    channels = rgb(PLACES)
    channels |= {"R": channels["R"].astype(np.float16), "B": channels["B"].astype(np.uint32)}
    np.testing.assert_array_equal(open_exr(write(tmp_path / "map.exr", channels)).radiance, PLACES)


def test_the_largest_values_of_each_type(tmp_path: Path) -> None:
    for dtype, largest in ((np.float16, 65504.0), (np.float32, 3e38), (np.uint32, 4294967295)):
        image = np.full((1, 1, 3), largest, dtype)
        assert (open_exr(write(tmp_path / "map.exr", rgb(image))).radiance == np.float32(largest)).all()


@pytest.mark.parametrize("order", [OpenEXR.INCREASING_Y, OpenEXR.DECREASING_Y])
def test_row_0_is_up_whatever_the_line_order(tmp_path: Path, order: Any) -> None:
    path = write(tmp_path / "map.exr", rgb(PLACES), "NO", lineOrder=order)
    np.testing.assert_array_equal(open_exr(path).radiance[:, :, 0], PLACES[:, :, 0])
    up = np.zeros((16, 32, 3), np.float32)
    up[0] = 1.0
    write(tmp_path / "up.exr", rgb(up), lineOrder=order)
    coefficients = load_light(tmp_path / "up.exr", 2).coefficients
    assert (coefficients[1] > 0).all()  # k = 1 is y, and +y is up
    np.testing.assert_allclose(coefficients[2:], 0.0, atol=1e-6)


def test_the_hdr_route_gives_the_same_image_and_the_same_light(tmp_path: Path) -> None:
    image = studio_light(32).astype(np.float32)
    write_hdr(tmp_path / "map.hdr", image)
    write(tmp_path / "map.exr", rgb(image))
    exr, hdr = open_exr(tmp_path / "map.exr").radiance, open_hdr(tmp_path / "map.hdr").radiance
    assert exr.shape == hdr.shape and exr.dtype == hdr.dtype
    step = image.max(axis=-1, keepdims=True) * 2.0**-8  # RGBE: half a step of the shared exponent
    assert (np.abs(exr - hdr) <= step * (1 + 1e-6)).all()
    again = write(tmp_path / "again.exr", rgb(hdr))
    found, expected = load_light(again, 4), load_light(tmp_path / "map.hdr", 4)
    np.testing.assert_array_equal(found.coefficients, expected.coefficients)
    assert found.metadata == {**expected.metadata, "source": "again.exr"}


def test_a_real_map_is_its_hdr_twin() -> None:
    exr, hdr = (
        open_exr(shared_file("hdr/grace_latlong.exr")).radiance,
        open_hdr(shared_file("hdr/grace_latlong.hdr")).radiance,
    )
    assert exr.shape == hdr.shape == (512, 1024, 3)
    brightest = hdr.max(axis=-1, keepdims=True)
    assert (exr >= hdr).all() and (exr - hdr <= brightest * 2.0**-7).all()  # the twin's mantissas were cut, not rounded


def test_light_and_render_take_either_map(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    image = studio_light(32).astype(np.float32)
    write_hdr(tmp_path / "studio.hdr", image)
    write(tmp_path / "studio.EXR", rgb(image))
    save_mesh(tmp_path / "ball.ply", icosphere(2))
    monkeypatch.chdir(tmp_path)
    for name in ("studio.hdr", "studio.EXR"):
        gash.main(["light", name, "-o", f"{name}.npz", "--quiet"], standalone_mode=False)
    gash.main(["bake", "ball.ply", "-o", "ball.npz", "--rays", "16", "--quiet"], standalone_mode=False)
    pictures = []
    for name in ("studio.hdr", "studio.EXR"):
        command = ["render", "ball.npz", "--light", name, "-o", "p.png", "--size", "64", "--view", "front", "--quiet"]
        gash.main(command, standalone_mode=False)
        with Image.open("p.png") as picture:
            pictures.append(np.asarray(picture.convert("RGB"), int))
    assert pictures[0].std() > 3
    assert np.abs(pictures[1] - pictures[0]).max() <= 2  # of 255: RGBE is precise to 1 / 256
    found, expected = (load_light(f"{name}.npz").coefficients for name in ("studio.EXR", "studio.hdr"))
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(found, expected, atol=2.0**-8 * np.abs(expected).max())


@pytest.mark.parametrize(
    "extra",
    [
        {"A": 0.25},
        {"Y": 9.0},
        {"Z": 9.0, "albedo.R": 9.0, "albedo.G": 9.0, "albedo.B": 9.0},
        {"left.Y": 9.0, "N.X": 9.0, "N.Y": 9.0, "N.Z": 9.0},
    ],
    ids=lambda extra: "-".join(extra),
)
def test_plain_colour_comes_first_and_alone(tmp_path: Path, extra: dict[str, float]) -> None:
    others = {name: np.full((4, 8), value, np.float32) for name, value in extra.items()}
    np.testing.assert_array_equal(open_exr(write(tmp_path / "map.exr", rgb(PLACES) | others)).radiance, PLACES)


def test_grey_is_all_three_colours(tmp_path: Path) -> None:
    channels = {"Y": PLACES[..., 1].copy(), "A": np.ones((4, 8), np.float32)}
    found = open_exr(write(tmp_path / "map.exr", channels | rgb(PLACES, prefix="other."))).radiance
    np.testing.assert_array_equal(found, np.repeat(PLACES[..., 1:2], 3, axis=-1))


@pytest.mark.parametrize(("prefix", "names"), [("View Layer.Combined.", "RGB"), ("C.", "rgb")])
def test_the_only_layer_with_colour_is_read(tmp_path: Path, prefix: str, names: str) -> None:
    others = {"N.X": PLACES[..., 2], "N.Y": PLACES[..., 2], "N.Z": PLACES[..., 2], "Z.V": PLACES[..., 2]}
    others = {name: value.copy() for name, value in others.items()}
    found = open_exr(write(tmp_path / "map.exr", rgb(PLACES, names, prefix) | others)).radiance
    np.testing.assert_array_equal(found, PLACES)


@pytest.mark.parametrize(
    ("data", "display", "expected"),
    [
        ((3, 5, 10, 8), (3, 5, 10, 8), PLACES),
        ((-3, -5, 4, -2), (-3, -5, 4, -2), PLACES),
        ((0, 0, 7, 3), (2, 1, 5, 2), PLACES[1:3, 2:6]),
        ((0, 0, 7, 3), (0, 0, 5, 2), PLACES[:3, :6]),
        ((2, 0, 9, 3), (0, 0, 7, 3), np.pad(PLACES[:, :6], ((0, 0), (2, 0), (0, 0)))),
        ((2, 1, 9, 4), (0, 0, 9, 5), np.pad(PLACES, ((1, 1), (2, 0), (0, 0)))),
        ((-6, -2, 1, 1), (0, 0, 3, 3), np.pad(PLACES[2:, 6:], ((0, 2), (0, 2), (0, 0)))),
    ],
    ids=["shifted", "negative", "cropped", "corner", "moved", "padded", "both"],
)
def test_the_display_window_is_the_picture(tmp_path: Path, data: tuple, display: tuple, expected: np.ndarray) -> None:
    path = write(tmp_path / "map.exr", rgb(PLACES), dataWindow=window(*data), displayWindow=window(*display))
    np.testing.assert_array_equal(open_exr(path).radiance, expected)


def test_the_first_part_with_colour_is_read(tmp_path: Path) -> None:
    parts = [part("depth", {"Z": PLACES[..., 2].copy()}), part("a", rgb(PLACES)), part("b", rgb(PLACES + 1))]
    OpenEXR.File(parts).write(str(tmp_path / "map.exr"))
    np.testing.assert_array_equal(open_exr(tmp_path / "map.exr").radiance, PLACES)


def deep(path: Path) -> Path:
    samples = np.empty((4, 8), object)
    for index in np.ndindex(samples.shape):
        samples[index] = np.ones(2, np.float32)
    return write(path, dict.fromkeys("RGB", samples), "ZIPS", type=OpenEXR.deepscanline)


def spoilt(value: float) -> dict[str, np.ndarray]:
    image = PLACES.copy()
    image[2, 5, 1] = value
    return rgb(image)


BAD = {
    "no colour": (lambda p: write(p, {"Z": PLACES[..., 0].copy()}), r"no colour channels .* only Z: save"),
    "vector": (lambda p: write(p, rgb(PLACES, "XYZ")), "no colour channels"),
    "layered grey": (lambda p: write(p, {"left.Y": PLACES[..., 0].copy()}), "no colour channels"),
    "two colours": (lambda p: write(p, rgb(PLACES, "RG")), "no colour channels"),
    "two layers": (
        lambda p: write(p, rgb(PLACES, prefix="sky.") | rgb(PLACES, prefix="sun.")),
        "layers sky, sun: save",
    ),
    "chroma": (lambda p: write(p, dict(zip(("Y", "RY", "BY"), rgb(PLACES).values(), strict=True))), "luminance and"),
    "deep": (deep, "deep data: flatten"),
    "cube": (lambda p: write(p, rgb(PLACES), envmap=OpenEXR.ENVMAP_CUBE), "is a cube map"),
    "windows apart": (
        lambda p: write(p, rgb(PLACES), displayWindow=window(8, 0, 15, 3)),
        "outside its display window",
    ),
    "huge": (lambda p: write(p, rgb(PLACES), displayWindow=window(0, 0, 99998, 99998)), "99999 x 99999 pixels"),
    "nan": (lambda p: write(p, spoilt(np.nan)), r"not finite \(1 pixels, the first in row 2, column 5\)"),
    "inf": (lambda p: write(p, spoilt(np.inf)), "not finite .* half float ends at 65504"),
    "negative": (lambda p: write(p, spoilt(-500.0)), r"negative \(1 pixels, the first in row 2, column 5\): set"),
    "empty": (lambda p: p.write_bytes(b""), "not an OpenEXR picture"),
    "text": (lambda p: p.write_text("hello"), "not an OpenEXR picture: readable are .* convert"),
    "hdr": (lambda p: write_hdr(p, PLACES), "not an OpenEXR picture"),
    "magic alone": (lambda p: p.write_bytes(b"\x76\x2f\x31\x01"), "truncated or damaged"),
    "folder": (lambda p: p.mkdir(), "is a folder: name"),
    "missing": (lambda p: None, "no such file"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_maps_are_refused_in_one_line(tmp_path: Path, name: str, capfd: pytest.CaptureFixture) -> None:
    make, words = BAD[name]
    make(tmp_path / "map.exr")
    with pytest.raises(LightError, match=words) as error:
        load_light(tmp_path / "map.exr")
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_subsampled_colour_is_refused(tmp_path: Path) -> None:
    half = np.ones((2, 4), np.float32)
    channels = {name: OpenEXR.Channel(half, 2, 2) for name in "RGB"}
    write(tmp_path / "map.exr", channels, dataWindow=window(0, 0, 7, 3), displayWindow=window(0, 0, 7, 3))
    with pytest.raises(LightError, match="subsampled"):
        open_exr(tmp_path / "map.exr")


@pytest.mark.parametrize("compression", ["NO", "ZIP", "PIZ", "DWAA"])
def test_a_file_cut_anywhere_is_refused_and_nothing_else_is_printed(
    tmp_path: Path, compression: str, capfd: pytest.CaptureFixture
) -> None:
    data = write(tmp_path / "map.exr", rgb(IMAGE), compression).read_bytes()
    for end in [*range(4, 500, 31), *range(500, len(data), len(data) // 20), len(data) - 1]:
        (tmp_path / "cut.exr").write_bytes(data[:end])
        with pytest.raises(LightError, match="truncated or damaged.* fetch it again"):
            open_exr(tmp_path / "cut.exr")
    assert capfd.readouterr() == ("", "")


def test_only_the_part_that_is_read_must_be_whole(tmp_path: Path) -> None:
    colour, depth = part("a", rgb(PLACES)), part("depth", {"Z": PLACES[..., 0].copy()})
    for name, parts in (("last.exr", [depth, colour]), ("first.exr", [colour, depth])):
        OpenEXR.File(parts).write(str(tmp_path / name))
        (tmp_path / name).write_bytes((tmp_path / name).read_bytes()[:-20])
    np.testing.assert_array_equal(open_exr(tmp_path / "first.exr").radiance, PLACES)
    with pytest.raises(LightError, match="truncated"):
        open_exr(tmp_path / "last.exr")


def test_nothing_breaks_on_damaged_bytes(tmp_path: Path) -> None:
    data = write(tmp_path / "map.exr", rgb(PLACES), "PIZ").read_bytes()
    for old, new in ((b"R\0\2\0\0\0", b"\xbc\0\2\0\0\0"), (b"dataWindow\0", b"dataWind\xf1w\0")):
        assert old in data
        (tmp_path / "map.exr").write_bytes(data.replace(old, new))
        with pytest.raises(LightError, match="OpenEXR cannot read it"):
            open_exr(tmp_path / "map.exr")
    rng = np.random.default_rng(1)
    refused = 0
    for _ in range(200):
        damaged = bytearray(data)
        damaged[rng.integers(4, len(data))] = rng.integers(256)
        (tmp_path / "map.exr").write_bytes(damaged)
        try:
            assert open_exr(tmp_path / "map.exr").radiance.ndim == 3
        except LightError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > 20
