"""What is in a graph, in which order, and in which units."""

from typing import Any

import jraph
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph.encodings import motor_nodes
from gash_jax.graph.mesh_graph import (
    build_graph,
    edgeless_graph,
    knn_graph,
    mesh_edge_graph,
    rings_graph,
    with_frames,
    with_relative_edges,
    with_relative_motors,
)
from gash_jax.graph.neighbours import knn, mesh_edges, rings

BUILDERS: dict[str, Any] = {
    "knn": lambda mesh: knn_graph(mesh, 5),
    "rings": rings_graph,
    "mesh": mesh_edge_graph,
    "none": edgeless_graph,
}


@pytest.mark.parametrize("kind", BUILDERS)
def test_every_graph_is_well_formed(bumpy: Mesh, kind: str) -> None:
    graph: Any = BUILDERS[kind](bumpy)
    v, e = len(bumpy.vertices), len(graph.senders)
    assert graph.n_node.tolist() == [v] and graph.n_edge.tolist() == [e]
    shapes = {name: leaf.shape for name, leaf in graph.nodes.items()}
    expected = {"motor": (v, 32), "position": (v, 3), "normal": (v, 3)}
    assert shapes == expected | ({"frame": (v, 3, 3)} if kind == "rings" else {})
    assert {name: leaf.shape for name, leaf in graph.edges.items()} == (
        {"relative": (e, 16)} if kind == "rings" else {}
    )
    assert {name: leaf.shape for name, leaf in graph.globals.items()} == {"center": (1, 3), "scale": (1,)}
    for leaf in (*graph.nodes.values(), *graph.edges.values(), *graph.globals.values()):
        assert isinstance(leaf, np.ndarray) and leaf.dtype == np.float32 and np.isfinite(leaf).all()
    assert graph.senders.dtype == graph.receivers.dtype == np.int32
    assert np.all(np.diff(graph.receivers) >= 0)
    np.testing.assert_array_equal(graph.nodes["motor"], motor_nodes(graph.nodes["position"], graph.nodes["normal"]))
    assert isinstance(graph, jraph.GraphsTuple)


def test_edges_are_those_of_the_tables(bumpy: Mesh) -> None:
    v = len(bumpy.vertices)
    graph: Any = knn_graph(bumpy, 7)
    np.testing.assert_array_equal(graph.senders.reshape(v, 7), knn(bumpy.vertices, 7))
    graph = rings_graph(bumpy, 3)
    np.testing.assert_array_equal(graph.senders.reshape(v, 32), rings(bumpy.vertices, 3))
    np.testing.assert_array_equal(graph.receivers, np.repeat(np.arange(v), 32))
    graph = mesh_edge_graph(bumpy)
    senders, receivers = mesh_edges(bumpy.faces, v)
    np.testing.assert_array_equal(graph.senders, senders)
    np.testing.assert_array_equal(graph.receivers, receivers)


def test_positions_fill_the_unit_ball_in_order(bumpy: Mesh) -> None:
    graph: Any = knn_graph(bumpy)
    low, high = bumpy.vertices.min(0), bumpy.vertices.max(0)
    center, scale = (low + high) / 2, np.linalg.norm(high - low) / 2
    np.testing.assert_allclose(graph.nodes["position"], (bumpy.vertices - center) / scale, atol=1e-6)
    np.testing.assert_allclose(graph.globals["center"][0], center, atol=1e-6)
    np.testing.assert_allclose(graph.globals["scale"], scale, rtol=1e-6)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
@pytest.mark.parametrize("kind", ["knn", "rings", "mesh"])
def test_unit_and_origin_never_reach_the_network(bumpy: Mesh, kind: str, scale: float) -> None:
    moved = transform(bumpy, None, np.array([1.0, -2.0, 3.0]) * scale, scale)
    graph, other = BUILDERS[kind](bumpy), BUILDERS[kind](moved)
    same = np.mean(graph.senders == other.senders) if len(graph.senders) == len(other.senders) else 0
    assert same == 1
    for name in ("motor", "position", "normal"):
        np.testing.assert_allclose(other.nodes[name], graph.nodes[name], atol=2e-6)


def test_loose_vertices_send_nothing_and_stay_in_bounds(bumpy: Mesh) -> None:
    far = np.array([[1e30, -1e30, 0.0], [0.0, 0.0, 0.0]], np.float32)
    vertices = np.concatenate([far, bumpy.vertices])
    normals = np.concatenate([np.zeros((2, 3), np.float32), bumpy.normals])
    mesh = Mesh(vertices, normals, bumpy.faces + np.int32(2))
    for kind in ("knn", "rings", "mesh"):
        graph: Any = BUILDERS[kind](mesh)
        assert graph.senders.min() >= 2
        assert np.abs(graph.nodes["position"]).max() <= 1
        assert all(np.isfinite(leaf).all() for leaf in (*graph.nodes.values(), *graph.edges.values()))
        np.testing.assert_allclose(graph.nodes["position"][2:], BUILDERS[kind](bumpy).nodes["position"], atol=1e-6)


def test_relative_edges_can_be_added_to_any_graph(bumpy: Mesh) -> None:
    plain: Any = mesh_edge_graph(bumpy)
    graph: Any = with_relative_edges(plain, bumpy)
    assert graph.edges["relative"].shape == (len(plain.senders), 16)
    assert "frame" not in plain.nodes and "relative" not in plain.edges


def test_build_graph_by_name(bumpy: Mesh) -> None:
    v = len(bumpy.vertices)
    np.testing.assert_array_equal(build_graph(bumpy, "knn", 6).senders, knn_graph(bumpy, 6).senders)
    np.testing.assert_array_equal(build_graph(bumpy, "rings", 32, 4).senders, rings_graph(bumpy, 4).senders)
    motors: Any = build_graph(bumpy, "knn", 6, encoding="relative-motor")
    assert motors.edges["motor"].shape == (6 * v, 8) and "frame" not in motors.nodes
    framed: Any = build_graph(bumpy, "rings", 16, encoding="relative-motor")
    assert framed.edges["motor"].shape == (16 * v, 8) and set(framed.edges) == {"motor"}
    plain: Any = build_graph(bumpy, "rings", 16, encoding="motor-7")
    assert plain.edges == {} and plain.nodes["frame"].shape == (v, 3, 3)
    for kind, k in (("rings", 16), ("none", 0)):
        assert build_graph(bumpy, kind, k).n_edge.tolist() == [k * v]
    with pytest.raises(ValueError, match="multiple of 4"):
        build_graph(bumpy, "rings", 30)
    with pytest.raises(ValueError, match="known are knn, rings, none"):
        build_graph(bumpy, "ring", 32)


def test_motors_between_frames_see_neither_unit_nor_axes(bumpy: Mesh, rotation: np.ndarray) -> None:
    graph: Any = build_graph(bumpy, "rings", 32, encoding="relative-motor")
    turned = transform(bumpy, rotation, np.array([3.0, -1.0, 2.0]), 7.5)
    bare = edgeless_graph(turned)._replace(senders=graph.senders, receivers=graph.receivers)
    moved: Any = with_relative_motors(with_frames(bare), turned)
    change = np.abs(moved.edges["motor"] - graph.edges["motor"]).max(1)
    assert np.quantile(change, 0.9) < 1e-4
