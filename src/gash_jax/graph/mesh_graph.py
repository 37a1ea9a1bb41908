"""Mesh -> `jraph.GraphsTuple`, in the four forms that models here are trained on.

    nodes     {"motor": (v, 32), "position": (v, 3), "normal": (v, 3)}; with relative edges also "frame": (v, 3, 3)
    edges     {} or {"relative": (e, 16)}, see `encoding`
    senders, receivers  (e,) int32, sorted by receiver; messages go from sender to receiver
    globals   {"center": (1, 3), "scale": (1,)}

Node i is vertex i of the mesh. Positions are (vertex - center) / scale with the bounding-box centre of the referenced
vertices and half the box's diagonal, so they lie within the unit ball whatever the file's unit; a vertex in no face is
moved to the box's nearest point. In graphs with a fixed number of neighbours k the edges of vertex i are
i*k ... i*k + k - 1, which is what networks rely on to gather instead of scatter. All arrays are NumPy, float32.
"""

import jraph
import numpy as np
from jaxtyping import Int

from gash_jax.geometry.mesh import Mesh, center_and_scale, referenced
from gash_jax.graph.encoding import motor_nodes, relative_edges, vertex_frames
from gash_jax.graph.neighbours import RING_DRAWS, RING_SHARES, knn, mesh_edges, radius_edges, rings

Graph = jraph.GraphsTuple


def _graph(mesh: Mesh, senders: Int[np.ndarray, "e"], receivers: Int[np.ndarray, "e"]) -> Graph:
    center, scale = center_and_scale(mesh)
    positions = (np.asarray(mesh.vertices, np.float64) - center) / scale
    loose = ~referenced(mesh)
    if loose.any() and not loose.all():
        corner = np.abs(positions[~loose]).max(axis=0)
        positions[loose] = np.clip(positions[loose], -corner, corner)
    positions, normals = positions.astype(np.float32), np.asarray(mesh.normals, np.float32)
    return Graph(
        nodes={"motor": motor_nodes(positions, normals), "position": positions, "normal": normals},
        edges={},
        senders=senders,
        receivers=receivers,
        globals={
            "center": np.asarray(center, np.float32).reshape(1, 3),
            "scale": np.full(1, scale, np.float32),
        },
        n_node=np.array([len(positions)], np.int32),
        n_edge=np.array([len(senders)], np.int32),
    )


def _table_graph(mesh: Mesh, table: Int[np.ndarray, "v k"]) -> Graph:
    receivers = np.repeat(np.arange(len(table), dtype=np.int32), table.shape[1])
    return _graph(mesh, table.reshape(-1), receivers)


def with_relative_edges(graph: Graph) -> Graph:
    """The graph with nodes["frame"] and edges["relative"] added."""
    nodes: dict[str, np.ndarray] = graph.nodes  # type: ignore[assignment]
    ends = graph.senders, graph.receivers
    frames = vertex_frames(nodes["position"], nodes["normal"], *ends)  # type: ignore[arg-type]
    relative = relative_edges(nodes["position"], nodes["normal"], frames, *ends)  # type: ignore[arg-type]
    return graph._replace(nodes={**nodes, "frame": frames}, edges={**graph.edges, "relative": relative})


def knn_graph(mesh: Mesh, k: int = 16) -> Graph:
    """Edges from the k nearest vertices to each vertex (the GNN paper's graph); e = v * k."""
    return _table_graph(mesh, knn(mesh.vertices, k, referenced(mesh)))


def radius_graph(mesh: Mesh, radius: float) -> Graph:
    """Edges between vertices at most `radius` apart, in units of the graph's scale; ragged."""
    _, scale = center_and_scale(mesh)
    return _graph(mesh, *radius_edges(mesh.vertices, radius * float(scale), referenced(mesh)))


def mesh_edge_graph(mesh: Mesh) -> Graph:
    """The mesh's own edges, both directions; ragged."""
    return _graph(mesh, *mesh_edges(mesh.faces, len(mesh.vertices)))


def edgeless_graph(mesh: Mesh) -> Graph:
    """Nodes only, for a per-vertex network."""
    return _table_graph(mesh, np.empty((len(mesh.vertices), 0), np.int32))


def rings_graph(mesh: Mesh, seed: int = 0, each: int = RING_DRAWS) -> Graph:
    """`each` neighbours from every ring, near to far, with relative edges; e = v * 4 * each. See `neighbours.rings`."""
    return with_relative_edges(_table_graph(mesh, rings(mesh.vertices, seed, RING_SHARES, each, referenced(mesh))))


def build_graph(mesh: Mesh, kind: str, neighbours: int, seed: int = 0) -> Graph:
    """The graph that a model config names: "knn", "rings" (neighbours must be a multiple of 4) or "none"."""
    if kind == "knn":
        return knn_graph(mesh, neighbours)
    if kind == "rings":
        if neighbours % len(RING_SHARES):
            raise ValueError(f"{neighbours} neighbours in rings: take a multiple of {len(RING_SHARES)}")
        return rings_graph(mesh, seed, neighbours // len(RING_SHARES))
    if kind == "none":
        return edgeless_graph(mesh)
    raise ValueError(f"unknown graph {kind!r}: known are knn, rings, none")
