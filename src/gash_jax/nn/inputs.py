"""What the networks read from a graph: its dictionaries of arrays, where its edges end, and a vertex as numbers.

`jraph` leaves the types of nodes and edges open; in this project both are dictionaries of arrays by name.

A vertex is said to a network in one of these encodings:

    motor            the 32 numbers of its motor M = T R (GNN paper, 2.2)
    motor-7          those of them that are not 0 for every vertex, each once (the e- parts repeat the e+ parts)
    position-normal  6 numbers
    relative-motor   the rotor of its normal, 3 numbers; where it is, is said of edges (`graph.encodings`)
"""

from typing import cast

import jax.numpy as jnp
import jraph
import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra import cga

ROTOR = np.array([cga.SCALAR, cga.E12, cga.E23])
MOTOR_7 = np.array([*ROTOR, cga.E1P, cga.E2P, cga.E3P, cga.E123P])
VERTEX_ENCODINGS = ("motor", "motor-7", "position-normal")


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


def vertex_inputs(graph: jraph.GraphsTuple, encoding: str) -> Float[Array, "v d"]:
    """Every vertex in an encoding of the module docstring."""
    nodes = node_arrays(graph)
    if encoding == "position-normal":
        return jnp.concatenate([nodes["position"], nodes["normal"]], axis=-1)
    columns = {"motor-7": MOTOR_7, "relative-motor": ROTOR}.get(encoding)
    return nodes["motor"] if columns is None else nodes["motor"][:, columns]
