"""What networks are trained on: shapes with their labels, and batches of them.

A batch is a function of the seed and the step, so the position in the data is the step: a resumed run sees what the
uninterrupted one would have seen. A batch is laid out in shards, one a device; which shapes it holds does not depend on
how many shards there are.

`WholeShapes` puts whole graphs side by side, padded to one size. A family whose inputs are no graphs, or fall into
parts that are better drawn apart (`surfel_parts`), brings batches of its own with the same two methods.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.batching import batch_graphs, node_mask


class Item(NamedTuple):
    """One shape of the corpus with its labels; the directions of the visibility are in the vertices' frames."""

    kind: str
    mesh: Mesh
    coefficients: Float[np.ndarray, "v k"]
    visibility: Float[np.ndarray, "v n"]
    bounced: Float[np.ndarray, "v i k"] | None = None  # what each bounce adds off white surfaces
    noise: Float[np.ndarray, "v b"] | None = None  # squared standard error of the coefficients, mean of each band


class Example(NamedTuple):
    """One shape as its family reads it, with its labels."""

    graph: Any
    coefficients: Float[np.ndarray, "v k"]
    visibility: Float[np.ndarray, "v n"]
    bounced: Float[np.ndarray, "v i k"] | None = None
    noise: Float[np.ndarray, "v b"] | None = None


class Batch(NamedTuple):
    """Inputs of a network, one a shard, with labels of the same length; every array has the shards as its first axis.

    `mask` is True on real vertices that have a normal; `weight` is how much they count in the loss, 0 elsewhere.
    """

    inputs: Any
    normals: Float[np.ndarray, "s v 3"]
    coefficients: Float[np.ndarray, "s v k"]
    visibility: Float[np.ndarray, "s v n"]
    mask: Bool[np.ndarray, "s v"]
    weight: Float[np.ndarray, "s v"]


class Batches(Protocol):
    """Where a training run and its validation take their batches from."""

    def draw(self, size: int, seed: int, step: int, shards: int = 1) -> Batch:
        """The batch of a step: about `size` vertices. Raises ValueError where nothing fits."""
        ...

    def in_order(self, size: int) -> list[Batch]:
        """Every vertex exactly once, in batches of one shard."""
        ...


def _pad(examples: Sequence[Example], size: int) -> Batch:
    graph = batch_graphs([example.graph for example in examples], (size,))

    def padded(arrays: list[np.ndarray]) -> np.ndarray:
        joined = np.concatenate(arrays)
        return np.concatenate([joined, np.zeros((size - len(joined), joined.shape[1]), joined.dtype)])

    normals = np.asarray(graph.nodes["normal"])  # type: ignore[index]
    mask = np.asarray(node_mask(graph)) & np.any(normals != 0, axis=-1)
    coefficients = padded([example.coefficients for example in examples])
    visibility = padded([example.visibility for example in examples])
    return Batch(graph, normals, coefficients, visibility, mask, mask.astype(np.float32))


def _pad_counts(batch: Batch, count: int) -> Batch:
    """n_node and n_edge padded with empty graphs, and globals with zeros, so that shards stack."""

    def longer(array: np.ndarray) -> np.ndarray:
        return np.concatenate([array, np.zeros((count - len(array), *array.shape[1:]), array.dtype)])

    graph = batch.inputs
    sizes = {"n_node": longer(np.asarray(graph.n_node)), "n_edge": longer(np.asarray(graph.n_edge))}
    return batch._replace(inputs=graph._replace(globals=jax.tree.map(longer, graph.globals), **sizes))


def collate(shards: Sequence[Sequence[Example]], size: int) -> Batch:
    """Put the examples of every shard side by side, pad each shard to `size` vertices, stack them."""
    padded = [_pad(examples, size) for examples in shards]
    graphs = max(len(batch.inputs.n_node) for batch in padded)
    # the number of graphs is rounded up: a compiled step should meet few shapes
    padded = [_pad_counts(batch, -(-graphs // GRAPHS_STEP) * GRAPHS_STEP) for batch in padded]
    return jax.tree.map(lambda *leaves: np.stack(leaves), *padded)


GRAPHS_STEP = 8


def _spread(examples: Sequence[Example], shards: int) -> list[list[Example]]:
    """Largest first, always into the emptiest shard: none holds more than the mean plus the largest shape."""
    loads, groups = np.zeros(shards, int), [[] for _ in range(shards)]
    for example in sorted(examples, key=lambda example: -len(example.coefficients)):
        lightest = int(loads.argmin())
        groups[lightest].append(example)
        loads[lightest] += len(example.coefficients)
    return groups


def shard_size(examples: Sequence[Example], size: int, shards: int) -> int:
    """Vertices that one of several shards must hold so that every batch of `size` vertices can be spread over them."""
    return size if shards == 1 else size // shards + max(len(example.coefficients) for example in examples) + 1


def _random_part(counts: Int[np.ndarray, "n"], size: int, seed: int, step: int) -> Int[np.ndarray, "m"]:
    """Indices of one part of a division of the shapes with fewer than `size` vertices into parts with fewer in all.

    Large shapes first, each goes to any of the parts that have room for it. One vertex of a batch is kept free for
    padding edges to end at.
    """
    rng = np.random.default_rng([seed, step])
    order = rng.permutation(np.flatnonzero(counts < size))
    order = order[np.argsort(-counts[order], kind="stable")]
    loads = np.zeros(-(-int(counts[order].sum()) // max(size - 1, 1)), int)
    part = np.full(len(counts), -1)
    for index in order:
        room = np.flatnonzero(loads + counts[index] < size)
        if not len(room):
            loads, room = np.append(loads, 0), np.array([len(loads)])
        part[index] = rng.choice(room)
        loads[part[index]] += counts[index]
    return np.flatnonzero(part == rng.integers(len(loads))) if len(loads) else order


class WholeShapes:
    """Batches of whole shapes, whose graphs have a fixed number of neighbours."""

    def __init__(self, examples: Sequence[Example]) -> None:
        self.examples = examples
        self._counts = np.array([len(example.coefficients) for example in examples], int)

    def draw(self, size: int, seed: int, step: int, shards: int = 1) -> Batch:
        """The batch of a step: one part, chosen at random, of a random division of all shapes that fit into batches.

        Every shape is in exactly one part, so all are drawn equally often, however large they are; and so are vertices,
        which count alike in the loss. (A batch filled with whatever still fits would hold small shapes more often.)
        """
        chosen = [self.examples[index] for index in _random_part(self._counts, size, seed, step)]
        if not chosen:
            raise ValueError(f"no shape fits into train.batch_vertices={size}: raise it, or lower data.max_vertices")
        groups = _spread(chosen, shards) if shards > 1 else [chosen]
        batch = collate([group or chosen[:1] for group in groups], shard_size(self.examples, size, shards))
        for shard, group in enumerate(groups):
            if not group:  # fewer shapes than devices: what this one computes counts for nothing
                batch.mask[shard], batch.weight[shard] = False, 0
        return batch

    def in_order(self, size: int) -> list[Batch]:
        """Every shape exactly once, in padded batches of one shard that hold at least `size` vertices."""
        size = max([size, *(len(example.coefficients) + 1 for example in self.examples)])
        batches, group, used = [], [], 0
        for example in self.examples:
            count = len(example.coefficients)
            if group and used + count >= size:
                batches.append(collate([group], size))
                group, used = [], 0
            group.append(example)
            used += count
        return [*batches, collate([group], size)] if group else batches
