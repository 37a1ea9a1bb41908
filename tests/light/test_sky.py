"""Daylight: the published formula by hand, quadrature, what must hold of any clear sky; what is out of range."""

from typing import Any

import numpy as np
import pytest

import gash_jax
from gash_jax.formats.primaries import REC_709, xyz_to_rec_709
from gash_jax.light.layouts import pixel_directions, pixel_solid_angles
from gash_jax.light.sky import perez, sky_radiance, sun_irradiance, sun_sky_light
from gash_jax.light.sources import toward

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])  # of Rec. 709
ZENITH = np.array([[0.0, 1.0, 0.0]])


def test_perez_by_hand() -> None:
    """The CIE's standard clear sky, A = -1, B = -0.32, C = 10, D = -3, E = 0.45, at the zenith with the sun 60 degrees
    from it: (1 - e^-0.32) (1 + 10 e^-pi + 0.45 / 4) = 0.2738510 x 1.5446392."""
    found = perez(1.0, 0.5, np.array([-1.0, -0.32, 10.0, -3.0, 0.45]))
    assert found == pytest.approx(0.2738510 * 1.5446392, rel=1e-6)


def test_the_zenith_by_hand() -> None:
    """T = 2, sun 60 degrees from the zenith: chi = (4/9 - 1/60) pi/3, Y = 3.1196 tan chi + 1.9882 kcd/m²; with
    s = pi/3 = 1.0471976, s² = 1.0966227, s³ = 1.1483807
    x = 4 (0.0019063 - 0.0041123 + 0.0021886) + 2 (-0.0333375 + 0.0699316 - 0.0335313 + 0.00394)
        + 0.1342802 - 0.2324402 + 0.0633764 + 0.25886 = 0.2380120."""
    s = np.pi / 3
    luminance = (4.0453 * 2 - 4.9710) * np.tan((4 / 9 - 2 / 120) * (np.pi - 2 * s)) - 0.2155 * 2 + 2.4192
    assert luminance == pytest.approx(3.1196 * np.tan(0.4479679) + 1.9882, abs=1e-4)
    colour = sky_radiance(ZENITH, toward(0, 30), 2.0)[0]
    xyz = np.linalg.inv(xyz_to_rec_709()) @ colour
    assert xyz[1] == pytest.approx(luminance, rel=1e-9)
    assert xyz[0] / xyz.sum() == pytest.approx(0.2380120, abs=2e-6)


# A .. E of Y, x and y at T = 2 and T = 5, worked out from the paper's table by hand
AT_2 = ([-1.1056, -0.2833, 5.2797, -2.3359, 0.2363], [-0.2978, -0.1322, 0.2117, -1.0271, 0.0386])
AT_2 += ([-0.2942, -0.1808, 0.1944, -1.7419, 0.0311],)
AT_5 = ([-0.5695, -1.3495, 5.2116, -1.9741, 0.0353], [-0.3557, -0.3317, 0.2105, -1.2194, 0.0287])
AT_5 += ([-0.3443, -0.4658, 0.1707, -1.8742, -0.0016],)


@pytest.mark.parametrize(("turbidity", "table"), [(2.0, AT_2), (5.0, AT_5)])
def test_luminance_and_colour_by_hand(turbidity: float, table: tuple) -> None:
    """45 degrees from the zenith and 15 from the sun, which is 60 degrees from the zenith: over those of the zenith."""
    both = sky_radiance(np.stack([toward(0, 45), toward(0, 90)]), toward(0, 30), turbidity)
    xyz = both @ np.linalg.inv(xyz_to_rec_709()).T
    found = np.stack([xyz[:, 1], xyz[:, 0] / xyz.sum(1), xyz[:, 1] / xyz.sum(1)])
    for (a, b, c, d, e), (there, above) in zip(table, found, strict=True):
        near, far = np.radians(15), np.radians(60)
        upper = (1 + a * np.exp(b * np.sqrt(2))) * (1 + c * np.exp(d * near) + e * np.cos(near) ** 2)
        lower = (1 + a * np.exp(b)) * (1 + c * np.exp(d * far) + e / 4)
        assert there / above == pytest.approx(upper / lower, rel=1e-9)


def test_white_of_unit_luminance_is_one() -> None:
    x, y = REC_709[6:]
    np.testing.assert_allclose(xyz_to_rec_709() @ [x / y, 1.0, (1 - x - y) / y], [1, 1, 1], rtol=1e-12)
    np.testing.assert_allclose(np.linalg.inv(xyz_to_rec_709())[1], LUMINANCE, atol=1e-4)


def test_the_sun_by_hand() -> None:
    """In the zenith m = 1 / (1 + 0.15 / 93.885^1.253) = 0.9994937; green, T = 3:
    0.008735 / 0.549^4.08 = 0.1008819, 0.09238 / 0.549^1.3 = 0.2014266, so 127.5 e^-0.3021555."""
    assert sun_irradiance(90.0, 3.0)[1] == pytest.approx(127.5 * np.exp(-0.3021555), rel=2e-4)


@pytest.mark.parametrize("turbidity", [2.0, 3.0, 6.0])
def test_a_sky_is_brightest_at_the_sun_bluest_away_from_it_and_even_about_their_plane(turbidity: float) -> None:
    sun = toward(0, 40)
    directions = pixel_directions(64, 128, slice(32))
    sky = sky_radiance(directions, sun, turbidity)
    luminance = sky @ LUMINANCE
    high = directions[..., 1] > 0.4  # in very clear air the horizon below the sun is brighter
    assert directions[high][np.argmax(luminance[high])] @ sun > np.cos(np.radians(4))
    np.testing.assert_allclose(sky, sky[:, ::-1], rtol=1e-9)  # x -> -x, with the sun at azimuth 0
    ahead, behind = (sky_radiance(toward(a, 50)[None], sun, turbidity)[0] for a in (0.0, 180.0))
    assert behind[2] / behind[0] > ahead[2] / ahead[0]
    assert (sky > 0).all()


def test_low_suns_are_red_and_high_ones_bright() -> None:
    light = np.array([sun_irradiance(e, 3.0) for e in (0.0, 2.0, 10.0, 30.0, 90.0)])
    assert (np.diff(light, axis=0) > 0).all()
    assert (np.diff(light[:, 0] / light[:, 2]) < 0).all()
    assert 80 < light[-1] @ LUMINANCE < 110  # klx, of a sun overhead in clear air


def test_the_coefficients_are_sun_sky_and_ground() -> None:
    """Irradiance of a level surface: sky by quadrature, plus the sun times the sine of its elevation; from below the
    ground's radiance times pi."""
    found = sun_sky_light(35.0, 70.0, 2.5, [0.1, 0.2, 0.5], bands=10)
    w, area = pixel_directions(512, 1024, slice(256)), pixel_solid_angles(512, 1024)[:256, None]
    sky = np.einsum("hwc,hw->c", sky_radiance(w, toward(70, 35), 2.5), w[..., 1] * area)
    down = sky + sun_irradiance(35.0, 2.5) * np.sin(np.radians(35.0))
    level = gash_jax.unshadowed_transfer(np.array([[0.0, 1, 0], [0, -1, 0]]), 10)
    radiance = np.asarray(gash_jax.shade(level, found))
    np.testing.assert_allclose(radiance[0] * np.pi, down, rtol=0.02)
    np.testing.assert_allclose(radiance[1] * np.pi, np.array([0.1, 0.2, 0.5]) * down, rtol=0.1)
    mean = np.asarray(found.coefficients)[0] / (2 * np.sqrt(np.pi)) * 4 * np.pi  # all there is, exactly
    ground = np.array([0.1, 0.2, 0.5]) / np.pi * down * 2 * np.pi
    everything = np.einsum("hwc,hw->c", sky_radiance(w, toward(70, 35), 2.5), area + 0 * w[..., 1])
    np.testing.assert_allclose(mean, everything + ground + sun_irradiance(35.0, 2.5), rtol=1e-3)


def test_the_azimuth_turns_the_light() -> None:
    turned = gash_jax.rotate_light(sun_sky_light(20.0, 0.0), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]))
    np.testing.assert_allclose(turned.coefficients, sun_sky_light(20.0, 90.0).coefficients, atol=2e-4)


def test_without_its_disk_the_sky_remains() -> None:
    whole, sky = sun_sky_light(30.0, sun=0.5, ground=0), sun_sky_light(30.0, sun=0, ground=0)
    sun = gash_jax.directional_light(toward(0, 30), 0.5 * sun_irradiance(30.0, 3.0))
    difference = np.asarray(whole.coefficients) - np.asarray(sky.coefficients)
    np.testing.assert_allclose(difference, sun.coefficients, atol=2e-3)  # of 30: the disk is nearly a direction


ANY: Any = sun_sky_light


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ANY(-1), "elevation is -1: use a number from 0 to 90"),
        (lambda: ANY("noon"), "elevation is 'noon'"),
        (lambda: ANY(azimuth=np.nan), "azimuth"),
        (lambda: ANY(turbidity=1), "turbidity is 1: use a number from 2 to 6"),
        (lambda: ANY(ground=1.5), "ground is 1.5: use a reflectance from 0 to 1"),
        (lambda: ANY(ground=-1), "0 or more"),
        (lambda: ANY(sun=-1), "sun is -1"),
        (lambda: ANY(bands=0), "bands is 0"),
    ],
)
def test_what_is_out_of_range_is_refused(make: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()
