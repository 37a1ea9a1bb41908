"""How many bands a light needs on a given mesh: from the radiance that shadowed transfer makes of each band.

Band l adds r_l = sum_m t_lm L_lm to the radiance of a white vertex, with transfer t and light L. Without shadows the
odd bands from l = 3 on add nothing (Ramamoorthi & Hanrahan 2001); where there are shadows they add as much as the even
ones beside them. So t is estimated with its shadows, by a few rays at a sample of vertices. What B bands leave out,
relative to all bands of the light and as an rms over vertices and colours, is

    left out(B) = sqrt( E[ |sum over l >= B of r_l|² ] / E[ |sum over all l of r_l|² ] ).

*Noise is no signal.* Each vertex has two independent rows of `RAYS` rays, a and b. Of their two estimates the products
r^a r^b are summed, whose expectation is r²: the noise of the rays, which the squares of one estimate would count as
radiance in the high bands, averages out. What remains uncertain, from rays and from the choice of vertices, is the
standard error of a ratio of means (Cochran, Sampling Techniques, 1977, eq. 2.46); `left_out` lies two of them above the
estimate.

A ray needs no coefficients: with L_l(w) = sum_m L_lm Y_lm(w), r_l is the mean over the rays of V(w) L_l(w), here
blended with its closed form by the share of free rays as in `integrands`.
"""

from functools import partial

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.sh import band_index, bands_of, sh_components
from gash_jax.prt.rays import VisibilityFn
from gash_jax.prt.sampling import COSINE
from gash_jax.prt.tracing import Chunk, Integrand, Rows, trace_rows

LEFT_OUT = 0.05  # of the radiance, at most
RAYS = 64  # of each of the two rows of a vertex


def bands_for(
    light: Float[np.ndarray, "k 3"], rows: Rows, visible: VisibilityFn, rng: np.random.Generator
) -> tuple[int, float]:
    """Fewest bands that leave out at most `LEFT_OUT` of the radiance at the vertices, and what they leave out."""
    left_out = radiance_left_out(light, rows, visible, rng)
    bands = int(np.argmax(left_out <= LEFT_OUT))
    return max(bands, 1), float(left_out[max(bands, 1)])


def radiance_left_out(
    light: Float[np.ndarray, "k 3"], rows: Rows, visible: VisibilityFn, rng: np.random.Generator
) -> Float[np.ndarray, "n"]:
    """Share of the radiance that the first 0, 1, ... all bands of the light leave out (module docstring)."""
    pairs = rows._replace(shifts=rng.random((len(rows.origins), 2, 2), np.float32))
    bands = bands_of(len(light))
    radiance, _ = trace_rows(pairs, Integrand(COSINE, "any", partial(_radiance_by_band, light)), RAYS, visible)
    beyond = np.cumsum(radiance.astype(np.float64)[:, :, ::-1], axis=2)[:, :, ::-1]
    products = np.einsum("vlc,vlc->vl", beyond[:, 0], beyond[:, 1])  # (v, l): of all bands from l on
    total = products[:, 0].mean()
    if total <= 0:  # no light, or none that reaches a vertex: nothing can be left out
        return np.zeros(bands + 1)
    ratio = products.mean(0) / total
    residual = products - ratio * products[:, :1]
    spread = np.sqrt(np.mean(residual**2, axis=0) / len(products)) / total
    return np.append(np.sqrt(np.maximum(ratio + 2 * spread, 0.0)), 0.0)


def _radiance_by_band(light: Float[np.ndarray, "k 3"], chunk: Chunk) -> Float[np.ndarray, "c r l 3"]:
    """r_l of every row; the rows of a vertex share its share of free rays."""
    directions, bands = chunk.directions, bands_of(len(light))
    share, factors = chunk.share[:, None], clamped_cosine_coefficients(bands) / np.pi
    weight = (chunk.answer - share[..., None]).astype(np.float32) / directions.shape[2]
    formula = _seen(chunk.rows.frames[..., 2], light * factors[:, None]).reshape(-1, 1, bands, 3)
    sums = np.matmul(weight[:, :, None], _seen(directions, light)).reshape(*weight.shape[:2], bands, 3)
    return (sums + share[..., None, None] * formula).astype(np.float32)


def _seen(directions: Float[np.ndarray, "*s 3"], light: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "*s n"]:
    """L_l(w) of every direction: bands one after the other, three colours each."""
    bands = bands_of(len(light))
    x, y, z = directions.reshape(-1, 3).T
    harmonics = np.stack(sh_components(x, y, z, bands), axis=-1)
    by_band = (band_index(bands)[:, None] == np.arange(bands))[..., None] * light[:, None]
    seen = harmonics @ by_band.reshape(len(light), -1).astype(np.float32)  # one product of matrices
    return seen.reshape(*directions.shape[:-1], -1)
