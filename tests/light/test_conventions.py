"""The numbers of other programs, against their own formulas (tests/helpers/engine_formulas.py)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gash_jax
from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.sh import evaluate_sh, sh_components
from gash_jax.light.conventions import axis_map, basis_change, decoded, encoded, polynomial_constants, turn_map
from gash_jax.light.engines import CONVENTIONS, convention
from gash_jax.light.layouts import pixel_directions
from tests.helpers.engine_formulas import BASES, COORDINATES, IRRADIANCE, MAP_U, pifu_samples

NAMES = list(CONVENTIONS)
RNG = np.random.default_rng(3)
DIRECTIONS = np.concatenate([np.eye(3), -np.eye(3), RNG.normal(size=(40, 3))])
DIRECTIONS /= np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)


def ours(directions: np.ndarray, bands: int) -> np.ndarray:
    x, y, z = directions.T
    return np.stack(sh_components(x, y, z, bands), axis=1)


def bands_of(name: str) -> int:
    return min(CONVENTIONS[name].bands[1], {"e3nn": 3}.get(name, 4))


def light(bands: int) -> np.ndarray:
    return np.random.default_rng(bands).normal(size=(bands * bands, 3))


def radiance(name: str, theirs: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """What their formula makes of their numbers, in our directions."""
    count = len(theirs)
    offset = 0.5 if name == "splats" else 0.0
    return BASES[name](COORDINATES[name](directions))[:, :count] @ theirs + offset


@pytest.mark.parametrize("name", BASES)
def test_their_formula_gives_our_radiance(name: str) -> None:
    bands = bands_of(name)
    theirs = encoded(light(bands).T, convention(name), "light").T
    expected = ours(DIRECTIONS, bands) @ light(bands) * (1 / np.pi if name == "pifu" else 1.0)
    np.testing.assert_allclose(radiance(name, theirs, DIRECTIONS), expected, atol=2e-5)


@pytest.mark.parametrize("name", IRRADIANCE)
def test_their_formula_gives_irradiance_over_pi(name: str) -> None:
    theirs = encoded(light(3).T, convention(name), "light").T
    expected = ours(DIRECTIONS, 3) @ (clamped_cosine_coefficients(3)[:, None] / np.pi * light(3))
    np.testing.assert_allclose(IRRADIANCE[name](theirs, COORDINATES[name](DIRECTIONS)), expected, atol=1e-12)


def test_three_shows_irradiance_over_pi() -> None:
    """SphericalHarmonics3.getIrradianceAt, and BRDF_Lambert divides by pi."""
    c, (x, y, z) = encoded(light(3).T, convention("three"), "light").T, DIRECTIONS.T[:, :, None]
    sums = c[0] * 0.886227 + 2 * 0.511664 * (c[1] * y + c[2] * z + c[3] * x)
    sums += 2 * 0.429043 * (c[4] * x * y + c[5] * y * z + c[7] * x * z) + c[6] * (0.743125 * z * z - 0.247708)
    sums += c[8] * 0.429043 * (x * x - y * y)
    expected = ours(DIRECTIONS, 3) @ (clamped_cosine_coefficients(3)[:, None] * light(3))
    np.testing.assert_allclose(sums / np.pi, expected / np.pi, atol=2e-5)


def test_unreal_packs_irradiance_over_pi() -> None:
    """SetupSkyIrradianceEnvironmentMapConstantsFromSkyIrradiance and GetSkySHDiffuse, one colour."""
    r = encoded(light(3).T, convention("unreal"), "light")[0]
    root = np.sqrt(np.pi)
    c0, c1, c2, c3 = 1 / (2 * root), np.sqrt(3) / (3 * root), np.sqrt(15) / (8 * root), np.sqrt(5) / (16 * root)
    first = np.array([-c1 * r[3], -c1 * r[1], c1 * r[2], c0 * r[0] - c3 * r[6]])
    second = np.array([c2 * r[4], -c2 * r[5], 3 * c3 * r[6], -c2 * r[7]])
    x, y, z = COORDINATES["unreal"](DIRECTIONS).T
    sums = np.stack([x, y, z, 1 + 0 * x], 1) @ first + np.stack([x * y, y * z, z * z, z * x], 1) @ second
    expected = ours(DIRECTIONS, 3) @ (clamped_cosine_coefficients(3) / np.pi * light(3)[:, 0])
    np.testing.assert_allclose(sums + c2 / 2 * r[8] * (x * x - y * y), expected, atol=1e-12)


def test_pifu_bakes_pi_times_ours() -> None:
    """Their sum w V cos Y over their samples, for an unshadowed vertex: the two signs cancel in every column."""
    cosine, phi = np.meshgrid((np.arange(400) + 0.5) / 200 - 1, (np.arange(400) + 0.5) * np.pi / 200)
    directions, basis = pifu_samples(np.arccos(cosine).ravel(), phi.ravel())
    normal = np.array([0.48, 0.6, -0.64])
    theirs = 4 * np.pi / len(basis) * (np.maximum(directions @ normal, 0) @ basis)
    transfer = np.asarray(gash_jax.unshadowed_transfer(normal[None].astype(np.float32), 3))
    np.testing.assert_allclose(encoded(transfer, convention("pifu"), "transfer")[0], theirs, atol=2e-4)
    np.testing.assert_allclose(theirs, np.pi * transfer[0], atol=2e-4)


@pytest.mark.parametrize("name", NAMES)
def test_the_sum_over_their_numbers_is_the_radiance_of_the_vertex(name: str) -> None:
    record = convention(name)
    bands = min(record.bands[1], 5)
    transfer = RNG.normal(size=(7, bands * bands))
    theirs = encoded(light(bands).T, record, "light") - record.constant(bands)
    np.testing.assert_allclose(encoded(transfer, record, "transfer") @ theirs.T, transfer @ light(bands), atol=1e-12)


@pytest.mark.parametrize("kind", ["light", "transfer"])
@pytest.mark.parametrize("name", NAMES)
def test_there_and_back(name: str, kind: str) -> None:
    record = convention(name)
    for bands in range(record.bands[0], record.bands[1] + 1):
        values = RNG.normal(size=(4, bands * bands))
        there = encoded(values, record, kind)
        np.testing.assert_allclose(decoded(there, record, kind), values, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_turning_commutes(name: str) -> None:
    """A light turned here and written is the written light turned there, by P R P^T."""
    bands = bands_of(name)
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    turned = np.asarray(gash_jax.rotate_light(light(bands).astype(np.float32), turn))
    values = encoded(turned.T, convention(name), "light").T
    before = encoded(light(bands).T, convention(name), "light").T
    evaluate = radiance if name in BASES else lambda n, c, d: IRRADIANCE[n](c, COORDINATES[n](d))
    np.testing.assert_allclose(
        evaluate(name, values, DIRECTIONS @ turn.T), evaluate(name, before, DIRECTIONS), atol=1e-4
    )


# light of flux 1 from (0.48, 0.6, -0.64), worked on paper: l = 1 is 0.488603 d, times 2/3 0.488603 as a polynomial
HAND = {
    "three": [0.29316, -0.31271, 0.23453],  # y, z, x
    "unity": [0.09549, 0.10186, 0.07639],  # y, -z, x
    "unity-gltf": [0.09549, -0.10186, -0.07639],  # y, z, -x
    "filament": [0.09549, -0.10186, 0.07639],
    "d3dx": [-0.29316, -0.31271, -0.23453],  # -y, z, -x
    "unreal": [0.31271, 0.29316, -0.23453],  # their y is our z, their z our y: -z, y, -x
    "blender": [-0.31271, 0.29316, -0.23453],  # their y is our -z: z, y, -x
    "splats": [-0.29316, -0.31271, -0.23453],
    "e3nn": [0.23453, 0.29316, -0.31271],  # x, y, z
    "mitsuba": [-0.29316, -0.31271, -0.23453],
    "pifu": [0.09332, -0.09954, 0.07465],  # over pi
}


@pytest.mark.parametrize("name", NAMES)
def test_by_hand(name: str) -> None:
    delta = ours(np.array([[0.48, 0.6, -0.64]]), 3)[0]
    np.testing.assert_allclose(encoded(delta, convention(name), "light")[1:4], HAND[name], atol=1e-5)


def test_constants_by_hand() -> None:
    """Radiance 1 from everywhere: 2 sqrt(pi), irradiance over pi 1, and less 1/2 over 0.2821 for splats."""
    constant = np.array([2 * np.sqrt(np.pi), *np.zeros(8)])
    first = {name: encoded(constant, record, "light")[0] for name, record in CONVENTIONS.items()}
    assert all(first[name] == pytest.approx(3.544908, abs=1e-6) for name in ("three", "d3dx", "unreal", "e3nn"))
    assert all(first[name] == pytest.approx(1.0) for name in ("unity", "unity-gltf", "filament"))
    assert first["splats"] == pytest.approx(0.5 / 0.28209479) and first["pifu"] == pytest.approx(2 / np.sqrt(np.pi))
    np.testing.assert_allclose(
        polynomial_constants(3)[[0, 1, 4, 6, 8]], [0.282095, 0.488603, 1.092548, 0.315392, 0.546274], atol=1e-6
    )


def test_unity_mirrors_as_documented() -> None:
    """z mirrored flips k = 2, 5, 7; x mirrored flips 3, 4, 7."""
    three, one = (encoded(np.ones(9), convention(name), "light") for name in ("filament", "unity"))
    assert np.flatnonzero(np.sign(three) != np.sign(one)).tolist() == [2, 5, 7]
    other = encoded(np.ones(9), convention("unity-gltf"), "light")
    assert np.flatnonzero(np.sign(three) != np.sign(other)).tolist() == [3, 4, 7]


def test_a_wrong_sign_an_axis_and_a_scale_are_noticed() -> None:
    """The check above fails where a record were wrong: numbers of one program in the formula of another."""
    for right, wrong in (
        ("three", "d3dx"),
        ("d3dx", "three"),
        ("unreal", "blender"),
        ("blender", "d3dx"),
        ("splats", "d3dx"),
    ):
        theirs = encoded(light(3).T, convention(wrong), "light").T
        assert np.abs(radiance(right, theirs, DIRECTIONS) - ours(DIRECTIONS, 3) @ light(3)).max() > 0.1
    theirs = encoded(light(3).T, convention("unity"), "light").T
    expected = ours(DIRECTIONS, 3) @ (clamped_cosine_coefficients(3)[:, None] / np.pi * light(3))
    assert np.abs(IRRADIANCE["filament"](theirs, DIRECTIONS) - expected).max() > 0.1


@pytest.mark.parametrize("name", NAMES)
def test_axes_and_the_change_of_basis(name: str) -> None:
    matrix, change = axis_map(convention(name).axes), basis_change(convention(name).axes, 10)
    np.testing.assert_allclose(DIRECTIONS @ matrix.T if name != "e3nn" else DIRECTIONS, COORDINATES[name](DIRECTIONS))
    np.testing.assert_allclose(change @ change.T, np.eye(100), atol=1e-10)
    np.testing.assert_allclose(ours(DIRECTIONS @ matrix.T, 10), ours(DIRECTIONS, 10) @ change.T, atol=1e-10)


@pytest.mark.parametrize("name", MAP_U)
def test_a_turned_map_is_seen_where_it_was(name: str) -> None:
    directions = pixel_directions(8, 16)
    image = directions.astype(np.float32)  # every pixel holds where we look
    turned = turn_map(image, convention(name))
    column = np.floor(MAP_U[name](COORDINATES[name](directions.reshape(-1, 3))) % 1.0 * 16).astype(int)
    seen = turned[np.repeat(np.arange(8), 16), column].reshape(8, 16, 3)
    np.testing.assert_allclose(seen, image, atol=1e-6)


@pytest.mark.parametrize("name", MAP_U)
def test_turning_the_light_shows_the_map_as_they_do(name: str) -> None:
    """`gash light MAP --rotate TURN`: what they see of a map that was not turned for them."""
    image = RNG.uniform(size=(8, 16, 3)).astype(np.float32)
    half = np.radians(convention(name).turn or 0) / 2
    turned = gash_jax.rotate_light(gash_jax.project_light(image), np.array([np.cos(half), 0, np.sin(half), 0]))
    directions = pixel_directions(8, 16).reshape(-1, 3)
    column = np.floor(MAP_U[name](COORDINATES[name](directions)) % 1.0 * 16).astype(int)
    seen = image[np.repeat(np.arange(8), 16), column].reshape(8, 16, 3)
    np.testing.assert_allclose(turned.coefficients, gash_jax.project_light(seen).coefficients, atol=1e-4)


def test_tools_without_maps_and_widths_without_quarters_are_refused() -> None:
    assert set(MAP_U) == {name for name, record in CONVENTIONS.items() if record.turn is not None}
    with pytest.raises(ValueError, match="3D Gaussian splats has no latitude-longitude maps"):
        turn_map(np.ones((8, 16, 3), np.float32), convention("splats"))
    with pytest.raises(ValueError, match="18 pixels wide"):
        turn_map(np.ones((9, 18, 3), np.float32), convention("three"))


def test_what_cannot_be_written_is_refused() -> None:
    with pytest.raises(ValueError, match=r"4 bands, and three.js LightProbe reads 3: keep the first 3 \(--bands 3\)"):
        encoded(np.ones(16), convention("three"), "light")
    with pytest.raises(ValueError, match="2 bands, and three.js LightProbe reads 3: make it with --bands 3"):
        encoded(np.ones(4), convention("three"), "light")
    with pytest.raises(ValueError, match="not finite"):
        encoded(np.array([1.0, np.nan, 0.0, 0.0]), convention("e3nn"), "transfer")
    with pytest.raises(ValueError, match="unknown convention 'unity3d': choose one of three, unity"):
        convention("unity3d")
    with pytest.raises(ValueError, match="no square"):
        encoded(np.ones(5), convention("e3nn"), "light")


def test_lights_transfers_and_arrays_go_whole() -> None:
    values = gash_jax.project_light(RNG.uniform(size=(8, 16, 3)))
    numbers = gash_jax.to_convention(values, "unreal")
    assert numbers.shape == (9, 3) and numbers.dtype == np.float32
    np.testing.assert_allclose(numbers, encoded(values.coefficients.T, convention("unreal"), "light").T, atol=1e-6)
    back = gash_jax.from_convention(numbers, "unreal")
    assert isinstance(back, gash_jax.Light) and back.metadata["source"] == "Unreal FSHVectorRGB"
    np.testing.assert_allclose(back.coefficients, values.coefficients, atol=1e-5)
    coloured = RNG.normal(size=(5, 9, 3)).astype(np.float32)
    theirs = gash_jax.to_convention(coloured, "unity")
    np.testing.assert_allclose(theirs[..., 1], gash_jax.to_convention(coloured[..., 1], "unity"), atol=1e-6)
    np.testing.assert_allclose(np.asarray(gash_jax.from_convention(theirs, "unity")), coloured, atol=1e-5)
    with pytest.raises(ValueError, match="coefficients have shape"):
        gash_jax.to_convention(np.ones(9), "unity")


def test_the_basis_of_the_package_is_the_one_that_is_meant() -> None:
    np.testing.assert_allclose(evaluate_sh(DIRECTIONS.astype(np.float32), 4), ours(DIRECTIONS, 4), atol=1e-6)
