"""What a guided bake says of its error, corrected by the rays themselves.

The network expects an error from a rough law of how good N rays are. How good they are on one mesh depends on its
shadows: on some the squared error is half of what the law says, on others twice. The two halves of a vertex's rays
estimate the same; how far they lie apart, summed over all vertices of a mesh, gives the squared error of the rays
within a tenth. The *noise ratio* of a mesh is that error over the law, and the squared error that the network expects
of vertices with N rays is multiplied by

    exp(level(N)) ratio^power(N),

constants of generated shapes (`experiments.guided.calibrate`), on which it halves the spread of error over expected
error between meshes. Of one vertex the halves say next to nothing, so there is one ratio for a mesh.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.models.reconstruction import Rebuilt
from gash_jax.nn.reconstruction import rough_variance
from gash_jax.prt.allocation import PILOT
from gash_jax.prt.few_rays import HALVES, FewRays

FEWEST = 200  # vertices with halves and something hidden, below which the ratio is left alone
LARGEST_RATIO = 4.0  # and smallest, its inverse


class Level(NamedTuple):
    """Constants of one number of rays: squared error over that of the halves, and the line of the correction."""

    worth: float
    power: float
    level: float


# of 8, 16, 32 ... rays; the last serves all larger numbers
LEVELS = (
    Level(1.128, 0.82, -0.65),
    Level(0.301, 0.37, -0.26),
    Level(0.459, 0.84, -0.58),
    Level(0.639, 0.66, -0.58),
    Level(0.443, 0.72, -0.61),
    Level(0.645, 0.59, -0.47),
    Level(0.437, 0.81, -0.62),
    Level(0.723, 0.75, -0.46),
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


def corrections(few: FewRays) -> Float[np.ndarray, "a"]:
    """What the squared error that the network expects of each vertex is to be multiplied by."""
    ratio = noise_ratio(few)
    if ratio is None:
        return np.ones(len(few.rays), np.float32)
    return np.exp([level.level + level.power * np.log(ratio) for level in LEVELS]).astype(np.float32)[_level(few)]


def corrected(rebuilt: Rebuilt, few: FewRays) -> Rebuilt:
    """What was rebuilt, with the error that is expected corrected."""
    return rebuilt._replace(variance=rebuilt.variance * corrections(few)[:, None])


def noise_left(few: FewRays, variance: Float[np.ndarray, "a"], k: int) -> float:
    """Squared error that is expected of k coefficients over that of the rays alone, of the whole mesh; at most 1."""
    law = k * float(rough_variance(few.rays.astype(np.float64), few.share).sum())
    return min(float(variance.sum()) / ((noise_ratio(few) or 1.0) * law), 1.0)
