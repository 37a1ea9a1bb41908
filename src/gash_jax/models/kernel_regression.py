"""Kernel ridge regression of many outputs, and the few directions that hold most of what it predicts.

Of t training poses there are a kernel K (t, t) and outputs Y (t, n), n large, with mean m. The regression predicts
m + k(pose) M (Y - m), M = (K + ridge)^-1. Its predictions at the training poses are K M (Y - m); their leading `rank`
right singular vectors B (rank, n) are kept (reduced-rank regression, Izenman 1975), and with dual weights
W = M (Y - m) B^T of shape (t, rank) a prediction is m + k(pose) W B. The ridge may be chosen by the error of leaving
one pose out, [M (Y - m)]_i / M_ii (Rasmussen & Williams 2006, 5.12), which needs no further fit. All but two products
are of (t, t) arrays, so what a fit costs is reading Y twice.

A regression may know fewer poses than it is fitted to (`known_machine`): with C the kernel of all poses and of s known
ones, M is (C^T C + ridge K_ss)^-1 C^T, of shape (s, t), a prediction is m + k_s(pose) M (Y - m), and all poses still
speak (subset of regressors, 8.14 there). They are chosen by pivoted Cholesky factorisation: each next is the one that
those before tell least of.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

RIDGES = tuple(10.0**power for power in np.arange(-4, 0.01, 0.5))  # that are tried, times the mean of K's diagonal
WEAKEST = 1e-9  # of the energy of the strongest direction that counts


class Machine(NamedTuple):
    """A regression before its outputs are known: C and M."""

    columns: Float[np.ndarray, "t s"]
    inverse: Float[np.ndarray, "s t"]


class LowRank(NamedTuple):
    """A regression kept in few directions (module docstring)."""

    mean: Float[np.ndarray, "n"]
    dual: Float[np.ndarray, "s r"]
    basis: Float[np.ndarray, "r n"]
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


def spread_poses(kernel: Float[np.ndarray, "t t"], most: int) -> Int[np.ndarray, "s"]:
    """At most so many poses, each the one of which those before tell least; all of them where there are no more."""
    if most >= len(kernel):
        return np.arange(len(kernel))
    left, factor, chosen = np.diag(kernel).copy(), np.zeros((len(kernel), most)), []
    for number in range(most):
        chosen.append(int(left.argmax()))
        column = kernel[:, chosen[-1]] - factor[:, :number] @ factor[chosen[-1], :number]
        factor[:, number] = column / np.sqrt(max(left[chosen[-1]], 1e-12 * max(float(kernel[0, 0]), 1e-30)))
        left -= factor[:, number] ** 2
        left[chosen] = -np.inf
    return np.array(chosen)


def known_machine(columns: Float[np.ndarray, "t s"], own: Float[np.ndarray, "s s"], ridge: float) -> Machine:
    """The regression that knows s poses, of which `columns` is the kernel with all and `own` that with each other."""
    steady = 1e-10 * (float(np.trace(own)) or 1.0) * np.eye(len(own))  # poses may be all but the same
    factor = np.sqrt(max(ridge, 1e-8)) * np.linalg.cholesky(own + steady).T
    turned, triangle = np.linalg.qr(np.concatenate([columns, factor]))  # C^T C would lose half of the digits
    return Machine(columns, np.linalg.solve(triangle, turned[: len(columns)].T))


def ridge_machine(kernel: Float[np.ndarray, "t t"], gram: Float[np.ndarray, "t t"], ridge: float = 0.0) -> Machine:
    """The regression that knows all poses; `ridge` in units of the mean of the kernel's diagonal, 0 has it chosen from
    `RIDGES` by leaving one pose out of outputs whose products, less their mean, are `gram`.
    """
    kernel, unit = kernel.astype(np.float64), max(float(np.trace(kernel)) / len(kernel), 1e-30)
    if not ridge:
        ridge = RIDGES[int(np.argmin(leave_one_out(kernel, gram, [unit * each for each in RIDGES])))]
    return Machine(kernel, np.linalg.inv(kernel + (ridge * unit + 1e-10 * unit) * np.eye(len(kernel))))


def products_of(outputs: Float[np.ndarray, "t n"]) -> Float[np.ndarray, "t t"]:
    """Products of the outputs of any two poses, less their mean."""
    apart = outputs - outputs.mean(axis=0)
    return (apart @ apart.T).astype(np.float64)


def fit_low_rank(
    machine: Machine, outputs: Float[np.ndarray, "t n"], gram: Float[np.ndarray, "t t"], rank: int
) -> LowRank:
    """The leading directions of what a regression predicts of some outputs, float32, with their products."""
    mean = outputs.mean(axis=0)
    # C = Q R: predictions Q (R M Y) have the directions and the energies of R M Y, which is only as tall as M
    smooth = np.linalg.qr(machine.columns, mode="r") @ machine.inverse
    values, vectors = np.linalg.eigh(smooth @ gram @ smooth.T)
    kept = np.argsort(-values)[: min(rank, len(values))]
    strong = values[kept] > WEAKEST * max(float(values.max()), 1e-30)  # the others are rounding, and stay zeros
    size = np.sqrt(np.where(strong, values[kept], 1))
    into = strong * (smooth.T @ vectors[:, kept]) / size  # (t, r): B = into^T (Y - m)
    dual, basis = machine.inverse @ gram @ into, into.T.astype(np.float32) @ (outputs - mean)
    short = rank - len(kept)
    dual, basis = np.pad(dual, ((0, 0), (0, short))), np.pad(basis, ((0, short), (0, 0)))
    return LowRank(mean, dual.astype(np.float32), basis, np.pad(strong * values[kept], (0, short)))
