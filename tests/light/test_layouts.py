"""Maps of every layout: where pixels look, by hand and against published inverses; what is recognised or refused."""

from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from gash_jax.algebra.sh import sh_components
from gash_jax.formats.hdr import LightError, write_hdr
from gash_jax.formats.maps import read_map
from gash_jax.light.environment import load_light, project_map
from gash_jax.light.layouts import LAYOUTS, layout_of, pixel_rays
from tests.helpers.shared_data import shared_case

# shapes that every layout can have, about as fine
SHAPES = {"latlong": (64, 128), "angular": (96, 96), "cross": (128, 96), "equal-area": (80, 80)}
WIDE = (96, 128)  # the cross lying
EVERY = [*SHAPES.items(), ("cross", WIDE)]
RIGHT, LEFT, UP, DOWN, BACK, FRONT = np.concatenate([[d, -d] for d in np.eye(3)])


def _pixel(layout: str, shape: tuple[int, int], down: float, right: float) -> np.ndarray:
    """Direction of the pixel at a part of the height and of the width."""
    return pixel_rays(layout, *shape).directions[int(down * shape[0]), int(right * shape[1])]


def _near(found: np.ndarray, expected: np.ndarray, degrees: float = 5.0) -> bool:
    return bool(found @ expected > np.cos(np.radians(degrees)) * np.linalg.norm(expected))


@pytest.mark.parametrize(
    ("layout", "shape", "places"),
    [
        (
            "latlong",
            (64, 128),
            {(0.5, 0.5): FRONT, (0.5, 0.75): RIGHT, (0.5, 0.25): LEFT, (0.0, 0.3): UP, (0.5, 0): BACK},
        ),
        (
            "angular",
            (97, 97),
            {(0.5, 0.5): FRONT, (0.5, 0.75): RIGHT, (0.25, 0.5): UP, (0.75, 0.5): DOWN, (0.5, 0.25): LEFT},
        ),
        ("angular", (97, 97), {(0.5, 0.0): BACK, (0.5, 0.999): BACK, (0.0, 0.5): BACK}),
        ("cross", (132, 99), {(3 / 8, 0.5): FRONT, (3 / 8, 5 / 6): RIGHT, (3 / 8, 1 / 6): LEFT, (1 / 8, 0.5): UP}),
        ("cross", (132, 99), {(5 / 8, 0.5): DOWN, (7 / 8, 0.5): BACK}),
        ("cross", (99, 132), {(0.5, 3 / 8): FRONT, (0.5, 5 / 8): RIGHT, (0.5, 1 / 8): LEFT, (1 / 6, 3 / 8): UP}),
        ("cross", (99, 132), {(5 / 6, 3 / 8): DOWN, (0.5, 7 / 8): BACK}),
        ("equal-area", (81, 81), {(0.5, 0.5): UP, (0.0, 0.0): DOWN, (0.999, 0.0): DOWN, (0.0, 0.999): DOWN}),
        # pbrt's x and y, to the right and down: the left edge of a latlong map, then a quarter on
        ("equal-area", (81, 81), {(0.5, 0.999): BACK, (0.999, 0.5): LEFT, (0.5, 0.0): FRONT, (0.0, 0.5): RIGHT}),
    ],
)
def test_places_by_hand(layout: str, shape: tuple[int, int], places: dict) -> None:
    for place, expected in places.items():
        assert _near(_pixel(layout, shape, *place), expected), (place, expected)


def test_the_cross_hangs_together() -> None:
    """Across every edge between two faces of the picture the directions go on, in the middle and near the corners."""
    for layout, shape, size in (("cross", (120, 90), 30), ("cross", (90, 120), 30)):
        directions, solid_angles = pixel_rays(layout, *shape)
        for axis in (0, 1):
            ahead, here = np.roll(directions, -1, axis=axis), directions
            joined = (solid_angles > 0) & (np.roll(solid_angles, -1, axis=axis) > 0)
            joined[(-1, slice(None)) if axis == 0 else (slice(None), -1)] = False
            assert (ahead * here).sum(-1)[joined].min() > np.cos(2.5 / size)


@pytest.mark.parametrize(("layout", "shape"), EVERY)
def test_pixels_cover_the_sphere_and_rows_are_rows(layout: str, shape: tuple[int, int]) -> None:
    directions, solid_angles = pixel_rays(layout, *shape)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1)[solid_angles > 0], 1.0, atol=1e-12)
    assert solid_angles.sum() == pytest.approx(4 * np.pi, rel=1e-4 if layout == "angular" else 1e-12)
    mean = np.einsum("hw,hwc->c", solid_angles, directions)
    np.testing.assert_allclose(mean, 0.0, atol=2e-3)
    some = pixel_rays(layout, *shape, slice(7, 31))
    np.testing.assert_array_equal(some.directions, directions[7:31])
    np.testing.assert_array_equal(some.solid_angles, solid_angles[7:31])


def test_equal_area_against_the_inverse_of_pbrt() -> None:
    """EqualAreaSphereToSquare, from the sphere to the square, with exact arctangents."""
    for size in (1, 2, 9, 64):
        d = pixel_rays("equal-area", size, size).directions
        x, y, z = d[..., 2], -d[..., 0], d[..., 1]
        radius = np.sqrt(1 - np.abs(z))
        part = np.arctan2(np.minimum(np.abs(x), np.abs(y)), np.maximum(np.abs(x), np.abs(y))) * 2 / np.pi
        part = np.where(np.abs(x) < np.abs(y), 1 - part, part)
        v = part * radius
        u = radius - v
        u, v = np.where(z < 0, 1 - v, u), np.where(z < 0, 1 - u, v)
        middle = (np.arange(size) + 0.5) / size
        np.testing.assert_allclose((np.copysign(u, x) + 1) / 2, np.broadcast_to(middle[None], u.shape), atol=1e-7)
        np.testing.assert_allclose((np.copysign(v, y) + 1) / 2, np.broadcast_to(middle[:, None], u.shape), atol=1e-7)


def test_angular_against_its_inverse() -> None:
    """Debevec: a direction lies at (dx, dy) r, r = acos of its part along the view / (pi |(dx, dy)|)."""
    directions, solid_angles = pixel_rays("angular", 50, 50)
    x, y, z = directions[solid_angles > 0].T
    radius = np.arccos(-z) / np.pi / np.hypot(x, y)
    rows, columns = np.nonzero(solid_angles)
    np.testing.assert_allclose(x * radius, (columns + 0.5) / 25 - 1, atol=1e-7)
    np.testing.assert_allclose(y * radius, 1 - (rows + 0.5) / 25, atol=1e-7)


def _drawn(layout: str, shape: tuple[int, int], coefficients: np.ndarray) -> np.ndarray:
    """The map of a band-limited light; black outside the sphere."""
    directions, solid_angles = pixel_rays(layout, *shape)
    x, y, z = np.moveaxis(directions, -1, 0)
    basis = np.stack(sh_components(x, y, z, round(len(coefficients) ** 0.5)), axis=-1)
    return (basis @ coefficients) * (solid_angles > 0)[..., None]


@pytest.mark.parametrize(("layout", "shape"), EVERY)
def test_one_light_in_every_layout(layout: str, shape: tuple[int, int]) -> None:
    light = np.random.default_rng(0).normal(size=(9, 3))
    found = project_map(_drawn(layout, shape, light), 4, layout)
    np.testing.assert_allclose(found[:9], light, atol=0.01)
    assert np.abs(found[9:]).max() < 0.01


@pytest.mark.parametrize(("layout", "shape"), EVERY)
def test_half_a_sky_and_a_constant(layout: str, shape: tuple[int, int]) -> None:
    """L_00 half of 2 sqrt(pi); l = 1 of length sqrt(3 pi) / 2 up, the hemisphere's own."""
    directions, solid_angles = pixel_rays(layout, *shape)
    up = np.repeat((directions[..., 1:2] > 0) & (solid_angles > 0)[..., None], 3, axis=-1).astype(np.float32)
    sky = project_map(up, 2, layout)[:, 0]
    np.testing.assert_allclose(sky, [np.sqrt(np.pi), np.sqrt(3 * np.pi) / 2, 0, 0], atol=0.05)
    even = project_map(np.ones((*shape, 3)), 3, layout)[:, 1]
    np.testing.assert_allclose(even, [2 * np.sqrt(np.pi)] + [0] * 8, atol=2e-3)


def test_what_is_certain_is_recognised_with_a_note() -> None:
    for layout, shape in EVERY:
        if layout == "equal-area":
            continue
        image = np.ones((*shape, 3)) * (pixel_rays(layout, *shape).solid_angles > 0)[..., None]
        found, notes = layout_of(image)
        assert found == layout and len(notes) == (layout != "latlong")
        np.testing.assert_array_equal(project_map(image, 3), project_map(image, 3, layout))
    cross = np.ones((*WIDE, 3))
    cross[pixel_rays("cross", *WIDE).solid_angles == 0] = 0.7  # the empty squares need not be black
    assert layout_of(cross)[0] == "cross"


def _sky_square() -> np.ndarray:
    """An equal-area map lit from above only: its corners are black, though it is no disk."""
    return np.repeat(pixel_rays("equal-area", 64, 64).directions[..., 1:2] > 0, 3, axis=-1).astype(np.float32)


@pytest.mark.parametrize(
    "image",
    [
        np.ones((64, 64, 3)),
        np.zeros((64, 64, 3)),
        _sky_square(),
        np.random.default_rng(0).random((96, 128, 3)),  # a photograph
        np.random.default_rng(0).random((128, 96, 3)),
        np.ones((64, 129, 3)),
        np.ones((65, 128, 3)),
        np.ones((100, 300, 3)),
        np.ones((97, 129, 3)),
    ],
    ids=["even square", "black square", "sky", "4:3", "3:4", "a column more", "a row more", "3:1", "nearly 4:3"],
)
def test_what_is_not_certain_is_refused_naming_the_option(image: np.ndarray) -> None:
    with pytest.raises(LightError, match=r"not twice as wide as high: .* --layout latlong\|angular\|cross\|equal-area"):
        project_map(image, 3)
    assert layout_of(image, "latlong") == ("latlong", ())  # said so, any shape is read so


@pytest.mark.parametrize(
    ("layout", "shape", "words"),
    [
        ("angular", (64, 65), "an angular map is square, this one has 65 x 64"),
        ("equal-area", (64, 128), "an equal-area map is square"),
        ("cross", (64, 128), "a cube cross is 3 faces wide and 4 high"),
        ("cross", (96, 127), "a cube cross is 3 faces wide"),
        ("mirror", (64, 64), "unknown layout 'mirror': choose one of latlong, angular, cross, equal-area"),
    ],
)
def test_shapes_that_a_named_layout_cannot_have(layout: str, shape: tuple[int, int], words: str) -> None:
    with pytest.raises(LightError, match=words):
        project_map(np.ones((*shape, 3)), 3, layout)
    with pytest.raises(LightError, match=words):
        pixel_rays(layout, *shape)


def test_files_of_every_layout(tmp_path: Path) -> None:
    """Named or recognised, the light of a file is that of its map; its metadata say how it was read."""
    for layout, shape in EVERY:
        even = np.ones((*shape, 3)) * (pixel_rays(layout, *shape).solid_angles > 0)[..., None]
        write_hdr(tmp_path / "map.hdr", even)
        light = load_light(tmp_path / "map.hdr", 3, layout)
        np.testing.assert_allclose(light.coefficients[0], 2 * np.sqrt(np.pi), rtol=1e-4)
        assert light.metadata["layout"] == layout and light.metadata["notes"] == []
        if layout == "equal-area":
            with pytest.raises(LightError, match=r"map\.hdr: .*--layout"):
                load_light(tmp_path / "map.hdr")
        else:
            again = load_light(tmp_path / "map.hdr")
            np.testing.assert_array_equal(again.coefficients, light.coefficients)
            assert len(again.metadata["notes"]) == (layout != "latlong")


def test_an_attribute_of_the_file_names_the_layout(tmp_path: Path) -> None:
    """envmap = latlong: any shape is latlong, it is not turned, and what the attribute would mean is said."""
    for height, width in ((16, 32), (20, 30)):
        image = np.random.default_rng(1).random((height, width, 3)).astype(np.float32)
        header = {"type": OpenEXR.scanlineimage, "envmap": OpenEXR.ENVMAP_LATLONG}
        OpenEXR.File(header, {"RGB": image}).write(str(tmp_path / "map.exr"))
        light = load_light(tmp_path / "map.exr")
        np.testing.assert_array_equal(light.coefficients, project_map(image, 3, "latlong"))
        assert light.metadata["layout"] == "latlong" and "the centre of the picture is +z" in light.metadata["notes"][0]


def test_progress_counts_rows_read_and_projected(tmp_path: Path) -> None:
    write_hdr(tmp_path / "map.hdr", np.ones((300, 600, 3)))
    seen: list[tuple[int, int]] = []
    load_light(tmp_path / "map.hdr", 2, progress=lambda done, total: seen.append((done, total)))
    assert seen == sorted(seen) and seen[-1] == (600, 600) and {total for _, total in seen} == {600}


@pytest.mark.parametrize("layout", [None, "angular"])
def test_the_angular_case(layout: str | None) -> None:
    found = load_light(shared_case("angular_square.hdr"), 4, layout).coefficients
    np.testing.assert_allclose(found[0], 3.5449, atol=1e-4)
    np.testing.assert_allclose(found[1:], 0.0, atol=2e-4)


def test_the_equal_area_case() -> None:
    """Half the sphere at 1 has L_00 = sqrt(pi) = 1.7725; this file holds 1.7171, to the last pixel.

    The horizon |u| + |v| = 1 goes through the centres of two pixels of each of the 64 rows, and the file has all 128
    dark: 1984 of 4096 equal pixels are lit, and L_00 = 2 sqrt(pi) 1984 / 4096. Half lit they would give 1.7725. Light
    at the horizon adds nothing to the norm of l = 1, 1.535.
    """
    path = shared_case("equalarea_sky.exr")
    image, directions = read_map(path).radiance[..., 0].copy(), pixel_rays("equal-area", 64, 64).directions
    horizon = directions[..., 1] == 0
    assert horizon.sum() == 128 and not image[horizon].any() and image[directions[..., 1] > 0].all()
    found = load_light(path, 3, "equal-area").coefficients
    np.testing.assert_allclose(found[0], 2 * np.sqrt(np.pi) * 1984 / 4096, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(found[1:4], axis=0), 1.535, atol=0.003)
    image[horizon] = 0.5
    half = project_map(np.repeat(image[..., None], 3, axis=-1), 3, "equal-area")
    np.testing.assert_allclose(half[0], np.sqrt(np.pi), rtol=1e-6)
    np.testing.assert_allclose(half[1:4], found[1:4], atol=1e-6)
    with pytest.raises(LightError, match="--layout"):
        load_light(path)


def test_a_square_of_few_pixels_is_not_called_angular() -> None:
    """No pixel of 8 x 8 lies outside the disk by more than itself: black corners cannot be seen."""
    for size in (1, 2, 4, 8):
        with pytest.raises(LightError, match="--layout"):
            layout_of(np.ones((size, size, 3), np.float32))


def test_the_latlong_case_is_noted_and_not_turned() -> None:
    light = load_light(shared_case("left_latlong.exr"))
    assert "envmap = latlong" in light.metadata["notes"][0]
    assert light.coefficients[3, 0] < 0  # lit left of the centre: towards -x


def test_layouts_are_documented() -> None:
    from gash_jax.light import layouts

    assert all(f"- {name}" in (layouts.__doc__ or "") for name in LAYOUTS)
