"""Training batches of the surfel network: vertices with their lists of surfels, drawn from all shapes alike.

Because no vertex knows of another, a batch need not hold whole shapes. It holds as many vertices of each width of list
as the corpus has, but of lists longer than WIDE fewer: the work of a batch is that of its pairs, so wide lists are
drawn at the rate WIDE / width and count so much more.

Shapes weigh in the loss by 1 / (their closed form's MSE + SOFTENING x its median), so that it is their skill that is
minimised and not the error of the darkest. Of some vertices all area vectors are hidden, of others some are reversed:
the winding of real meshes cannot be relied on.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.graph.surfel_graph import Part, with_surfels
from gash_jax.graph.surfel_lists import WIDTHS
from gash_jax.models.examples import Batch, Example

SOFTENING = 0.03
HIDDEN, REVERSED = 0.08, 0.04
WIDE = 64
# what of a part has as many columns as the lists are wide
LISTS = ("table", "weight")
# a batch can be spread over this many devices, or a divisor of it
SHARES = 8


class _Pool(NamedTuple):
    """All vertices of one width: part of a graph, labels, whether they count, how much."""

    inputs: Part
    labels: Float[np.ndarray, "n k"]
    mask: Bool[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]

    def take(self, chosen: np.ndarray) -> "_Pool":
        """Some of them."""
        inputs = {name: array[chosen] for name, array in self.inputs.items()}
        return _Pool(inputs, self.labels[chosen], self.mask[chosen], self.weight[chosen])


def label_columns(example: Example) -> Float[np.ndarray, "v m"]:
    """Labels side by side: coefficients, those of every bounce, mean square error of the rays by band; 0 if unknown."""
    count, k = example.coefficients.shape
    bounced = np.zeros((count, 0, k)) if example.bounced is None else example.bounced
    noise = np.zeros((count, round(k**0.5))) if example.noise is None else example.noise
    return np.concatenate([example.coefficients, bounced.reshape(count, -1), noise], axis=1, dtype=np.float32)


class PartPool:
    """The vertices of many shapes with their labels, to draw batches from."""

    def __init__(self, examples: Sequence[Example]):
        errors = _closed_form_errors(examples)
        typical = float(np.median(errors))
        sizes = [len(example.graph.records) for example in examples]
        starts = np.cumsum([0, *sizes[:-1]])
        self.records = np.concatenate([example.graph.records for example in examples])
        shapes = [
            _parts_of(example, 1 / (error + SOFTENING * typical + 1e-12), start)
            for example, error, start in zip(examples, errors, starts.tolist(), strict=True)
        ]
        self.pools = tuple(_together([shape[i] for shape in shapes]) for i in range(len(WIDTHS)))
        counted = np.concatenate([pool.weight for pool in self.pools])
        mean = float(counted.sum() / max(np.count_nonzero(counted), 1)) or 1.0
        self.pools = tuple(pool._replace(weight=pool.weight / np.float32(mean)) for pool in self.pools)

    def __len__(self) -> int:
        return sum(len(pool.mask) for pool in self.pools)

    def draw(self, size: int, seed: int, step: int, shards: int = 1) -> Batch:
        """The batch of a step: about `size` vertices of all shapes, without repetition in a width."""
        rng = np.random.default_rng([seed, step])
        counts = self._counts(size, np.minimum(WIDE / np.array(WIDTHS), 1))
        if any(count % shards for count in counts):
            raise ValueError(f"{counts} vertices for {shards} devices: a batch can be spread over {SHARES}")
        parts = []
        for count, pool in zip(counts, self.pools, strict=True):
            if not len(pool.mask):
                continue
            part = self._seen(pool.take(_drawn(rng, len(pool.mask), count)))
            surfels = part.inputs["surfel"]
            sign = np.where(rng.random((count, 1)) < REVERSED, rng.choice([-1, 1], surfels.shape[:2]), 1)
            sign = sign * (rng.random((count, 1)) >= HIDDEN)
            surfels[..., 3:6] *= sign[..., None].astype(np.float32)
            # so many stand for how many there are, whatever was rounded
            parts.append(part._replace(weight=part.weight * np.float32(len(pool.mask) * size / (count * len(self)))))
        return _batch(parts, shards)

    def _seen(self, part: _Pool) -> _Pool:
        return part._replace(inputs=with_surfels(part.inputs, self.records))

    def _counts(self, size: int, rates: Float[np.ndarray, "w"]) -> list[int]:
        """Vertices of each width in a batch, multiples of SHARES: the same whatever the number of devices."""
        wanted = rates * [len(pool.mask) for pool in self.pools]
        share = size * wanted / max(wanted.sum(), 1)
        return [SHARES * math.ceil(s / SHARES) for s in share.tolist()]

    def in_order(self, size: int) -> list[Batch]:
        """Every vertex once, in batches of one shard and one shape; what fills the last of a width does not count."""
        counts = self._counts(min(size, len(self)), np.ones(len(WIDTHS)))
        needed = max(-(-len(p.mask) // c) for c, p in zip(counts, self.pools, strict=True) if c)
        batches = []
        for number in range(needed):
            parts = []
            for count, pool in zip(counts, self.pools, strict=True):
                if count:
                    chosen = np.arange(number * count, (number + 1) * count)
                    part, real = self._seen(pool.take(chosen % len(pool.mask))), chosen < len(pool.mask)
                    parts.append(part._replace(mask=part.mask & real, weight=part.weight * real))
            batches.append(_batch(parts, 1))
        return batches


def _parts_of(example: Example, weight: float, start: int) -> list[_Pool]:
    """The vertices of a shape by width, whose records start at that row of all; the last of several labels counts.

    A graph of few vertices has short lists in wide parts (`surfel_lists`): here they go where they fit.
    """
    graph, labels = example.graph, label_columns(example)
    total = sum(len(part["normal"]) for part in graph.parts)
    own = np.zeros((total, labels.shape[1]), np.float32)
    own[graph.slot] = labels
    found: list[list[_Pool]] = [[] for _ in WIDTHS]
    ends = np.cumsum([len(part["normal"]) for part in graph.parts])[:-1]
    for part, labelled in zip(graph.parts, np.split(own, ends), strict=True):
        mask = np.any(part["normal"] != 0, axis=1)
        shifted = {**part, "table": part["table"] + np.int32(start)}
        pool = _Pool(shifted, labelled, mask, np.where(mask, np.float32(weight), np.float32(0)))
        bucket = np.searchsorted(WIDTHS, np.count_nonzero(part["weight"], axis=1))
        for number in range(len(WIDTHS)):
            found[number].append(_narrowed(pool.take(np.flatnonzero(bucket == number)), WIDTHS[number]))
    return [_together(pools) for pools in found]


def _narrowed(pool: _Pool, width: int) -> _Pool:
    """Lists cut to this width: what is empty comes last. None are narrower, if there are any."""

    def cut(array: np.ndarray) -> np.ndarray:
        return array[:, :width] if len(array) else np.zeros((0, width), array.dtype)

    return pool._replace(inputs={name: cut(a) if name in LISTS else a for name, a in pool.inputs.items()})


def _together(pools: list[_Pool]) -> _Pool:
    inputs = {name: np.concatenate([pool.inputs[name] for pool in pools]) for name in pools[0].inputs}
    labels, mask, weight = (np.concatenate([getattr(pool, n) for pool in pools]) for n in ("labels", "mask", "weight"))
    return _Pool(inputs, labels, mask, weight)


def _drawn(rng: np.random.Generator, available: int, count: int) -> np.ndarray:
    """So many of the available; each as often as it takes where there are fewer."""
    if count > available:
        return np.resize(rng.permutation(available), count)
    return rng.choice(available, count, replace=False)


def _batch(parts: list[_Pool], shards: int) -> Batch:
    def sharded(array: np.ndarray) -> np.ndarray:
        return array.reshape(shards, -1, *array.shape[1:])

    def joined(arrays: list[np.ndarray]) -> np.ndarray:
        return np.concatenate([sharded(array) for array in arrays], axis=1)

    inputs: Any = tuple({name: sharded(array) for name, array in part.inputs.items()} for part in parts)
    mask, weight = joined([part.mask for part in parts]), joined([part.weight for part in parts])
    labels, normals = joined([part.labels for part in parts]), joined([part.inputs["normal"] for part in parts])
    return Batch(inputs, normals, labels, np.zeros((*mask.shape, 0), np.float32), mask, weight)


def _closed_form_errors(examples: Sequence[Example]) -> list[float]:
    """MSE of the closed form on every shape; of all in one call, as JAX compiles anew for every number of vertices."""
    normals = [np.concatenate([part["normal"] for part in e.graph.parts])[e.graph.slot] for e in examples]
    bands = round(examples[0].coefficients.shape[1] ** 0.5)
    exact = np.asarray(unshadowed_transfer(np.concatenate(normals), bands))
    ends = np.cumsum([len(part) for part in normals])[:-1]
    return [
        float(np.mean((formula - example.coefficients) ** 2))
        for formula, example in zip(np.split(exact, ends), examples, strict=True)
    ]
