"""Mesh -> `jraph.GraphsTuple`, in the four forms that models here are trained on.

    nodes     {"motor": (v, 32), "position": (v, 3), "normal": (v, 3)}; of "rings" also "frame": (v, 3, 3)
    edges     {}, {"relative": (e, 16)} or {"motor": (e, 8)}, see `encoding`
    senders, receivers  (e,) int32, sorted by receiver; messages go from sender to receiver
    globals   {"center": (1, 3), "scale": (1,)}

Node i is vertex i of the mesh. Positions are (vertex - center) / scale with the bounding-box centre of the referenced
vertices and half the box's diagonal, so they lie within the unit ball whatever the file's unit; a vertex in no face is
moved to the box's nearest point. In graphs with a fixed number of neighbours k the edges of vertex i are
i*k ... i*k + k - 1, which is what networks rely on to gather instead of scatter. All arrays are NumPy, float32.
"""

from typing import Any, cast

import jraph
import numpy as np
from jaxtyping import Int

from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.graph.encodings import frame_motors, motor_nodes, relative_edges, relative_motors, vertex_frames
from gash_jax.graph.neighbours import RING_DRAWS, RING_SHARES, knn, mesh_edges, rings

Graph = jraph.GraphsTuple


def _graph(shape: NormalisedMesh, senders: Int[np.ndarray, "e"], receivers: Int[np.ndarray, "e"]) -> Graph:
    center, scale = shape.center, shape.half_diagonal
    positions, normals = shape.positions(scale).astype(np.float32), np.asarray(shape.mesh.normals, np.float32)
    fields: dict[str, Any] = {
        "nodes": {"motor": motor_nodes(positions, normals), "position": positions, "normal": normals},
        "edges": {},
        "senders": senders,
        "receivers": receivers,
        "globals": {"center": np.asarray(center, np.float32).reshape(1, 3), "scale": np.full(1, scale, np.float32)},
        "n_node": np.array([len(positions)], np.int32),
        "n_edge": np.array([len(senders)], np.int32),
    }
    return Graph(**fields)


def _table_graph(shape: NormalisedMesh, table: Int[np.ndarray, "v k"]) -> Graph:
    receivers = np.repeat(np.arange(len(table), dtype=np.int32), table.shape[1])
    return _graph(shape, table.reshape(-1), receivers)


def with_frames(graph: Graph) -> Graph:
    """The graph with nodes["frame"] added."""
    nodes = cast(dict[str, np.ndarray], graph.nodes)
    frames = vertex_frames(nodes["position"], nodes["normal"], np.asarray(graph.senders), np.asarray(graph.receivers))
    return graph._replace(nodes={**nodes, "frame": frames})


def _in_radii(graph: Graph, shape: NormalisedMesh) -> np.ndarray:
    """Positions in units of the surface's radius."""
    scale = shape.half_diagonal
    return cast(dict, graph.nodes)["position"] * np.float32(scale / (shape.radius or scale))


def with_relative_edges(graph: Graph, mesh: Mesh | NormalisedMesh) -> Graph:
    """The mesh's graph with nodes["frame"] and edges["relative"] added; lengths in units of the surface's radius."""
    graph = with_frames(graph)
    nodes = cast(dict[str, np.ndarray], graph.nodes)
    ends = np.asarray(graph.senders), np.asarray(graph.receivers)
    relative = relative_edges(_in_radii(graph, NormalisedMesh.of(mesh)), nodes["normal"], nodes["frame"], *ends)
    return graph._replace(edges={"relative": relative})


def with_relative_motors(graph: Graph, mesh: Mesh | NormalisedMesh) -> Graph:
    """The mesh's graph with edges["motor"] added: between frames where it has them, else between normals."""
    nodes = cast(dict[str, np.ndarray], graph.nodes)
    if "frame" in nodes:
        motors = frame_motors(_in_radii(graph, NormalisedMesh.of(mesh)), nodes["frame"])
    else:
        motors = nodes["motor"]
    return graph._replace(
        edges={"motor": relative_motors(motors, np.asarray(graph.senders), np.asarray(graph.receivers))}
    )


def knn_graph(mesh: Mesh | NormalisedMesh, k: int = 16) -> Graph:
    """Edges from the k nearest vertices to each vertex (the GNN paper's graph); e = v * k."""
    shape = NormalisedMesh.of(mesh)
    return _table_graph(shape, knn(shape.mesh.vertices, k, shape.referenced))


def mesh_edge_graph(mesh: Mesh) -> Graph:
    """The mesh's own edges, both directions; ragged."""
    return _graph(NormalisedMesh(mesh), *mesh_edges(mesh.faces, len(mesh.vertices)))


def edgeless_graph(mesh: Mesh) -> Graph:
    """Nodes only, for a per-vertex network."""
    return _table_graph(NormalisedMesh(mesh), np.empty((len(mesh.vertices), 0), np.int32))


def rings_graph(
    mesh: Mesh | NormalisedMesh, seed: int = 0, each: int = RING_DRAWS, encoding: str = "relative"
) -> Graph:
    """`each` neighbours from every ring, near to far; e = v * 4 * each. See `neighbours.rings`.

    There are frames at the nodes; what there is at the edges depends on the encoding.
    """
    shape = NormalisedMesh.of(mesh)
    graph = _table_graph(shape, rings(shape.mesh.vertices, seed, RING_SHARES, each, shape.referenced))
    return with_relative_edges(graph, shape) if encoding == "relative" else with_frames(graph)


def build_graph(mesh: Mesh, kind: str, neighbours: int, seed: int = 0, encoding: str = "relative") -> Graph:
    """The graph that a model config names: "knn", "rings" (neighbours must be a multiple of 4) or "none".

    `encoding` says what is at the edges: of "rings" the relative features, of any graph "relative-motor".
    """
    shape = NormalisedMesh(mesh)
    if kind == "knn":
        graph = knn_graph(shape, neighbours)
    elif kind == "rings":
        if neighbours % len(RING_SHARES):
            raise ValueError(f"{neighbours} neighbours in rings: take a multiple of {len(RING_SHARES)}")
        graph = rings_graph(shape, seed, neighbours // len(RING_SHARES), encoding)
    elif kind == "none":
        graph = edgeless_graph(mesh)
    else:
        raise ValueError(f"unknown graph {kind!r}: known are knn, rings, none")
    return with_relative_motors(graph, shape) if encoding == "relative-motor" else graph
