"""Windows against ringing: factors w_l for the bands of a light, by name.

Few bands of a light that is small and bright are negative in places. `hann` and `lanczos` taper the bands to their
first zero at l = bands (`algebra.sh`), whatever the light. The other two do as little as is needed for this light:

    w_l = 1 / (1 + lambda l² (l + 1)²),

the factor that a penalty lambda on the squared Laplacian of the light gives (Sloan, Stupid Spherical Harmonics Tricks,
2008), with one lambda for all colours, the least at which no colour goes below -1e-6 of its mean in any direction:

- `radiance`: the light itself. Its transfer past any occluder is then an integral of light that is nowhere negative,
  so no shadowed vertex is negative.
- `irradiance`: the irradiance of unshadowed surfaces. Keeps more of the light; shadowed vertices may be negative.

*The least lambda.* How far a light dips is no monotone function of lambda, so it is searched for from 0 upwards in
steps of 4 %, then between the first step that does and the one before. The search ends: as |sum over m of L_lm Y_lm| is
at most sqrt((2l+1) / 4 pi) |L_l|, a light is positive at the latest where these bounds, each over lambda l² (l+1)², add
up to the mean. A light that was nowhere negative before it was cut to bands has |L_l| <= sqrt((2l+1) 4 pi) times the
mean, and the sum of (2l+1) / (l² (l+1)²) is 1: for any such light, in any number of bands, lambda = 1 is enough.
"""

import math
from functools import cache, partial

import numpy as np
from jax import Array
from jax.core import Tracer
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import shown
from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.directions import orthonormal_frame, spherical_fibonacci
from gash_jax.algebra.sh import band_index, bands_of, hann_window, lanczos_window, sh_components
from gash_jax.light.container import LightLike, light_coefficients

WINDOWS = ("hann", "lanczos", "irradiance", "radiance")
DIP = 1e-6  # of the mean, below zero, that counts as none
_DIRECTIONS, _CANDIDATES = 4096, 8  # directions that are tried; lowest local minima of a colour that are refined
_STEPS, _SPAN, _HALVINGS = 236, 1e-4, 16  # of lambda: steps of 4 % over four decades; then halvings
_ZOOMS = 9  # of the neighbourhood of a candidate, each to a third


def light_window(light: LightLike, kind: str = "radiance") -> Float[np.ndarray, "k"]:
    """Factors (k,) of a window for a light: "hann", "lanczos", or the least for "irradiance" or "radiance" >= 0.

    `shade` takes them as `window`, or the kind by its name; what a file holds is never windowed. The least window is
    searched for, so the light must be known: under jit, make the window before. Raises ValueError for another kind, and
    for a light whose mean is negative in a colour, which no window helps.

    >>> sun = gash_jax.directional_light([0.0, 1.0, 0.0])
    >>> least = gash_jax.light_window(sun, "irradiance")
    >>> [round(float(factor), 3) for factor in least[[0, 1, 4]]]
    [1.0, 0.584, 0.135]
    >>> shaded = gash_jax.shade(gash_jax.bake_transfer("bunny.ply", rays=64), sun, window="radiance")
    """
    if kind not in WINDOWS:
        raise ValueError(f"window is {shown(kind)}: use {', '.join(WINDOWS)}, or a factor for each coefficient")
    coefficients = light_coefficients(light)
    bands = bands_of(len(coefficients))
    if kind in ("hann", "lanczos"):
        return (hann_window if kind == "hann" else lanczos_window)(bands, bands)
    if isinstance(coefficients, Tracer):
        raise ValueError(f"the window {kind!r} is searched for: make it with light_window outside of jit, give numbers")
    return _factors(bands, _least_lambda(_seen_by(coefficients, kind)))


def least_share(light: LightLike, kind: str = "radiance") -> float:
    """The least radiance (or `irradiance` / pi) of a light in any direction and colour, as a share of the colour's
    mean; 0 for a black light, -inf where a mean is negative."""
    radiance = _seen_by(light_coefficients(light), kind)
    lit = radiance[:, np.any(radiance != 0, axis=0)]
    if not lit.size:
        return 0.0
    return _least(_relative(lit)) if (lit[0] > 0).all() else -math.inf


def kept(window: Float[np.ndarray, "k"]) -> str:
    """What a window keeps of bands 1 and 2, in words."""
    parts = [f"{window[band * band]:.2f} of l = {band}" for band in range(1, min(3, bands_of(len(window))))]
    return " and ".join(parts) or "everything: there is one band"


def _seen_by(coefficients: Float[Array | np.ndarray, "k 3"], kind: str) -> Float[np.ndarray, "k 3"]:
    """The coefficients of what must not be negative, float64."""
    values = np.asarray(coefficients, np.float64)
    if not np.isfinite(values).all():
        raise ValueError("the light holds values that are not finite: project the map again")
    if kind == "radiance":
        return values
    return values * (clamped_cosine_coefficients(bands_of(len(values))) / math.pi)[:, None]


def _factors(bands: int, strength: float) -> Float[np.ndarray, "k"]:
    band = band_index(bands).astype(np.float64)
    return 1.0 / (1.0 + strength * (band * (band + 1.0)) ** 2)


def _relative(lit: Float[np.ndarray, "k c"]) -> Float[np.ndarray, "k c"]:
    """Coefficients of colours that are lit, over their mean: L = sum of c_k Y_k is 1 on average."""
    return lit / (lit[0] / (2.0 * math.sqrt(math.pi)))


def _least_lambda(coefficients: Float[np.ndarray, "k 3"]) -> float:
    """The least strength of the window at which no colour dips below zero (module docstring)."""
    lit = coefficients[:, np.any(coefficients != 0, axis=0)]
    if not lit.size:
        return 0.0
    if (lit[0] <= 0).any():
        raise ValueError("the mean of the light is negative in a colour: no window makes it positive")
    light, band = _relative(lit), np.arange(bands_of(len(lit)))
    cuts = band[1:] ** 2  # where bands begin
    pairs = zip(np.split(_basis(len(band)), cuts, axis=1), np.split(light, cuts), strict=True)
    dips = partial(_dips, light, np.stack([basis @ part for basis, part in pairs]))
    if not light[1:].any() or not dips(0.0):
        return 0.0
    size = np.sqrt(np.add.reduceat(light**2, band**2, axis=0))  # |L_l| of each colour
    bound = np.sqrt((2 * band + 1) / (4.0 * math.pi))[1:, None] * size[1:]
    most = float(np.max(np.sum(bound / ((band * (band + 1.0)) ** 2)[1:, None], axis=0)))
    steps = [0.0, *np.geomspace(_SPAN * most, most, _STEPS)]
    above = next((i for i, strength in enumerate(steps) if i and not dips(strength)), len(steps) - 1)
    low, high = steps[above - 1], steps[above]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if dips(middle) else (low, middle)
    return high


def _dips(light: Float[np.ndarray, "k c"], parts: Float[np.ndarray, "b n c"], strength: float) -> bool:
    """Whether a light of mean 1 is, windowed, below -DIP anywhere; `parts` are its bands in the fixed directions."""
    factors = _factors(len(parts), strength)
    if np.min(np.tensordot(factors[np.arange(len(parts)) ** 2], parts, 1)) < -DIP:
        return True
    return _least(light * factors[:, None]) < -DIP


def _least(light: Float[np.ndarray, "k c"]) -> float:
    """The least value of any colour in any direction: from the lowest of fixed directions, closer and closer."""
    bands = bands_of(len(light))
    values, neighbours = _basis(bands) @ light, _neighbours()
    dips = np.where((values <= values[neighbours].min(axis=1)), values, math.inf)
    lowest = np.argsort(dips, axis=0)[:_CANDIDATES]  # (n, c) local minima of each colour
    colours = light[:, np.broadcast_to(np.arange(light.shape[1]), lowest.shape).ravel()]
    centre, spacing = spherical_fibonacci(_DIRECTIONS)[lowest.ravel()], math.sqrt(4.0 * math.pi / _DIRECTIONS)
    steps = np.linspace(-1.0, 1.0, 7)
    right, up = (grid.ravel() for grid in np.meshgrid(steps, steps))
    found = np.zeros((len(centre), len(right)))
    for zoom in range(_ZOOMS):
        around = spacing / 3.0**zoom * np.stack([right, up, 0.0 * up])
        near = centre[:, None] + np.einsum("nij,jg->ngi", np.asarray(orthonormal_frame(centre)), around)
        near /= np.linalg.norm(near, axis=-1, keepdims=True)
        harmonics = _evaluated(near, bands)
        found = np.matmul(harmonics, colours.T[..., None])[..., 0]
        centre = near[np.arange(len(near)), np.argmin(found, axis=1)]
    return float(np.min(found))


@cache
def _basis(bands: int) -> Float[np.ndarray, "n k"]:
    return _evaluated(spherical_fibonacci(_DIRECTIONS), bands)


def _evaluated(directions: Float[np.ndarray, "*n 3"], bands: int) -> Float[np.ndarray, "*n k"]:
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack(sh_components(x, y, z, bands), axis=-1)


@cache
def _neighbours() -> Int[np.ndarray, "n 8"]:
    from scipy.spatial import KDTree  # not needed until a window is searched for

    directions = spherical_fibonacci(_DIRECTIONS)
    _, found = KDTree(directions).query(directions, 9)
    return np.asarray(found)[:, 1:]
