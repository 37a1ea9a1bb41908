"""Batches for training: whole shapes put side by side, padded to one size, drawn by (seed, step) alone.

Because a batch is a function of the seed and the step, the position in the data is the step: a resumed run sees
what the uninterrupted one would have seen.
"""

from collections.abc import Sequence
from typing import NamedTuple

import jraph
import numpy as np
from jaxtyping import Bool, Float

from gash_jax.graph.batching import batch_graphs, node_mask
from gash_jax.graph.mesh_graph import build_graph
from gash_jax.learn.corpus import Item
from gash_jax.nn.registry import ModelConfig


class Example(NamedTuple):
    """One shape as a graph, with its labels."""

    graph: jraph.GraphsTuple
    coefficients: Float[np.ndarray, "v k"]
    visibility: Float[np.ndarray, "v n"]


class Batch(NamedTuple):
    """A padded graph with labels of the same length; `mask` is True on real vertices that have a normal."""

    graph: jraph.GraphsTuple
    coefficients: Float[np.ndarray, "v k"]
    visibility: Float[np.ndarray, "v n"]
    mask: Bool[np.ndarray, "v"]


def make_examples(items: Sequence[Item], config: ModelConfig, seed: int = 0) -> list[Example]:
    """Build the graph that the model wants for every item."""
    return [
        Example(
            build_graph(item.mesh, config.graph, config.neighbours, seed + i),
            item.coefficients,
            item.visibility,
        )
        for i, item in enumerate(items)
    ]


def collate(examples: Sequence[Example], size: int) -> Batch:
    """Put examples side by side and pad to `size` vertices."""
    graph = batch_graphs([example.graph for example in examples], (size,))

    def padded(arrays: list[np.ndarray]) -> np.ndarray:
        joined = np.concatenate(arrays)
        return np.concatenate([joined, np.zeros((size - len(joined), joined.shape[1]), joined.dtype)])

    mask = np.asarray(node_mask(graph)) & np.any(np.asarray(graph.nodes["normal"]) != 0, axis=-1)  # type: ignore[index]
    coefficients = padded([example.coefficients for example in examples])
    return Batch(graph, coefficients, padded([example.visibility for example in examples]), mask)


def draw_batch(examples: Sequence[Example], size: int, seed: int, step: int) -> Batch:
    """The batch of a step: random shapes without repetition until the next one would not fit."""
    order = np.random.default_rng([seed, step]).permutation(len(examples))
    chosen, used = [], 0
    for index in order:
        count = len(examples[index].coefficients)
        # one vertex is kept free for padding edges to end at
        if used + count < size:
            chosen.append(examples[index])
            used += count
    if not chosen:
        raise ValueError(f"no shape fits into train.batch_vertices={size}: raise it, or lower data.max_vertices")
    return collate(chosen, size)
