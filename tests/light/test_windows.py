"""Windows: the least that does, against a scan that knows nothing of it; bounds; real bakes; numbers by hand."""

from typing import Any

import jax
import numpy as np
import pytest

import gash_jax
from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.directions import spherical_fibonacci
from gash_jax.algebra.sh import band_index, hann_window, lanczos_window, sh_components
from gash_jax.light.windows import DIP, WINDOWS, kept, least_share, light_window
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.shared_data import shared_file

FINE = spherical_fibonacci(20000)
MAPS = ("grace_256", "grace_latlong", "uffizi_256", "venice_sunset_1k")


def strength(window: np.ndarray) -> float:
    """lambda, from what is kept of l = 1."""
    return (1 / window[1] - 1) / 4


def factors(bands: int, lam: float) -> np.ndarray:
    band = band_index(bands)
    return 1 / (1 + lam * (band * (band + 1.0)) ** 2)


def harmonics(bands: int) -> np.ndarray:
    x, y, z = FINE.T
    return np.stack(sh_components(x, y, z, bands), -1)


def seen(light: np.ndarray) -> np.ndarray:
    """Radiance over its mean in many directions."""
    bands = round(len(light) ** 0.5)
    return harmonics(bands) @ light / (light[0] / (2 * np.sqrt(np.pi)))


def random_light(seed: int, bands: int, tint: float = 0.5) -> np.ndarray:
    """A few small suns and a dim sky: positive before it is cut to bands."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(3, 3))
    suns = [gash_jax.directional_light(d, rng.random(3) * tint + 0.1, bands).coefficients for d in directions]
    return np.sum(suns, axis=0, dtype=np.float64) + np.asarray(gash_jax.constant_light(0.05, bands).coefficients)


@pytest.mark.parametrize("bands", [3, 5])
@pytest.mark.parametrize("kind", ["radiance", "irradiance"])
def test_it_is_the_least_that_a_scan_finds(bands: int, kind: str) -> None:
    """The first of 4000 strengths, by 20000 directions: the search is never above it nor a step below."""
    suns = [
        gash_jax.directional_light(*sun, bands) for sun in (([1, 2, 3], [3.0, 2, 2]), ([-1, 0.5, 0], [0.1, 0, 0.2]))
    ]
    light = np.sum([sun.coefficients for sun in suns], axis=0, dtype=np.float64)
    judged = light * (clamped_cosine_coefficients(bands) / np.pi)[:, None] if kind == "irradiance" else light
    steps = np.linspace(0.0, 1.0, 4001)
    band = np.arange(bands)
    parts = _bands(np.asarray(judged))
    first = next(lam for lam in steps if np.tensordot(factors(bands, lam)[band**2], parts, 1).min() >= -DIP)
    found = strength(light_window(light, kind))
    assert first - 2 * steps[1] <= found <= first + 2 * steps[1]
    assert found > 0.01


def _bands(light: np.ndarray) -> np.ndarray:
    """Each band of a light over the mean, in many directions."""
    bands = round(len(light) ** 0.5)
    basis = harmonics(bands)
    mean = light[0] / (2 * np.sqrt(np.pi))
    return np.stack([basis[:, b * b : (b + 1) ** 2] @ light[b * b : (b + 1) ** 2] / mean for b in range(bands)])


@pytest.mark.parametrize("bands", [2, 3, 4, 10])
@pytest.mark.parametrize("kind", ["radiance", "irradiance"])
def test_what_it_leaves_is_nowhere_negative_and_touches_zero(bands: int, kind: str) -> None:
    light = random_light(bands, bands)
    window = light_window(light, kind)
    left = light * window[:, None]
    judged = left * (clamped_cosine_coefficients(bands) / np.pi)[:, None] if kind == "irradiance" else left
    assert seen(judged).min() >= -DIP * 1.01
    share = least_share(left, kind)
    assert share >= -DIP
    if window[1] < 1:
        assert share < 1e-4  # a weaker one would not do
        weaker = light * factors(bands, 0.98 * strength(window))[:, None]
        assert least_share(weaker, kind) < -DIP


def test_a_stronger_window_may_be_worse() -> None:
    """1 + 1.66 z + 0.8 (3 z² - 1) / 2 is 0.6 + 1.66 z + 1.2 z², at least 0.026: no window. With lambda = 0.1 it is
    1 - 1.66 / 1.4 + 0.8 / 4.6 = -0.012 at z = -1: where band 2 had lifted it, band 1 is damped less."""
    light = np.zeros((9, 3))
    light[[0, 2, 6]] = (np.array([1, 1.66, 0.8]) * np.sqrt(4 * np.pi / np.array([1, 3, 5])))[:, None]
    assert least_share(light) == pytest.approx(0.6 - 1.66**2 / 4.8, abs=1e-4)
    np.testing.assert_array_equal(light_window(light), 1.0)
    assert least_share(light * factors(3, 0.1)[:, None]) == pytest.approx(1 - 1.66 / 1.4 + 0.8 / 4.6, abs=1e-4)


def test_a_sun_by_hand() -> None:
    """Towards +z in two bands: 1 + 3 w z with w = 1 / (1 + 4 lambda) must be 0 at z = -1: w = 1/3, lambda = 1/2; its
    irradiance 1 + 2 w z: w = 1/2, lambda = 1/4. Three bands, radiance: 1 + 3 w1 z + 5 w2 (3 z² - 1) / 2 with
    lambda = 1/4, w1 = 1/2, w2 = 1/10: 3/4 + 3/2 z + 3/4 z² = 3/4 (1 + z)²."""
    sun = gash_jax.directional_light([0, 0, 1], bands=2)
    np.testing.assert_allclose(light_window(sun, "radiance")[1:], 1 / 3, rtol=1e-4)
    np.testing.assert_allclose(light_window(sun, "irradiance")[1:], 1 / 2, rtol=1e-4)
    window = light_window(gash_jax.directional_light([0, 0, 1]), "radiance")
    np.testing.assert_allclose(window[[0, 1, 4]], [1, 1 / 2, 1 / 10], rtol=2e-3)


@pytest.mark.parametrize("bands", [1, 2, 5, 10])
def test_lambda_of_one_is_enough_for_light_that_was_positive(bands: int) -> None:
    """The worst is a single sun: the sum of (2l+1) / (l² (l+1)²) is 1."""
    sun = np.asarray(gash_jax.directional_light([0.3, 0.2, -1], bands=bands).coefficients, np.float64)
    assert seen(sun * factors(bands, 1.0)[:, None]).min() > 0
    assert strength(light_window(sun)) < 1 if bands > 1 else light_window(sun).tolist() == [1.0]
    assert sum((2 * n + 1) / (n * (n + 1)) ** 2 for n in range(1, 2000)) == pytest.approx(1, abs=1e-6)


def test_one_window_serves_all_colours_and_the_worst_decides() -> None:
    sun = np.asarray(gash_jax.directional_light([0, 1, 0]).coefficients, np.float64)
    sky = np.asarray(gash_jax.constant_light().coefficients, np.float64)
    mixed = np.stack([sun[:, 0], sky[:, 0], sun[:, 0] + 3 * sky[:, 0]], axis=1)
    np.testing.assert_allclose(light_window(mixed), light_window(sun), rtol=1e-9)
    np.testing.assert_allclose(light_window(mixed * [1e-6, 1, 1e6]), light_window(sun), rtol=1e-9)
    dark = mixed * [1.0, 0, 0]  # black in two colours
    np.testing.assert_allclose(light_window(dark), light_window(sun), rtol=1e-9)


def test_it_does_nothing_where_nothing_rings() -> None:
    for light in (gash_jax.constant_light(2.0), np.zeros((9, 3)), gash_jax.constant_light(bands=1)):
        for kind in ("radiance", "irradiance"):
            np.testing.assert_array_equal(light_window(light, kind), 1.0)
    assert least_share(np.zeros((9, 3))) == 0 and least_share(gash_jax.constant_light(2.0)) == pytest.approx(1)


def test_hann_and_lanczos_end_at_the_bands() -> None:
    light = gash_jax.constant_light(bands=4)
    np.testing.assert_array_equal(light_window(light, "hann"), hann_window(4, 4))
    np.testing.assert_array_equal(light_window(light, "lanczos"), lanczos_window(4, 4))
    assert WINDOWS == ("hann", "lanczos", "irradiance", "radiance")
    assert kept(hann_window(3, 3)) == "0.75 of l = 1 and 0.25 of l = 2" and "one band" in kept(np.ones(1))


@pytest.mark.parametrize("seed", [0, 1])
def test_no_shadowed_vertex_of_a_bake_is_negative(seed: int) -> None:
    """The plain bake is a mean of V L(w), exactly; the default blends in the closed form, within its error."""
    light = random_light(seed, 3)
    for replicates, allowed in ((1, DIP), (4, 0.02)):
        transfer = gash_jax.bake_transfer(bumpy_sphere(8), rays=64, replicates=replicates)
        mean = light[0] / (2 * np.sqrt(np.pi))
        before = np.asarray(gash_jax.shade(transfer, light)) / mean
        after = np.asarray(gash_jax.shade(transfer, light, window="radiance")) / mean
        assert before.min() < -0.01
        assert after.min() >= -allowed - 1e-6  # rounding of float32


@pytest.mark.parametrize(("name", "first", "second"), [("grace_256", 0.80, 0.31), ("uffizi_256", 0.70, 0.21)])
def test_what_known_maps_keep(name: str, first: float, second: float) -> None:
    window = light_window(gash_jax.load_light(shared_file(f"hdr/{name}.hdr")), "radiance")
    np.testing.assert_allclose(window[[1, 4]], [first, second], atol=0.0075)


@pytest.mark.parametrize("name", MAPS)
def test_no_vertex_of_a_real_bake_is_negative_under_a_real_map(name: str) -> None:
    transfer = gash_jax.bake_transfer(shared_file("meshes/heart_coarse.ply"), rays=32, replicates=1)
    light = np.asarray(gash_jax.load_light(shared_file(f"hdr/{name}.hdr")).coefficients, np.float64)
    radiance = np.asarray(gash_jax.shade(transfer, light, window="radiance")) / (light[0] / (2 * np.sqrt(np.pi)))
    assert radiance.min() >= -2e-6


def test_shade_takes_the_name_and_leaves_the_light_alone() -> None:
    light = gash_jax.directional_light([0.0, 1, 0], bands=4)
    transfer = gash_jax.unshadowed_transfer(np.array([[0.8, -0.6, 0]]), 3)
    window = light_window(np.asarray(light.coefficients)[:9], "irradiance")  # of the bands that the transfer has
    np.testing.assert_array_equal(
        gash_jax.shade(transfer, light, window="irradiance"), gash_jax.shade(transfer, light, window=window)
    )
    assert float(gash_jax.shade(transfer, light)[0, 0]) < -0.03
    assert float(gash_jax.shade(transfer, light, window="irradiance")[0, 0]) > 0
    traced = jax.jit(lambda c: gash_jax.shade(transfer, c, window=window))(light.coefficients)
    np.testing.assert_allclose(traced, gash_jax.shade(transfer, light, window=window), atol=1e-6)
    hann = jax.jit(lambda c: gash_jax.shade(transfer, c, window="hann"))(light.coefficients)
    np.testing.assert_allclose(hann, gash_jax.shade(transfer, light, window=hann_window(3, 3)), atol=1e-6)


ANY: Any = gash_jax


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ANY.light_window(np.ones((9, 3)), "hamming"), "use hann, lanczos, irradiance, radiance"),
        (lambda: ANY.light_window(np.full((9, 3), np.nan)), "not finite"),
        (lambda: ANY.light_window(-np.ones((9, 3))), "negative in a colour"),
        (lambda: ANY.light_window(np.eye(9)[:, 1:4]), "negative in a colour"),
        (lambda: jax.jit(lambda c: ANY.light_window(c))(np.ones((9, 3), np.float32)), "outside of jit"),
    ],
)
def test_what_has_no_window_is_refused(call: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        call()
    assert least_share(-np.ones((9, 3))) == -np.inf
