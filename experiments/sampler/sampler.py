"""The sampler question: what 25 directions make of coefficients whose exact values are known.

The code published with the first Neural-GASh paper integrates over the whole sphere with 5 x 5 stratified squares,

    theta = 2 acos(sqrt(1 - x)),  phi = 2 pi y,  x = (a + r) / 5,  y = (b + r) / 5,  a, b = 0 .. 4,

where the jitter r is a random() divided by 32767 again, that is, none. At a = 0 all five points are theta = 0: they
coincide at +z. The GNN paper (4.4.2 and 5) finds its network worst at the 1-based indices 2, 3 and 7 and explains it by
the network; the unshadowed coefficients of the rule itself are worst at 1, 3 and 7.
"""

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.directions import spherical_fibonacci
from gash_jax.algebra.sh import evaluate_sh

SIDE = 5


def published_directions() -> Float[np.ndarray, "25 3"]:
    """The 25 directions of the published rule, without jitter."""
    x, y = (grid.reshape(-1) / SIDE for grid in np.meshgrid(np.arange(SIDE), np.arange(SIDE), indexing="ij"))
    theta, phi = 2 * np.arccos(np.sqrt(1 - x)), 2 * np.pi * y
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], -1)


RULES = {"published": published_directions, "Fibonacci": lambda: spherical_fibonacci(SIDE * SIDE)}


def estimate(
    directions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "v 3"], bands: int = 3
) -> Float[np.ndarray, "v k"]:
    """4 pi / n * sum max(normal . w, 0) Y(w): unshadowed, albedo 1, not divided by pi as in the published code."""
    basis = np.asarray(evaluate_sh(directions.astype(np.float32), bands), np.float64)
    return 4 * np.pi / len(directions) * np.maximum(normals @ directions.T, 0) @ basis


def exact(normals: Float[np.ndarray, "v 3"], bands: int = 3) -> Float[np.ndarray, "v k"]:
    """A_l Y_k(n) (Ramamoorthi & Hanrahan 2001)."""
    return clamped_cosine_coefficients(bands) * np.asarray(evaluate_sh(normals.astype(np.float32), bands), np.float64)


def errors(rule: str, count: int = 20000) -> Float[np.ndarray, "9"]:
    """MSE of each coefficient over normals that cover the sphere evenly."""
    normals = spherical_fibonacci(count)
    return np.mean((estimate(RULES[rule](), normals) - exact(normals)) ** 2, axis=0)
