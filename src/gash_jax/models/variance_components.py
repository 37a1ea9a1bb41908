"""How much of what varies each of several kernels explains: variance components by minorise-maximise.

Outputs Y (t, n), less their mean, are n draws from a normal distribution of covariance K = sum_g a_g K_g + s I. Each
step multiplies a component by a root of a ratio,

    a_g <- a_g sqrt(tr(K_g K^-1 G K^-1) / (n tr(K_g K^-1))),   G = Y Y^T,

and s likewise with I for K_g: the likelihood never falls, and no component becomes negative (Zhou, Hu, Zhou & Lange
2019, "MM Algorithms for Variance Components Models", algorithm 1). What explains nothing goes to 0.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

STEPS = 25


class Components(NamedTuple):
    """Variances of the kernels and of the noise."""

    amounts: Float[np.ndarray, "g"]
    noise: float


def variance_components(
    kernels: Float[np.ndarray, "g t t"], gram: Float[np.ndarray, "t t"], outputs: int, most: int
) -> Components:
    """The components of so many outputs with the Gram matrix G; of the kernels the `most` largest are kept."""
    unit = max(float(np.trace(gram)) / (len(gram) * outputs), 1e-30)
    kept, noise = np.arange(len(kernels)), 0.1 * unit
    held, amounts = kernels, np.full(len(kernels), 0.9 * unit / len(kernels))
    for step in range(STEPS):
        inverse = np.linalg.inv(_covariance(amounts, held, noise))
        seen = inverse @ gram @ inverse / outputs
        up, down = (held.reshape(len(held), -1) @ matrix.ravel() for matrix in (seen, inverse))
        amounts = amounts * np.sqrt(np.maximum(up, 0) / np.maximum(down, 1e-300))
        noise = max(noise * float(np.sqrt(max(np.trace(seen), 0) / np.trace(inverse))), 1e-9 * unit)
        if step == STEPS // 2 and len(held) > most:
            best = np.sort(np.argsort(-amounts * np.einsum("gtt->g", held))[:most])
            kept, held, amounts = kept[best], held[best], amounts[best]
    whole = np.zeros(len(kernels))
    whole[kept] = amounts
    return Components(whole, noise)


def _covariance(
    amounts: Float[np.ndarray, "g"], kernels: Float[np.ndarray, "g t t"], noise: float
) -> Float[np.ndarray, "t t"]:
    return np.tensordot(amounts, kernels, axes=1) + noise * np.eye(kernels.shape[1])
