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

from gash_jax.geometry.mesh import Mesh, center_and_scale, face_areas, referenced
from gash_jax.graph.encodings import frame_motors, motor_nodes, relative_edges, relative_motors, vertex_frames
from gash_jax.graph.neighbours import RING_DRAWS, RING_SHARES, knn, mesh_edges, rings

Graph = jraph.GraphsTuple


def _graph(mesh: Mesh, senders: Int[np.ndarray, "e"], receivers: Int[np.ndarray, "e"]) -> Graph:
    center, scale = center_and_scale(mesh)
    positions = (np.asarray(mesh.vertices, np.float64) - center) / scale
    loose = ~referenced(mesh)
    if loose.any() and not loose.all():
        corner = np.abs(positions[~loose]).max(axis=0)
        positions[loose] = np.clip(positions[loose], -corner, corner)
    positions, normals = positions.astype(np.float32), np.asarray(mesh.normals, np.float32)
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


def _table_graph(mesh: Mesh, table: Int[np.ndarray, "v k"]) -> Graph:
    receivers = np.repeat(np.arange(len(table), dtype=np.int32), table.shape[1])
    return _graph(mesh, table.reshape(-1), receivers)


def surface_radius(mesh: Mesh) -> float:
    """Root mean square distance of the surface from its centroid (each face at its own); 0 without area.

    The unit of edge lengths: unlike the box it turns with the mesh, and unlike the vertices it does not depend on
    how finely each part is triangulated.
    """
    areas, points = face_areas(mesh.vertices, mesh.faces), mesh.vertices.astype(np.float64)
    total = max(areas.sum(), np.finfo(float).tiny)
    first, second, third = (np.take(points, mesh.faces[:, i], axis=0) for i in range(3))
    middles = (first + second + third) / 3
    middles -= areas @ middles / total
    return float(np.sqrt(areas @ np.einsum("fi,fi->f", middles, middles) / total))


def with_frames(graph: Graph) -> Graph:
    """The graph with nodes["frame"] added."""
    nodes = cast(dict[str, np.ndarray], graph.nodes)
    frames = vertex_frames(nodes["position"], nodes["normal"], np.asarray(graph.senders), np.asarray(graph.receivers))
    return graph._replace(nodes={**nodes, "frame": frames})


def _in_radii(graph: Graph, mesh: Mesh) -> np.ndarray:
    """Positions in units of `surface_radius`."""
    _, scale = center_and_scale(mesh)
    return cast(dict, graph.nodes)["position"] * np.float32(scale / (surface_radius(mesh) or scale))


def with_relative_edges(graph: Graph, mesh: Mesh) -> Graph:
    """The mesh's graph with nodes["frame"] and edges["relative"] added; lengths in units of `surface_radius`."""
    graph = with_frames(graph)
    nodes = cast(dict[str, np.ndarray], graph.nodes)
    ends = np.asarray(graph.senders), np.asarray(graph.receivers)
    relative = relative_edges(_in_radii(graph, mesh), nodes["normal"], nodes["frame"], *ends)
    return graph._replace(edges={"relative": relative})


def with_relative_motors(graph: Graph, mesh: Mesh) -> Graph:
    """The mesh's graph with edges["motor"] added: between frames where it has them, else between normals."""
    nodes = cast(dict[str, np.ndarray], graph.nodes)
    motors = frame_motors(_in_radii(graph, mesh), nodes["frame"]) if "frame" in nodes else nodes["motor"]
    return graph._replace(
        edges={"motor": relative_motors(motors, np.asarray(graph.senders), np.asarray(graph.receivers))}
    )


def knn_graph(mesh: Mesh, k: int = 16) -> Graph:
    """Edges from the k nearest vertices to each vertex (the GNN paper's graph); e = v * k."""
    return _table_graph(mesh, knn(mesh.vertices, k, referenced(mesh)))


def mesh_edge_graph(mesh: Mesh) -> Graph:
    """The mesh's own edges, both directions; ragged."""
    return _graph(mesh, *mesh_edges(mesh.faces, len(mesh.vertices)))


def edgeless_graph(mesh: Mesh) -> Graph:
    """Nodes only, for a per-vertex network."""
    return _table_graph(mesh, np.empty((len(mesh.vertices), 0), np.int32))


def rings_graph(mesh: Mesh, seed: int = 0, each: int = RING_DRAWS, encoding: str = "relative") -> Graph:
    """`each` neighbours from every ring, near to far; e = v * 4 * each. See `neighbours.rings`.

    There are frames at the nodes; what there is at the edges depends on the encoding.
    """
    graph = _table_graph(mesh, rings(mesh.vertices, seed, RING_SHARES, each, referenced(mesh)))
    return with_relative_edges(graph, mesh) if encoding == "relative" else with_frames(graph)


def build_graph(mesh: Mesh, kind: str, neighbours: int, seed: int = 0, encoding: str = "relative") -> Graph:
    """The graph that a model config names: "knn", "rings" (neighbours must be a multiple of 4) or "none".

    `encoding` says what is at the edges: of "rings" the relative features, of any graph "relative-motor".
    """
    if kind == "knn":
        graph = knn_graph(mesh, neighbours)
    elif kind == "rings":
        if neighbours % len(RING_SHARES):
            raise ValueError(f"{neighbours} neighbours in rings: take a multiple of {len(RING_SHARES)}")
        graph = rings_graph(mesh, seed, neighbours // len(RING_SHARES), encoding)
    elif kind == "none":
        graph = edgeless_graph(mesh)
    else:
        raise ValueError(f"unknown graph {kind!r}: known are knn, rings, none")
    return with_relative_motors(graph, mesh) if encoding == "relative-motor" else graph
