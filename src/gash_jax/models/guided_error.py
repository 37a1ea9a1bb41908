"""What a guided bake says of its error, corrected by the rays themselves.

The network expects an error from a rough law of how good N rays are. How good they are on one mesh depends on its
shadows: on some the squared error is half of what the law says, on others twice. The two halves of a vertex's rays
estimate the same; how far they lie apart, summed over all vertices of a mesh, gives the squared error of the rays
within a tenth. The *noise ratio* of a mesh is that error over the law. Of vertices with N rays the sum of the squared
errors v that the network expects is multiplied by

    exp(level(N)) ratio^power(N),

each of them by v^slope(N) besides: of vertices with many rays the small ones are expected too small. The constants are
those of generated shapes (`experiments.guided.calibrate`), on which they halve the spread of error over expected error
between meshes; on shapes of another seed they take less from it (test). Of one vertex the halves say next to nothing,
so there is one ratio for a mesh.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.nn.reconstruction import rough_variance
from gash_jax.prt.allocation import PILOT
from gash_jax.prt.few_rays import HALVES, FewRays

FEWEST = 500  # vertices whose halves differ, below which they tell too little
LARGEST_RATIO = 4.0  # and smallest, its inverse


class Level(NamedTuple):
    """Constants of one number of rays: squared error over that of the halves, and those of the correction."""

    worth: float
    power: float
    level: float
    slope: float


# of 8, 16, 32 ... rays; the last serves all larger numbers
LEVELS = (
    Level(1.128, 0.82, -0.65, 0.12),
    Level(0.301, 0.37, -0.26, -0.01),
    Level(0.459, 0.84, -0.58, -0.08),
    Level(0.639, 0.66, -0.58, -0.08),
    Level(0.443, 0.72, -0.61, -0.20),
    Level(0.645, 0.59, -0.47, -0.24),
    Level(0.437, 0.81, -0.62, -0.32),
    Level(0.723, 0.75, -0.46, -0.40),
)


def _level(few: FewRays) -> Int[np.ndarray, "a"]:
    return np.clip(np.log2(few.rays / PILOT).round().astype(int), 0, len(LEVELS) - 1)


def noise_ratio(few: FewRays) -> float | None:
    """Squared error of the rays over what the law says of it; None where too few vertices tell."""
    doubled = np.flatnonzero(few.halves > 0)
    if len(doubled) < FEWEST:
        return None
    some = few.take(doubled)
    worth = np.array([level.worth for level in LEVELS])[_level(some)]
    law = HALVES * rough_variance(some.rays.astype(np.float64), some.share.astype(np.float64))
    ratio = float(np.sum(worth * some.halves) / np.sum(law))
    return float(np.clip(ratio, 1 / LARGEST_RATIO, LARGEST_RATIO))


def corrected(variance: Float[np.ndarray, "a k"], few: FewRays) -> Float[np.ndarray, "a k"]:
    """The squared errors that the network expects, corrected as the module's text says."""
    ratio = noise_ratio(few)
    if ratio is None:
        return variance
    level, found = _level(few), variance.copy()
    of_vertex = variance.sum(axis=1, dtype=np.float64)
    for number in np.flatnonzero(np.bincount(level)):
        own, constants = np.flatnonzero(level == number), LEVELS[number]
        bent = of_vertex[own] ** (1 + constants.slope)
        total = np.exp(constants.level) * ratio**constants.power * of_vertex[own].sum()
        factor = total * bent / (bent.sum() * np.maximum(of_vertex[own], 1e-30))
        found[own] *= factor.astype(variance.dtype)[:, None]
    return found


def noise_left(few: FewRays, variance: Float[np.ndarray, "a"], k: int) -> float:
    """Squared error that is expected of k coefficients over that of the rays alone, of the whole mesh; at most 1."""
    law = k * float(rough_variance(few.rays.astype(np.float64), few.share).sum())
    return min(float(variance.sum()) / ((noise_ratio(few) or 1.0) * law), 1.0)
