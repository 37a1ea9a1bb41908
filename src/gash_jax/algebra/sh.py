"""Real orthonormal spherical harmonics.

Y_k with k = l*l + l + m, band l = 0 .. bands - 1, m = -l .. l; polar axis z; no Condon-Shortley sign:

    Y_lm = N_lm P_lm(z) * {sqrt(2) Im (x + iy)^|m|  (m < 0),  1  (m = 0),  sqrt(2) Re (x + iy)^m  (m > 0)}

with P_lm(z) the associated Legendre function divided by (1 - z^2)^(|m|/2), taken positive at z -> 1, and N_lm such that
the integral of Y_j Y_k over the sphere is delta_jk. Band 1 is (y, z, x) * sqrt(3 / 4 pi). The Legendre part runs on the
three-term recurrence in l (Press et al., Numerical Recipes 3rd ed., eq. 6.7.7), here for N_lm P_lm (eq. 6.7.9), whose
constants are formed in float64; (x + iy)^m by complex multiplication. Directions must be unit vectors. Transfer and
light have up to 10 bands; the basis is there in 19, which the product of two such functions has.

Windows taper the bands of a light against ringing: Hann (1 + cos(pi l/w))/2 and Lanczos sin(pi l/w)/(pi l/w),
both zero from l = w on.
"""

import functools
import math
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra.arguments import as_array, is_real, whole_number

Numbers: TypeAlias = Any  # arrays "..." of floats, or what else has their arithmetic
MAX_BANDS = 10  # of transfer and light
PRODUCT_BANDS = 2 * MAX_BANDS - 1  # of the product of two functions of MAX_BANDS bands


def validate_bands(bands: object, most: int = MAX_BANDS) -> int:
    """The number of bands as a Python int. Raises ValueError unless it is an integer from 1 to `most`."""
    return whole_number(bands, "bands", 1, most)


def bands_of(count: int, most: int = MAX_BANDS) -> int:
    """How many bands have `count` coefficients. Raises ValueError unless it is a whole number from 1 to `most`."""
    bands = math.isqrt(count)
    if bands * bands != count or not 1 <= bands <= most:
        raise ValueError(f"{count} coefficients are no square of bands from 1 to {most}")
    return bands


def radiance_coefficients(value: object) -> Float[Array | np.ndarray, "k 3"]:
    """Coefficients of light as the array they are. Raises ValueError unless they are (bands^2, 3) real numbers."""
    found = as_array(value)
    if found.ndim != 2 or found.shape[1] != 3 or not is_real(found):
        raise ValueError(
            f"light has shape {found.shape} {found.dtype}, not (bands^2, 3) real numbers, a column for each of red, "
            "green and blue: load_light and project_light make such a light"
        )
    bands_of(len(found))
    return found.astype(np.float32) if found.dtype.kind in "iu" else found


def band_index(bands: int) -> Int[np.ndarray, " k"]:
    """Band l of each coefficient k."""
    validate_bands(bands, PRODUCT_BANDS)
    return np.repeat(np.arange(bands), 2 * np.arange(bands) + 1)


def _recurrence(band: int, m: int, normalised: bool) -> tuple[float, float, float]:
    """(a, b, c) with c P_lm = a z P_(l-1)m - b P_(l-2)m."""
    if not normalised:
        return 2.0 * band - 1.0, band + m - 1.0, float(band - m)
    grow = math.sqrt((4 * band**2 - 1) / (band**2 - m**2))
    return grow, grow * math.sqrt(((band - 1) ** 2 - m**2) / (4 * (band - 1) ** 2 - 1)), 1.0


def legendre_functions(z: Numbers, first: Any, bands: int, m: int, *, normalised: bool = False) -> list[Any]:
    """P_lm(z) for l = m .. bands - 1 from `first` = P_mm, by the recurrence in l.

    Whatever factor `first` carries, all carry. With `normalised` they are N_lm P_lm from `first` = N_mm P_mm: these
    stay near 1 where P_lm grows as fast as m!.
    """
    values, previous = [first], 0.0
    for band in range(m + 1, bands):
        grow, fade, divisor = _recurrence(band, m, normalised)
        following = grow * z * values[-1] - fade * previous
        previous = values[-1]
        values.append(following if divisor == 1.0 else following / divisor)
    return values


def sh_components(x: Numbers, y: Numbers, z: Numbers, bands: int) -> list[Any]:
    """Evaluate the basis at unit vectors given as three arrays of one shape.

    Returns bands^2 separate arrays of that shape and dtype, which for large batches is several times faster than one
    array with a short last axis. Plain arithmetic: NumPy arrays in, NumPy arrays out; JAX arrays in, JAX arrays out,
    and so for whatever else adds and multiplies, as the values of a graph that is being exported do.
    """
    validate_bands(bands, PRODUCT_BANDS)
    components: list = [None] * (bands * bands)
    cosine, sine = 1.0, 0.0  # real and imaginary part of (x + iy)^m
    sectoral = math.sqrt(1.0 / (4.0 * math.pi))  # N_mm P_mm, times sqrt(2) from m = 1 on
    for m in range(bands):
        if m > 0:
            cosine, sine = (x * cosine - y * sine, x * sine + y * cosine) if m > 1 else (x, y)
            sectoral *= math.sqrt((2 * m + 1) / (2 * m)) * (math.sqrt(2.0) if m == 1 else 1.0)
        for band, legendre in enumerate(legendre_functions(z, x * 0.0 + sectoral, bands, m, normalised=True), start=m):
            centre = band * band + band
            components[centre + m] = legendre * cosine
            if m > 0:
                components[centre - m] = legendre * sine
    return components


@functools.partial(jax.jit, static_argnames="bands")
def evaluate_sh(directions: Float[Array | np.ndarray, "... 3"], bands: int) -> Float[Array, "... k"]:
    """Evaluate the basis at unit vectors; bands^2 values on the last axis."""
    directions = jnp.asarray(directions)
    x, y, z = (directions[..., axis] for axis in range(3))
    return jnp.stack([jnp.asarray(component) for component in sh_components(x, y, z, bands)], axis=-1)


def hann_window(bands: int, width: float | int) -> Float[np.ndarray, " k"]:
    """Hann factor for each coefficient k; the first band that vanishes is l = width."""
    ratio = _window_ratio(bands, width)
    return np.where(ratio < 1.0, (1.0 + np.cos(np.pi * ratio)) / 2.0, 0.0)


def lanczos_window(bands: int, width: float | int) -> Float[np.ndarray, " k"]:
    """Lanczos factor for each coefficient k; the first band that vanishes is l = width."""
    ratio = _window_ratio(bands, width)
    return np.where(ratio < 1.0, np.sinc(ratio), 0.0)


def _window_ratio(bands: int, width: float | int) -> Float[np.ndarray, " k"]:
    if not width > 0.0:
        raise ValueError(f"the width of a window is {width!r}: use a number of bands above 0")
    return band_index(bands) / float(width)
