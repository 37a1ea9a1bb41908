"""Clear daylight: sun, sky and the ground that they light, in thousands of candelas per square metre (kcd/m²).

*Sky*: Preetham, Shirley and Smits, A Practical Analytic Model for Daylight (1999), appendix A.2. At zenith angle t and
angle g from the sun, luminance Y and chromaticities x, y are each a value at the zenith times F(t, g) / F(0, s),

    F(t, g) = (1 + A exp(B / cos t)) (1 + C exp(D g) + E cos² g)        (Perez et al. 1993)

with s the sun's zenith angle and A .. E linear in the turbidity, from 2 (very clear) to 6 (light haze), where the
fit ends. From (x, y, Y) to linear Rec. 709; the deepest blues have a negative red, which is not clipped.

*Sun*: a disk 0.533 degrees across. Above the atmosphere a surface facing it gets 127.5 klx (IES); the air leaves
exp(-0.008735 w^-4.08 m) of that by Rayleigh scattering and exp(-(0.04608 T - 0.04586) w^-1.3 m) by haze (Preetham et
al., appendix A.1, whose small losses to ozone, gases and vapour are left out), with the air mass
m = 1 / (cos s + 0.15 (93.885 - s)^-1.253), s in degrees, at the wavelengths w = 0.611, 0.549, 0.464 micrometres where
the primaries of Rec. 709 lie.

*Ground*: below the horizon, of one radiance, reflectance / pi times what sun and sky send down to it.
"""

import math

import numpy as np
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike, RealNumber, WholeNumber, real_number, shown
from gash_jax.algebra.closed_forms import cap
from gash_jax.algebra.sh import band_index, evaluate_sh, validate_bands
from gash_jax.formats.primaries import xyz_to_rec_709
from gash_jax.light.container import Light, light_metadata
from gash_jax.light.layouts import pixel_directions, pixel_solid_angles
from gash_jax.light.projection import project_map
from gash_jax.light.sources import checked_colour, toward

ROWS = 256  # of the map that is projected: even, so that the horizon lies between two rows
SUN_HALF_ANGLE = math.radians(0.533 / 2)
ILLUMINANCE = 127.5  # klx, above the atmosphere
WAVELENGTHS = np.array([0.611, 0.549, 0.464])
# A .. E of Y, x and y: slope in turbidity, constant
_PEREZ = np.array(
    [
        [[0.1787, -1.4630], [-0.3554, 0.4275], [-0.0227, 5.3251], [0.1206, -2.5771], [-0.0670, 0.3703]],
        [[-0.0193, -0.2592], [-0.0665, 0.0008], [-0.0004, 0.2125], [-0.0641, -0.8989], [-0.0033, 0.0452]],
        [[-0.0167, -0.2608], [-0.0950, 0.0092], [-0.0079, 0.2102], [-0.0441, -1.6537], [-0.0109, 0.0529]],
    ]
)
# x and y at the zenith: rows T², T, 1; columns s³, s², s, 1
_ZENITH = np.array(
    [
        [
            [0.00166, -0.00375, 0.00209, 0.0],
            [-0.02903, 0.06377, -0.03202, 0.00394],
            [0.11693, -0.21196, 0.06052, 0.25886],
        ],
        [
            [0.00275, -0.00610, 0.00317, 0.0],
            [-0.04214, 0.08970, -0.04153, 0.00516],
            [0.15346, -0.26756, 0.06670, 0.26688],
        ],
    ]
)


def sun_sky_light(
    elevation: RealNumber = 45.0,
    azimuth: RealNumber = 0.0,
    turbidity: RealNumber = 3.0,
    ground: RealNumber | ArrayLike | Array = 0.2,
    sun: RealNumber = 1.0,
    bands: WholeNumber = 3,
) -> Light:
    """Clear daylight in kcd/m²: the sun at an elevation of 0 to 90 degrees, sky of turbidity 2 to 6, lit ground.

    `azimuth` in degrees from +z towards +x; `ground` is the reflectance of what lies below the horizon, a number or a
    colour (3,) up to 1; `sun` multiplies the sun's disk and what the ground has of it, so 0 leaves the sky alone. The
    disk is sharp, so that few bands ring: see `light_window`. Raises ValueError for what is out of range.

    >>> noon, evening = gash_jax.sun_sky_light(60), gash_jax.sun_sky_light(5)
    >>> bool(noon.coefficients[0, 1] > 2 * evening.coefficients[0, 1])
    True
    >>> red, _, blue = evening.coefficients[2]  # along +z, where the sun is
    >>> bool(red > 2 * blue)
    True
    """
    bands, reflectance = validate_bands(bands), np.asarray(checked_colour("ground", ground), np.float64)
    if reflectance.max() > 1:
        raise ValueError(f"ground is {shown(ground)}: use a reflectance from 0 to 1")
    height = _number("elevation", elevation, 0.0, 90.0)
    haze = _number("turbidity", turbidity, 2.0, 6.0)
    disk = _number("sun", sun, 0.0, 1e6) * sun_irradiance(height, haze)
    to_sun = toward(_number("azimuth", azimuth, -360.0, 360.0), height)
    image = np.zeros((ROWS, 2 * ROWS, 3))
    directions = pixel_directions(ROWS, 2 * ROWS, slice(ROWS // 2))
    image[: ROWS // 2] = sky_radiance(directions, to_sun, haze)
    down = (directions[..., 1] * pixel_solid_angles(ROWS, 2 * ROWS)[: ROWS // 2, None])[..., None]
    image[ROWS // 2 :] = reflectance / math.pi * (np.sum(image[: ROWS // 2] * down, axis=(0, 1)) + disk * to_sun[1])
    factors = np.asarray(cap(bands, SUN_HALF_ANGLE), np.float64) / (math.pi * math.sin(SUN_HALF_ANGLE) ** 2)
    direct = factors[band_index(bands)] * np.asarray(evaluate_sh(to_sun.astype(np.float32), bands), np.float64)
    coefficients = project_map(image, bands) + direct[:, None] * disk
    return Light(coefficients.astype(np.float32), light_metadata(bands, source="sun-sky"))


def sky_radiance(
    directions: Float[np.ndarray, "*n 3"], to_sun: Float[np.ndarray, "3"], turbidity: float
) -> Float[np.ndarray, "*n 3"]:
    """Radiance of the sky in unit directions above the horizon, kcd/m² in linear Rec. 709."""
    up, along = np.maximum(directions[..., 1], 1e-3), np.clip(directions @ to_sun, -1.0, 1.0)
    s = math.acos(min(to_sun[1], 1.0))
    chromaticities = turbidity ** np.array([2, 1, 0]) @ _ZENITH @ s ** np.array([3, 2, 1, 0])
    luminance, x, y = (
        value * perez(up, along, coefficients) / perez(1.0, math.cos(s), coefficients)
        for value, coefficients in zip(
            [_zenith_luminance(s, turbidity), *chromaticities], _PEREZ @ [turbidity, 1.0], strict=True
        )
    )
    xyz = np.stack([x, y, 1.0 - x - y], axis=-1) * np.asarray(luminance / y)[..., None]
    return xyz @ xyz_to_rec_709().T


def perez(
    up: Float[np.ndarray, "*n"] | float, along: Float[np.ndarray, "*n"] | float, coefficients: Float[np.ndarray, "5"]
) -> Float[np.ndarray, "*n"] | float:
    """F of a direction with the cosine `up` to the zenith and `along` to the sun (module docstring)."""
    a, b, c, d, e = coefficients
    return (1 + a * np.exp(b / up)) * (1 + c * np.exp(d * np.arccos(along)) + e * np.square(along))


def sun_irradiance(elevation: float, turbidity: float) -> Float[np.ndarray, "3"]:
    """What a surface facing the sun gets of its disk, klx in linear Rec. 709; elevation in degrees."""
    zenith = 90.0 - elevation
    mass = 1.0 / (math.cos(math.radians(zenith)) + 0.15 * (93.885 - zenith) ** -1.253)
    rayleigh, haze = 0.008735 * WAVELENGTHS**-4.08, (0.04608 * turbidity - 0.04586) * WAVELENGTHS**-1.3
    return ILLUMINANCE * np.exp(-(rayleigh + haze) * mass)


def _zenith_luminance(s: float, turbidity: float) -> float:
    chi = (4.0 / 9.0 - turbidity / 120.0) * (math.pi - 2.0 * s)
    return (4.0453 * turbidity - 4.9710) * math.tan(chi) - 0.2155 * turbidity + 2.4192


def _number(name: str, value: object, low: float, high: float) -> float:
    number = real_number(value)
    if number is None or not low <= number <= high:
        raise ValueError(f"{name} is {shown(value)}: use a number from {low:g} to {high:g}")
    return number
