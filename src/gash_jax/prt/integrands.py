"""What the rays of a bake are summed into: integrals over the hemisphere of a vertex, estimated row by row.

An `Integrand` (see `tracing`) says how densely its directions lie, which question its rays ask of the scene (whether
they meet anything, or the nearest face with barycentrics), and how the answers become one array per row. A new one is
a function that returns an `Integrand`. Two are here, both of the form integral of V(w) kernel(n.w) Y_k(w) dw:

    direct    kernel max(n.w, 0)/pi      diffuse transfer in B bands; density COSINE
    glossy    kernel 1 where n.w > 0     visibility in 2B-1 bands, of which glossy transfer is made; density UNIFORM

*Estimate.* With q_i = kernel / density at ray i, c the integral without shadows (a formula, `closed_forms`) and V_i
= 1 where ray i is free, the estimate of a row of n rays is

    p c + 1/n sum_i (V_i - p) q_i Y(w_i),

right on average for every p that was not chosen by looking at these very rays. p = 0 is the plain mean of V q Y; p = 1
subtracts from the formula what is blocked. With p the visible share of the rays the two are blended as their
variances ask, and a vertex that sees everything keeps the formula exactly, one that sees nothing gets exactly zero.

*Frames.* Sums are taken in the frame of the vertex, normal along z, where a harmonic is a product Y_lm = f_lm(z) times
cos(m azimuth) or sin(|m| azimuth), f_lm the associated Legendre function: for each m the sum over rays is one product
of a matrix (rows, n) with (n, 2). Each row is then turned about z by its own shift, and `to_world` turns all rows of a
vertex into the world.
"""

from collections.abc import Callable
from functools import partial
from math import factorial, pi, sqrt
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from gash_jax.algebra.closed_forms import clamped_cosine, hemisphere
from gash_jax.algebra.sh import legendre_functions, validate_bands
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.prt.sampling import COSINE, UNIFORM, Density, cosine_lobe, heights, lattice
from gash_jax.prt.tracing import Chunk, Integrand


class Kernel(NamedTuple):
    """A function of the cosine z to the normal, and its closed form: K_l with integral of kernel Y_lm = K_l Y_lm(n)."""

    value: Callable[[Array], Array]
    factor: Callable[[int], float]


def _diffuse_factor(band: int) -> float:
    return clamped_cosine(band) / pi


DIFFUSE = Kernel(cosine_lobe, _diffuse_factor)
HEMISPHERE = Kernel(jnp.ones_like, hemisphere)


def direct(bands: int, density: Density = COSINE) -> Integrand:
    """Diffuse transfer (1/pi) integral of V max(n.w, 0) Y_k in `bands` bands. Raises ValueError for bands not 1..10."""
    validate_bands(bands)
    return Integrand(density, "any", partial(_sum_of_visible, bands, DIFFUSE, density))


def glossy(bands: int) -> Integrand:
    """Integral of V Y_k over the hemisphere in 2 bands - 1 bands, for products of `bands` bands, 1..10.

    Directions are uniform: cosine-weighted ones would be reweighted by 1/cos, which has no finite variance.
    """
    validate_bands(bands)
    return Integrand(UNIFORM, "any", partial(_sum_of_visible, 2 * bands - 1, HEMISPHERE, UNIFORM))


def _sum_of_visible(bands: int, kernel: Kernel, density: Density, chunk: Chunk) -> Float[Array, "c r k"]:
    assert not isinstance(chunk.answer, tuple)
    return integrate_rays(chunk.answer, chunk.share, chunk.rows.shifts, bands, chunk.lattice, kernel, density)


def _profiles(z: Float[Array, "*s"], r: Float[Array, "*s"], bands: int, m: int) -> list[Float[Array, "*s"]]:
    """f_lm(z) for l = m .. bands-1; r = sqrt(1 - z²)."""
    first = float(np.prod(np.arange(1.0, 2 * m, 2))) * r**m  # 35!! is beyond 64 bits
    norms = [
        sqrt((2 * order + 1) / (4 * pi) * factorial(order - m) / factorial(order + m)) * (sqrt(2) if m else 1)
        for order in range(m, bands)
    ]
    return [n * value for n, value in zip(norms, legendre_functions(z, first, bands, m), strict=True)]


@partial(jax.jit, static_argnames=("bands", "name", "kernel", "density"))
def integrate_rays(
    visible: Bool[Array | np.ndarray, "c r n"],
    share: Float[Array | np.ndarray, "c"],
    shifts: Float[Array | np.ndarray, "c r 2"],
    bands: int,
    name: str = "hammersley",
    kernel: Kernel = DIFFUSE,
    density: Density = COSINE,
) -> Float[Array, "c r k"]:
    """The estimate of every row in the frame of its vertex, from the visibility of the rays of `sample_rays`.

    `share` is p of the module docstring, one for all rows of a vertex. `to_world` turns the result.
    """
    visible, share, shifts = jnp.asarray(visible), jnp.asarray(share), jnp.asarray(shifts)
    points = lattice(visible.shape[-1], name)
    z, r = heights(shifts[..., 0], points, density)
    azimuth = 2 * pi * points[:, 1].astype(np.float64)
    weight = visible.astype(jnp.float32) - share[:, None, None]
    if kernel.value is not density.pdf:  # else q is 1
        weight = weight * (kernel.value(z) / density.pdf(z))
    columns: list = [None] * bands**2
    for m in range(bands):
        waves = np.stack([np.cos(m * azimuth), np.sin(m * azimuth)], -1)[:, : 2 if m else 1].astype(np.float32)
        seen = jnp.stack([weight * profile for profile in _profiles(z, r, bands, m)])
        sums = (seen.reshape(-1, len(points)) @ (waves / len(points))).reshape(*seen.shape[:-1], -1)
        if m == 0:
            for order in range(bands):
                zonal = float(kernel.factor(order) * sqrt((2 * order + 1) / (4 * pi)))  # Y_l0 at the normal
                columns[order * order + order] = sums[order, ..., 0] + share[:, None] * zonal
            continue
        cos, sin = (wave(2 * pi * m * shifts[..., 1])[None] for wave in (jnp.cos, jnp.sin))
        even, odd = sums[..., 0] * cos - sums[..., 1] * sin, sums[..., 1] * cos + sums[..., 0] * sin
        for order in range(m, bands):
            columns[order * order + order + m], columns[order * order + order - m] = even[order - m], odd[order - m]
    return jnp.stack(columns, -1)


@jax.jit
def to_world(
    local: Float[Array | np.ndarray, "c r k"], frames: Float[Array | np.ndarray, "c 3 3"]
) -> Float[Array, "c r k"]:
    """Coefficients in the frames of their vertices -> world."""
    return rotate_coefficients(jnp.asarray(local), jnp.asarray(frames)[:, None])
