"""Several graphs as one, padded to a size from a short list, so that a compiled network meets few shapes.

Only for graphs with a fixed number of neighbours k. The padding is one more graph at the end (possibly of no
nodes): its nodes are zero and each has k edges from and to itself, so receivers stay sorted, e = v * k stays true
and no edge crosses from padding to real nodes. Its scale is 0, which no real graph has: `node_mask` goes by that.
"""

from collections.abc import Sequence
from typing import Any, cast

import jax.numpy as jnp
import jraph
import numpy as np
from jaxtyping import Array, Bool


def fixed_neighbours(graph: jraph.GraphsTuple) -> int:
    """k of a graph in which the edges of node i are i*k ... i*k + k - 1. Raises ValueError where it is ragged."""
    n_node, receivers = int(np.sum(graph.n_node)), np.asarray(graph.receivers)
    k, rest = divmod(len(receivers), max(n_node, 1))
    if rest or np.any(receivers.reshape(n_node, k) != np.arange(n_node)[:, None]):
        raise ValueError("graph is ragged: batching needs the same number of neighbours at every vertex (knn, rings)")
    return k


def _zeros(tree: object, rows: int) -> dict[str, np.ndarray]:
    return {
        name: np.zeros((rows, *leaf.shape[1:]), leaf.dtype) for name, leaf in cast(dict[str, np.ndarray], tree).items()
    }


def _side_by_side(graphs: Sequence[jraph.GraphsTuple]) -> jraph.GraphsTuple:
    """`jraph.batch_np`, which makes the edges int64, in int32."""
    joined = jraph.batch_np(list(graphs))
    senders, receivers = (np.asarray(ends, np.int32) for ends in (joined.senders, joined.receivers))
    return joined._replace(senders=senders, receivers=receivers)


def pad_graph(graph: jraph.GraphsTuple, n_node: int) -> jraph.GraphsTuple:
    """The graph with a padding graph appended, `n_node` nodes in all. Raises ValueError if it has more or is ragged."""
    used, k = int(np.sum(graph.n_node)), fixed_neighbours(graph)
    if used > n_node:
        raise ValueError(f"graph of {used} nodes cannot be padded to {n_node}: choose a larger size")
    own = np.repeat(np.arange(n_node - used, dtype=np.int32), k)
    padding: dict[str, Any] = {
        "nodes": _zeros(graph.nodes, n_node - used),
        "edges": _zeros(graph.edges, len(own)),
        "senders": own,
        "receivers": own,
        "globals": _zeros(graph.globals, 1),
        "n_node": np.array([n_node - used], np.int32),
        "n_edge": np.array([len(own)], np.int32),
    }
    return _side_by_side([graph, jraph.GraphsTuple(**padding)])


def batch_graphs(graphs: Sequence[jraph.GraphsTuple], sizes: Sequence[int]) -> jraph.GraphsTuple:
    """Graphs side by side, padded to the smallest of `sizes` (numbers of nodes) that holds them.

    Raises ValueError if there is no graph, none of the sizes is large enough, or neighbour counts differ.
    """
    if not graphs:
        raise ValueError("no graphs to batch: give at least one")
    counts = {fixed_neighbours(graph) for graph in graphs}
    if len(counts) > 1:
        raise ValueError(f"graphs with {sorted(counts)} neighbours in one batch: build them with the same number")
    used = sum(int(np.sum(graph.n_node)) for graph in graphs)
    fitting = [size for size in sizes if size >= used]
    if not fitting:
        raise ValueError(f"batch of {used} nodes: the largest size is {max(sizes, default=0)}, choose a larger one")
    return pad_graph(_side_by_side(graphs), min(fitting))


def node_mask(graph: jraph.GraphsTuple) -> Bool[Array, "v"]:
    """True on real nodes, False on padding; works under jit."""
    positions, scale = cast(dict, graph.nodes)["position"], jnp.asarray(cast(dict, graph.globals)["scale"])
    return jnp.repeat(scale > 0, jnp.asarray(graph.n_node), total_repeat_length=len(positions))
