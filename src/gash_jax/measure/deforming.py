"""Measures of a sequence of frames, one frame at a time, so that no sequence need fit into memory.

Of estimates t and references t*, both (v, k) a frame, over all frames together: relrmse, skill and flicker as in
`metrics`; L1, the mean of |t - t*|; *accuracy*, the share of entries with |t - t*| at most 2 % of the range of their
coefficient, its largest less its smallest value over the training set (DeepPRT, 4.1). Radiance under a light counts as
(v, 3 k); it has no skill.
"""

from collections.abc import Iterable
from math import isqrt

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.measure.metrics import NO_OCCLUSION

SHARE = 0.02  # of its range within which a coefficient counts as right


def coefficient_ranges(shards: Iterable[np.ndarray]) -> Float[np.ndarray, "k"]:
    """Largest less smallest value of each coefficient over all frames and vertices, of arrays (t, v, k)."""
    ends = [(shard.min(axis=(0, 1)), shard.max(axis=(0, 1))) for shard in shards]
    low, high = (np.stack(side).astype(np.float64) for side in zip(*ends, strict=True))
    return high.max(axis=0) - low.min(axis=0)


class SequenceScores:
    """The measures of the frames that were added, in their order."""

    def __init__(self, ranges: Float[np.ndarray, "k"]) -> None:
        self._ranges, self._before = ranges, []
        self._square = self._energy = self._formula = self._absolute = self._second = 0.0
        self._right = self._count = self._seconds = 0

    def add(self, estimate: np.ndarray, reference: np.ndarray, normals: Float[np.ndarray, "v 3"]) -> None:
        """The next frame, (v, k) both. Raises ValueError where shapes differ."""
        if estimate.shape != reference.shape or estimate.shape[1:] != self._ranges.shape:
            raise ValueError(f"shapes differ: {estimate.shape} against {reference.shape}; same mesh, same bands needed")
        truth = reference.astype(np.float64)
        error = estimate.astype(np.float64) - truth
        bands = isqrt(error.shape[1])
        self._square += float(np.sum(error**2))
        self._energy += float(np.sum(truth**2))
        if bands**2 == error.shape[1]:  # the 3 bands² of radiance have no formula, and are never a square
            self._formula += float(np.sum((np.asarray(unshadowed_transfer(normals, bands)) - truth) ** 2))
        self._absolute += float(np.sum(np.abs(error)))
        self._right += int(np.sum(np.abs(error) <= SHARE * self._ranges))
        self._count += error.size
        if len(self._before) == 2:
            self._second += float(np.sum((error - 2 * self._before[1] + self._before[0]) ** 2))
            self._seconds += error.size
        self._before = [*self._before[-1:], error]

    def scores(self, flicker: bool = False) -> dict[str, float]:
        """Every measure by name, of those that are defined; flicker only where frames follow one another in time."""
        found = {"accuracy": self._right / self._count, "l1": self._absolute / self._count}
        if self._energy > 0:
            found["relrmse"] = float(np.sqrt(self._square / self._energy))
        if self._formula > NO_OCCLUSION * self._count:
            found["skill"] = 1 - self._square / self._formula
        if flicker and self._seconds:
            found["flicker"] = float(np.sqrt(self._second / self._seconds))
        return found
