"""Standard errors of independent estimates, and the least that they may claim.

Replicates may agree by chance, all rays or their count, and would then claim an error of 0. But no vertex is known to
better than half a ray, and a ray weighs at most sqrt((2l+1)/4pi) / N in band l, the bound of its harmonics. Half of
that is the floor of the standard error of a vertex whose N rays all agree, and of t_00, which does nothing but count
free rays, everywhere; of all other coefficients the floor is a fifth of it.
"""

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.sh import band_index, bands_of


def standard_error_floor(
    bands: int, rays: np.ndarray | int, share: Float[np.ndarray, "a"], weight: float = 1.0
) -> Float[np.ndarray, "a k"]:
    """Smallest standard error that N rays of which `share` are free can claim (module docstring).

    `weight` is the most that a ray weighs, times N.
    """
    band = band_index(bands)
    one_ray = weight * np.sqrt((2 * band + 1) / (4 * np.pi)) / 2
    agree = (share == 0) | (share == 1)
    part = np.where(agree[:, None] | (band == 0)[None], 1.0, 0.2)
    return (part * one_ray[None] / np.broadcast_to(rays, share.shape)[:, None]).astype(np.float32)


def replicate_error(
    replicas: Float[np.ndarray, "a r k *c"], mean: Float[np.ndarray, "a k *c"], rays: int, share: Float[np.ndarray, "a"]
) -> Float[np.ndarray, "a k *c"]:
    """Standard error of the mean of r > 1 replicates, not below the floor; `c` are colours, where there are any."""
    count, difference = replicas.shape[1], replicas - mean[:, None]
    variance = np.einsum("ar...,ar...->a...", difference, difference) / np.float32(count * (count - 1))
    floor = standard_error_floor(bands_of(mean.shape[1]), rays, share)
    return np.maximum(np.sqrt(variance), floor.reshape(*floor.shape, *(1,) * (mean.ndim - 2)))
