"""Projected light: closed forms, published tables, the pixel convention, rotation, light files."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import gash_jax
from gash_jax.algebra.sh import sh_components
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import write_npz
from gash_jax.formats.hdr import LightError, open_hdr, write_hdr
from gash_jax.light.environment import (
    Light,
    light_metadata,
    load_light,
    project_map,
    rotate_light,
    save_light,
)
from gash_jax.light.layouts import pixel_directions, pixel_solid_angles
from tests.helpers.shared_data import shared_file

TABLES = "hdr/sh_tables.json"


def table(name: str) -> np.ndarray:
    return np.array(json.loads(shared_file(TABLES).read_text())["tables"][name])


def basis(directions: np.ndarray, bands: int) -> np.ndarray:
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack(sh_components(x, y, z, bands), axis=-1)


def smooth_map(height: int, coefficients: np.ndarray) -> np.ndarray:
    """The map of a light that is band-limited."""
    return basis(pixel_directions(height, 2 * height), round(len(coefficients) ** 0.5)) @ coefficients


def test_pixel_convention_by_hand() -> None:
    directions = pixel_directions(180, 360)
    half = np.radians(0.5)
    up, right, back = directions[0, 0], directions[90, 269], directions[90, 0]
    np.testing.assert_allclose(up[1], np.cos(half), atol=1e-12)  # row 0 is up
    np.testing.assert_allclose(directions[-1, :, 1], -np.cos(half), atol=1e-12)
    np.testing.assert_allclose(
        directions[90, 179:181], [[-half, -half, -1], [half, -half, -1]], atol=2e-4
    )  # centre: -z
    np.testing.assert_allclose(right, [1, -half, -half], atol=2e-4)  # three quarters to the right: +x
    np.testing.assert_allclose(back, [-half, -half, 1], atol=2e-4)  # the left edge: +z
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1.0, atol=1e-12)
    np.testing.assert_array_equal(pixel_directions(180, 360, slice(7, 9)), directions[7:9])


@pytest.mark.parametrize(
    ("rows", "columns", "k", "sign"),
    [
        (slice(0, 32), slice(None), 1, 1),  # top: +y
        (slice(32, 64), slice(None), 1, -1),
        (slice(None), slice(64, 128), 3, 1),  # right half: +x
        (slice(None), slice(0, 64), 3, -1),
        (slice(None), slice(32, 96), 2, -1),  # middle: -z
    ],
)
def test_half_lit_maps_point_to_their_side(rows: slice, columns: slice, k: int, sign: int) -> None:
    image = np.zeros((64, 128, 3))
    image[rows, columns] = 1.0
    linear = project_map(image, 2)[1:, 0]
    # the hemisphere's mean direction: sqrt(3 / 4 pi) * pi
    assert linear[k - 1] == pytest.approx(sign * np.sqrt(3 / (4 * np.pi)) * np.pi, rel=1e-3)
    assert np.abs(np.delete(linear, k - 1)).max() < 1e-6


def test_solid_angles_cover_the_sphere() -> None:
    for shape in ((1, 1), (3, 5), (64, 128)):
        assert pixel_solid_angles(*shape).sum() * shape[1] == pytest.approx(4 * np.pi, rel=1e-13)
    np.testing.assert_allclose(pixel_solid_angles(2, 4), [np.pi / 2] * 2)


def test_constant_light_has_one_coefficient_and_an_error_of_second_order() -> None:
    rest = []
    for height in (16, 32, 64):
        found = project_map(np.ones((height, 2 * height, 3)), 10)
        np.testing.assert_allclose(found[0], 2 * np.sqrt(np.pi), rtol=1e-6)
        rest.append(np.abs(found[1:9]).max())
    np.testing.assert_allclose(np.array(rest[:-1]) / rest[1:], 4.0, rtol=0.05)
    assert rest[-1] < 1e-3


@pytest.mark.parametrize("bands", [1, 3, 10])
def test_a_lit_pixel_is_a_delta_light(bands: int) -> None:
    image = np.zeros((20, 40, 3))
    row, column = 13, 27
    image[row, column] = [1.0, 2.0, 0.5] / pixel_solid_angles(20, 40)[row]
    expected = basis(pixel_directions(20, 40)[row, column : column + 1], bands).T * [1.0, 2.0, 0.5]
    np.testing.assert_allclose(project_map(image, bands), expected, atol=1e-6)


def test_band_limited_maps_return_their_coefficients() -> None:
    light = np.random.default_rng(0).normal(size=(16, 3))
    found = project_map(smooth_map(128, light), 6)
    np.testing.assert_allclose(found[:16], light, atol=1e-3)
    assert np.abs(found[16:]).max() < 1e-3


def test_blocks_of_rows_add_up(monkeypatch: pytest.MonkeyPatch) -> None:
    image = np.random.default_rng(1).random((30, 60, 3))
    whole = project_map(image, 4)
    monkeypatch.setattr("gash_jax.light.projection._BLOCK_PIXELS", 7 * 60)
    np.testing.assert_allclose(project_map(image, 4), whole, atol=1e-6)


def test_sums_are_in_float64() -> None:
    """A million small pixels beside one of 1e8: single precision would lose the small ones."""
    image = np.full((724, 1448, 3), 1e-3, np.float32)
    image[360, 700] = 1e8
    small = image.copy()
    small[360, 700] = 0.0
    flux = float(pixel_solid_angles(724, 1448)[360]) * 1e8 * 0.5 / np.sqrt(np.pi)
    assert project_map(image, 1)[0, 0] - project_map(small, 1)[0, 0] == pytest.approx(flux, rel=1e-6)


def test_rotating_coefficients_is_rotating_the_map() -> None:
    light = np.random.default_rng(2).normal(size=(16, 3))
    angle = 2 * np.pi * 25 / 256  # 25 pixels about +y
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    image = smooth_map(128, light)
    # +y rotation carries -z towards -x, that is to the left in the map
    turned = project_map(np.roll(image, -25, axis=1), 4)
    np.testing.assert_allclose(rotate_light(project_map(image, 4), turn), turned, atol=1e-5)


def test_rotated_delta_light_lies_in_the_rotated_direction() -> None:
    w = np.array([[0.36, 0.48, 0.8]])
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    delta = (basis(w, 5).T * np.ones(3)).astype(np.float32)
    np.testing.assert_allclose(rotate_light(delta, turn), basis(w @ turn.T, 5).T * np.ones(3), atol=2e-6)


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def test_grace_cathedral_table_is_reproduced() -> None:
    image = 10 * open_hdr(shared_file("hdr/grace_latlong.hdr")).radiance
    found = rotate_light(project_map(image, 3), np.diag([1.0, -1.0, -1.0]))
    assert relative(np.asarray(found), table("grace_cathedral")) < 0.0056
    assert relative(project_map(image, 3), table("grace_cathedral")) > 0.5  # the axes matter


def test_uffizi_table_is_reproduced() -> None:
    """The table is of a mirrored frame: the flux of every pixel is projected on mapped directions."""
    image = open_hdr(shared_file("hdr/uffizi_256.hdr")).radiance / 10
    height, width = image.shape[:2]
    mirrored = basis(pixel_directions(height, width)[..., ::-1], 3)
    found = np.einsum("hwk,hwc,h->kc", mirrored, image, pixel_solid_angles(height, width))
    assert relative(found[1:], table("uffizi_gallery")[1:]) < 0.0053
    swap = found_by_reflection(project_map(image, 3))
    np.testing.assert_allclose(swap, found, atol=1e-5)


def found_by_reflection(coefficients: np.ndarray) -> np.ndarray:
    """Coefficients under (x, y, z) -> (z, y, x), from the cartesian forms of bands 0 to 2."""
    r3 = np.sqrt(3.0)
    c00, y, z, x, xy, yz, zz, xz, xx = coefficients
    return np.stack([c00, y, x, z, yz, xy, -zz / 2 + r3 / 2 * xx, xz, r3 / 2 * zz + xx / 2])


def test_a_generated_map_survives_file_and_projection(tmp_path: Path) -> None:
    """The check of the tables without their data: a light with known coefficients through an .hdr file."""
    light = np.random.default_rng(3).normal(size=(9, 3)) * 0.1
    light[0] = 3.0  # keeps the map positive
    image = smooth_map(96, light)
    assert image.min() > 0
    write_hdr(tmp_path / "map.hdr", image)
    found = load_light(tmp_path / "map.hdr")
    assert found.bands == 3 and found.metadata["source"] == "map.hdr" and found.metadata["map"] == [96, 192]
    assert relative(found.coefficients, light) < 5e-4


def test_light_files_round_trip_cut_and_refuse(tmp_path: Path) -> None:
    coefficients = np.random.default_rng(4).normal(size=(16, 3)).astype(np.float32)
    path = tmp_path / "light.npz"
    save_light(path, Light(coefficients, light_metadata(4, source="made")))
    with np.load(path, allow_pickle=False) as archive:
        np.testing.assert_array_equal(archive["coefficients"], coefficients)
        assert json.loads(str(archive["metadata"]))["bands"] == 4
    again, cut = load_light(path, 4), load_light(path, 2)
    np.testing.assert_array_equal(again.coefficients, coefficients)
    assert again.metadata["source"] == "made"
    np.testing.assert_array_equal(cut.coefficients, coefficients[:4])
    assert cut.bands == cut.metadata["bands"] == 2
    with pytest.raises(LightError, match="project its map again with --bands 5"):
        load_light(path, 5)


@pytest.mark.parametrize(
    ("coefficients", "form"),
    [
        (np.ones((8, 3), np.float32), "gash-light"),
        (np.ones((9, 4), np.float32), "gash-light"),
        (np.ones((0, 3), np.float32), "gash-light"),
        (np.ones(9, np.float32), "gash-light"),
        (np.ones((9, 3), np.int32), "gash-light"),
        (np.full((9, 3), np.nan, np.float32), "gash-light"),
        (np.ones((9, 3), np.float32), "gash-transfer"),
    ],
    ids=["count", "channels", "empty", "vector", "integers", "nan", "format"],
)
def test_bad_light_files_are_refused(tmp_path: Path, coefficients: np.ndarray, form: str) -> None:
    write_npz(tmp_path / "light.npz", {"coefficients": coefficients}, {"format": form})
    with pytest.raises(LightError):
        load_light(tmp_path / "light.npz", 1)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "map.tif").write_bytes(b"II*\0")
    (tmp_path / "half.npz").write_bytes(b"no archive")
    with pytest.raises(LightError, match="readable are Radiance .hdr maps, OpenEXR .exr maps and light .npz files"):
        load_light(tmp_path / "map.tif")
    with pytest.raises(LightError, match="no such file"):
        load_light(tmp_path / "none.tif")
    with pytest.raises(FileError, match="truncated"):
        load_light(tmp_path / "half.npz")
    with pytest.raises(ValueError, match="bands is 99"):
        load_light(tmp_path / "map.hdr", 99)


@pytest.mark.parametrize("image", [np.ones((4, 8)), np.ones((4, 8, 1)), np.full((4, 8, 3), np.inf), np.ones((0, 8, 3))])
def test_bad_maps_are_refused(image: np.ndarray) -> None:
    with pytest.raises(LightError):
        project_map(image, 3)


def test_too_bright_maps_are_refused() -> None:
    with pytest.raises(LightError, match="too bright"):
        project_map(np.full((4, 8, 3), 1e38), 1)


def test_a_projected_map_is_a_light_that_says_how_it_was_read(tmp_path: Path) -> None:
    image = np.random.default_rng(2).random((16, 32, 3)).astype(np.float32)
    light = gash_jax.project_light(jnp.asarray(image), np.int64(4))
    assert isinstance(light, Light) and light.bands == 4 and light.metadata["layout"] == "latlong"
    np.testing.assert_array_equal(light.coefficients, project_map(image, 4))
    gash_jax.save_light(tmp_path / "l.npz", light)
    np.testing.assert_array_equal(load_light(tmp_path / "l.npz", 4).coefficients, light.coefficients)


def test_a_light_turns_as_a_light_and_an_array_as_an_array() -> None:
    turn = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    light = gash_jax.project_light(np.random.default_rng(2).random((8, 16, 3)), 3)
    turned, array = rotate_light(light, turn), rotate_light(light.coefficients, turn)
    assert isinstance(turned, Light) and turned.metadata == {**light.metadata, "rotation": turn.tolist()}
    assert isinstance(array, jax.Array)
    np.testing.assert_array_equal(turned.coefficients, array)
    np.testing.assert_allclose(jax.jit(rotate_light)(light, turn).coefficients, array, atol=1e-6)
    many = jax.vmap(lambda r: rotate_light(light.coefficients, r))(np.stack([turn, np.eye(3)]).astype(np.float32))
    np.testing.assert_allclose(many[1], light.coefficients, atol=1e-6)
    gradient = jax.grad(lambda r: jnp.sum(jnp.asarray(rotate_light(light.coefficients, r)) ** 3))(jnp.eye(3))
    assert np.isfinite(gradient).all()


@pytest.mark.parametrize("rotation", [np.eye(2), np.zeros((3, 3)), np.diag([1.0, 1, -1]), 2 * np.eye(3), "x"])
def test_what_is_no_rotation_is_refused(rotation: object) -> None:
    with pytest.raises(ValueError, match="rotation"):
        rotate_light(np.zeros((9, 3)), rotation)  # type: ignore[arg-type]


def test_a_light_of_a_wrong_shape_is_refused() -> None:
    for wrong in (np.zeros((9,)), np.zeros((8, 3)), np.full((9, 3), "a")):
        with pytest.raises(ValueError, match="light has shape|no square"):
            Light(wrong)
