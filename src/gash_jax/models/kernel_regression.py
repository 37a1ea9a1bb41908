"""Kernel ridge regression of many outputs, and the few directions that hold most of what it predicts.

Of t training poses there are a kernel K (t, t) and outputs Y (t, n), n large, with mean m. The regression predicts
m + k(pose) M (Y - m), M = (K + ridge)^-1. Its predictions at the training poses are K M (Y - m); their leading `rank`
right singular vectors B (rank, n) are kept (reduced-rank regression, Izenman 1975), and with dual weights
W = M (Y - m) B^T of shape (t, rank) a prediction is m + k(pose) W B. The ridge may be chosen by the error of leaving
one pose out, [M (Y - m)]_i / M_ii (Rasmussen & Williams 2006, 5.12), which needs no further fit. All but two products
are of (t, t) arrays, so what a fit costs is reading Y twice.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

RIDGES = tuple(10.0**power for power in np.arange(-4, 0.01, 0.5))  # that are tried, times the mean of K's diagonal
WEAKEST = 1e-9  # of the energy of the strongest direction that counts


class LowRank(NamedTuple):
    """A regression kept in few directions (module docstring)."""

    mean: Float[np.ndarray, "n"]
    dual: Float[np.ndarray, "t r"]
    basis: Float[np.ndarray, "r n"]
    ridge: float  # that was used
    energy: Float[np.ndarray, "r"]  # of the predictions at the training poses along each direction


def leave_one_out(
    kernel: Float[np.ndarray, "t t"], gram: Float[np.ndarray, "t t"], ridges: Sequence[float]
) -> Float[np.ndarray, "ridge"]:
    """Mean square error of leaving one pose out, by ridge; `gram` holds the products of the outputs less their mean."""
    values, vectors = np.linalg.eigh(kernel)
    turned, errors = vectors.T @ gram @ vectors, []
    for ridge in ridges:
        shrunk = vectors / (np.maximum(values, 0) + ridge)
        square = np.einsum("ij,jk,ik->i", shrunk, turned, shrunk, optimize=True)
        own = np.einsum("ij,ij->i", shrunk, vectors)
        errors.append(float(np.mean(np.maximum(square, 0) / own**2)))
    return np.array(errors)


def fit_low_rank(
    kernel: Float[np.ndarray, "t t"], outputs: Float[np.ndarray, "t n"], rank: int, ridge: float = 0.0
) -> LowRank:
    """The regression of the module docstring in float32; `ridge` in units of the mean of the kernel's diagonal, 0 has
    it chosen from `RIDGES`.
    """
    mean = outputs.mean(axis=0)
    apart = outputs - mean
    gram = (apart @ apart.T).astype(np.float64)
    kernel, unit = kernel.astype(np.float64), max(float(np.trace(kernel)) / len(kernel), 1e-30)
    if not ridge:
        ridge = RIDGES[int(np.argmin(leave_one_out(kernel, gram, [unit * each for each in RIDGES])))]
    inverse = np.linalg.inv(kernel + ridge * unit * np.eye(len(kernel)))
    smooth = kernel @ inverse
    values, vectors = np.linalg.eigh(smooth @ gram @ smooth.T)
    kept = np.argsort(-values)[: min(rank, len(values))]
    strong = values[kept] > WEAKEST * max(float(values.max()), 1e-30)  # the others are rounding, and stay zeros
    size = np.sqrt(np.where(strong, values[kept], 1))
    into = strong * (smooth.T @ vectors[:, kept]) / size  # (t, r): B = into^T (Y - m)
    dual, basis = inverse @ gram @ into, into.T.astype(np.float32) @ apart
    short = rank - len(kept)
    dual, basis = np.pad(dual, ((0, 0), (0, short))), np.pad(basis, ((0, short), (0, 0)))
    return LowRank(mean, dual.astype(np.float32), basis, ridge, np.pad(strong * values[kept], (0, short)))
