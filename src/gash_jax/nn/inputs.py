"""What the networks read from a graph: its dictionaries of arrays, and where its edges end.

`jraph` leaves the types of nodes and edges open; in this project both are dictionaries of arrays by name.
"""

from typing import cast

import jax.numpy as jnp
import jraph
from jaxtyping import Array, Int


def node_arrays(graph: jraph.GraphsTuple) -> dict[str, Array]:
    """The node arrays by name, on the device."""
    return {name: jnp.asarray(leaf) for name, leaf in cast(dict[str, Array], graph.nodes).items()}


def edge_arrays(graph: jraph.GraphsTuple) -> dict[str, Array]:
    """The edge arrays by name, on the device."""
    return {name: jnp.asarray(leaf) for name, leaf in cast(dict[str, Array], graph.edges).items()}


def edge_ends(
    graph: jraph.GraphsTuple, neighbours: int | None
) -> tuple[Int[Array, "v k"] | Int[Array, "e"], Int[Array, "e"] | None]:
    """What the layers take: the table (v, k) of a graph with k `neighbours`, or its list of edges where that is None.

    Raises ValueError where the number of edges is not v * k.
    """
    if neighbours is None:
        return jnp.asarray(graph.senders), jnp.asarray(graph.receivers)
    senders, n_node = jnp.asarray(graph.senders), len(node_arrays(graph)["motor"])
    if len(senders) != n_node * neighbours:
        raise ValueError(f"{len(senders)} edges at {n_node} nodes: this network wants {neighbours} neighbours at each")
    return senders.reshape(n_node, neighbours), None
