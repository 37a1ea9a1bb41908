"""Padding and batching keep every graph as it was, and say which nodes are real."""

from typing import Any

import jax
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.batching import batch_graphs, fixed_neighbours, node_mask, pad_graph
from gash_jax.graph.mesh_graph import edgeless_graph, knn_graph, mesh_edge_graph, rings_graph
from tests.helpers.bumpy import bumpy_mesh


@pytest.fixture(scope="module")
def meshes() -> list[Mesh]:
    return [bumpy_mesh(count, count) for count in (20, 50, 30)]


def test_padding_adds_loops_of_its_own(meshes: list[Mesh]) -> None:
    graph: Any = rings_graph(meshes[0])
    padded: Any = pad_graph(graph, 27)
    assert padded.n_node.tolist() == [20, 7] and padded.n_edge.tolist() == [640, 224]
    np.testing.assert_array_equal(padded.receivers, np.repeat(np.arange(27), 32))
    np.testing.assert_array_equal(padded.senders[:640], graph.senders)
    np.testing.assert_array_equal(padded.senders[640:], padded.receivers[640:])
    for name, leaf in graph.nodes.items():
        np.testing.assert_array_equal(padded.nodes[name][:20], leaf)
        assert not padded.nodes[name][20:].any()
    np.testing.assert_array_equal(padded.edges["relative"][:640], graph.edges["relative"])
    assert padded.globals["scale"].tolist() == [*graph.globals["scale"].tolist(), 0]
    assert padded.senders.dtype == np.int32


def test_a_full_graph_still_gets_an_empty_padding_graph(meshes: list[Mesh]) -> None:
    assert pad_graph(knn_graph(meshes[0], 4), 20).n_node.tolist() == [20, 0]


def test_batch_takes_the_smallest_size_and_offsets_edges(meshes: list[Mesh]) -> None:
    graphs: list[Any] = [knn_graph(mesh, 4) for mesh in meshes]
    batch: Any = batch_graphs(graphs, (200, 128, 64))
    assert batch.n_node.tolist() == [20, 50, 30, 28]
    assert fixed_neighbours(batch) == 4
    np.testing.assert_array_equal(batch.senders[80:280], graphs[1].senders + 20)
    np.testing.assert_array_equal(batch.nodes["motor"][70:100], graphs[2].nodes["motor"])
    assert batch_graphs([edgeless_graph(mesh) for mesh in meshes], (100,)).n_edge.tolist() == [0, 0, 0, 0]


def test_node_mask_is_true_on_real_nodes(meshes: list[Mesh]) -> None:
    graphs: list[Any] = [knn_graph(mesh, 4) for mesh in meshes]
    expected = np.arange(128) < 100
    batch: Any = batch_graphs(graphs, (128,))
    np.testing.assert_array_equal(node_mask(batch), expected)
    np.testing.assert_array_equal(jax.jit(node_mask)(batch), expected)
    assert np.asarray(node_mask(graphs[0])).all()


def test_what_cannot_be_batched_is_named(meshes: list[Mesh]) -> None:
    with pytest.raises(ValueError, match="ragged"):
        pad_graph(mesh_edge_graph(meshes[0]), 64)
    with pytest.raises(ValueError, match="larger size"):
        pad_graph(knn_graph(meshes[0], 4), 19)
    with pytest.raises(ValueError, match="choose a larger"):
        batch_graphs([knn_graph(mesh, 4) for mesh in meshes], (50, 99))
    with pytest.raises(ValueError, match=r"\[4, 5\] neighbours"):
        batch_graphs([knn_graph(meshes[0], 4), knn_graph(meshes[1], 5)], (99,))
    with pytest.raises(ValueError, match="at least one"):
        batch_graphs([], (99,))
