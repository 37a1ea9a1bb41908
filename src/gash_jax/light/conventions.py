"""Everybody's conventions: light and transfer in the numbers of another program, and back.

Both sides have real spherical harmonics in the order k = l*l + l + m. What differs is which axes the basis stands on,
whether it carries the Condon-Shortley sign, and what was multiplied into the numbers. With P the matrix from our axes
to theirs, and D(P) the block matrix with Y(P n) = D(P) Y(n) (P may mirror, so it is no rotation in general),

    light     L'_k = g_k (D(P) L)_k + o delta_k0
    transfer  t'_k = (D(P) t)_k / g_k
    g_k     = (-1)^m where they have the Condon-Shortley sign
              * scale
              * A_l / pi * K_lm   where they hold the irradiance over pi as a polynomial in x, y, z

with A_l the clamped cosine, K_lm the constant of Y_lm before its polynomial (1; y, z, x; xy, yz, 3zz-1, xz, xx-yy) and
o a constant that they add to every radiance. Transfer is dual to light: sum_k t'_k (L'_k - o delta_k0) is the radiance
of a white surface in every convention, so that the sum over k with their light is all a shader has to do.

`engines` holds the records; the numbers of each are tested against the other side's own formula.
"""

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.directions import fibonacci_hemisphere
from gash_jax.algebra.sh import band_index, bands_of, sh_components

AXES = ("x", "y", "z")


class Fact(NamedTuple):
    """A statement about another program, and where it is published: program, file or document."""

    text: str
    source: str


class Convention(NamedTuple):
    """What another program means by the numbers of a light."""

    name: str
    title: str
    axes: tuple[str, str, str]  # their x, y, z in our axes, such as ("x", "y", "-z")
    bands: tuple[int, int]  # fewest and most that it reads
    condon_shortley: bool
    pi: str  # who divides irradiance by pi
    facts: tuple[Fact, ...]
    scale: float = 1.0
    polynomial: bool = False
    offset: float = 0.0  # added to every radiance
    turn: int | None = None  # degrees about +y from where we see a latlong map to where it is seen there

    def factors(self, bands: int) -> Float[np.ndarray, " k"]:
        """g_k, float64."""
        band = band_index(bands)
        m = np.arange(len(band)) - band * (band + 1)
        factors = np.full(len(band), self.scale)
        if self.condon_shortley:
            factors[m % 2 == 1] *= -1.0
        if self.polynomial:
            factors *= clamped_cosine_coefficients(bands) / np.pi * polynomial_constants(bands)
        return factors

    def constant(self, bands: int) -> Float[np.ndarray, " k"]:
        """o delta_k0 as a coefficient, float64."""
        constant = np.zeros(bands * bands)
        constant[0] = -self.offset * math.sqrt(4.0 * np.pi)
        return constant


def polynomial_constants(bands: int) -> Float[np.ndarray, " k"]:
    """K_lm of up to three bands: what stands before 1; y, z, x; xy, yz, 3zz-1, xz, xx-yy."""
    squares = [1 / 4, 3 / 4, 3 / 4, 3 / 4, 15 / 4, 15 / 4, 5 / 16, 15 / 4, 15 / 16]
    return np.sqrt(np.array(squares[: bands * bands]) / np.pi)


def encoded(coefficients: Float[Any, "*v k"], convention: Convention, kind: str) -> Float[np.ndarray, "*v k"]:
    """Coefficients, k on the last axis, in the numbers of another program, float64; `kind` is "light" or "transfer".

    Raises ValueError, one line, for bands that it does not read and for values that are not finite.
    """
    ours, bands = _checked(coefficients, convention)
    turned = ours @ basis_change(convention.axes, bands).T
    factors = convention.factors(bands)
    return turned * factors + convention.constant(bands) if kind == "light" else turned / factors


def decoded(coefficients: Float[Any, "*v k"], convention: Convention, kind: str) -> Float[np.ndarray, "*v k"]:
    """The way back of `encoded`, with the same errors."""
    theirs, bands = _checked(coefficients, convention)
    factors = convention.factors(bands)
    plain = (theirs - convention.constant(bands)) / factors if kind == "light" else theirs * factors
    return plain @ basis_change(convention.axes, bands)


def axis_map(axes: tuple[str, str, str]) -> Float[np.ndarray, "3 3"]:
    """P: their coordinates of a direction given in ours."""
    rows = np.zeros((3, 3))
    for row, axis in zip(rows, axes, strict=True):
        row[AXES.index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
    return rows


@cache
def basis_change(axes: tuple[str, str, str], bands: int) -> Float[np.ndarray, "k k"]:
    """D(P) of an axis map, float64: Y at their coordinates from Y at ours.

    Solved from its definition at more directions than coefficients, which is exact but for rounding; what rounding left
    of a 0 is cut off.
    """
    above = fibonacci_hemisphere(2 * bands * bands + 8)
    directions = np.concatenate([above, -above[::2]])
    ours, theirs = (_basis(d, bands) for d in (directions, directions @ axis_map(axes).T))
    solution = np.linalg.lstsq(ours, theirs, rcond=None)[0].T
    return np.where(np.abs(solution) > 1e-12, solution, 0.0)


def _basis(directions: Float[np.ndarray, "n 3"], bands: int) -> Float[np.ndarray, "n k"]:
    x, y, z = directions.T
    return np.stack(sh_components(x, y, z, bands), axis=1)


def turn_map(image: Float[np.ndarray, "h w 3"], convention: Convention) -> Float[np.ndarray, "h w 3"]:
    """A latitude-longitude map as that program must be given it, so that it shows every light where we have it.

    Raises ValueError where it has no such maps, or where the width does not divide by 4.
    """
    if convention.turn is None:
        raise ValueError(f"{convention.title} has no latitude-longitude maps of its own: convert the light instead")
    if image.shape[1] % 4:
        raise ValueError(f"the map is {image.shape[1]} pixels wide, which has no quarter: resize it to a multiple of 4")
    # where we look at azimuth p they show p - turn; a turn about +y goes against the azimuth, which grows from -z to +x
    return np.roll(image, convention.turn * image.shape[1] // 360, axis=1)


def _checked(coefficients: Any, convention: Convention) -> tuple[Float[np.ndarray, "*v k"], int]:
    """Coefficients in float64 and their bands."""
    found = np.asarray(coefficients, np.float64)
    if not np.isfinite(found).all():
        raise ValueError("coefficients hold values that are not finite: make them again")
    bands = bands_of(found.shape[-1])
    least, most = convention.bands
    if bands > most:
        raise ValueError(
            f"{bands} bands, and {convention.title} reads {most}: keep the first {most} (--bands {most}), "
            "the others are left out"
        )
    if bands < least:
        raise ValueError(f"{bands} bands, and {convention.title} reads {least}: make it with --bands {least}")
    return found, bands
