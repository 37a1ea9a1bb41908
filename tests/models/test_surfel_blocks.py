"""Blocks of vertices: what a batch holds, that every vertex counts once, and that blocks predict as the whole does."""

from typing import Any

import jax
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.surfel_selection import BLOCK
from gash_jax.models import surfel_blocks as blocks
from gash_jax.models import surfel_inference as inference
from gash_jax.models.examples import Example
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.surfel_blocks import BlockPool
from gash_jax.models.surfel_inference import predict_surfels
from gash_jax.nn.surfel_net import by_band
from tests.helpers.bumpy import bumpy_mesh, random_variables

CONFIG = model_config("local", channels=8, layers=1, neighbours=12)


def _mesh(count: int, seed: int) -> Mesh:
    mesh = bumpy_mesh(count, seed)
    mesh.normals[3] = 0
    return mesh


def _example(count: int, seed: int) -> Example:
    """Labels name the vertex: shape in column 0, index in column 1."""
    mesh = _mesh(count, seed)
    labels = np.full((count, 9), 1 + seed, np.float32)
    labels[:, 1] = np.arange(count)
    return Example(model_graph(CONFIG, mesh), labels, np.ones((count, 25), np.float32))


EXAMPLES = [_example(count, seed) for seed, count in enumerate((50, 75, 33))]


def test_labels_belong_to_the_nodes_and_every_vertex_counts_once() -> None:
    (batch,) = BlockPool(EXAMPLES).in_order(10_000)
    mask, labels = batch.mask[0], batch.coefficients[0]
    names = [tuple(row) for row in labels[mask][:, :2].astype(int)]
    expected = {(1 + s, i) for s, e in enumerate(EXAMPLES) for i in range(len(e.coefficients)) if i != 3}
    assert len(names) == len(set(names)) and set(names) == expected
    positions = batch.inputs["position"][0].reshape(-1, 3)
    np.testing.assert_array_equal(batch.normals[0], batch.inputs["normal"][0].reshape(-1, 3))
    for (shape, index), place in zip(names, positions[mask], strict=True):
        graph: Any = EXAMPLES[shape - 1].graph
        np.testing.assert_array_equal(place, graph.blocks["position"].reshape(-1, 3)[graph.slot[index]])
    assert not batch.weight[0][~mask].any() and (batch.weight[0][mask] > 0).all()


def test_batches_in_order_hold_every_vertex_once_whatever_their_size() -> None:
    pool = BlockPool(EXAMPLES)
    for size in (BLOCK, 3 * BLOCK, 7 * BLOCK):
        found = [b.coefficients[0][b.mask[0]] for b in pool.in_order(size)]
        assert len(np.concatenate(found)) == sum(len(e.coefficients) - 1 for e in EXAMPLES)
        assert len({b.coefficients.shape for b in pool.in_order(size)}) == 1


def test_a_batch_is_a_function_of_seed_and_step_and_not_of_the_devices() -> None:
    pool = BlockPool(EXAMPLES)
    one, same, other, spread = (pool.draw(8 * BLOCK, 0, s, n) for s, n in ((5, 1), (5, 1), (6, 1), (5, 4)))
    np.testing.assert_array_equal(one.coefficients, same.coefficients)
    assert not np.array_equal(one.coefficients, other.coefficients)
    np.testing.assert_array_equal(one.coefficients[0], spread.coefficients.reshape(-1, 9))
    with pytest.raises(ValueError, match="raise train.batch_vertices"):
        pool.draw(BLOCK - 1, 0, 0)
    with pytest.raises(ValueError, match="for 4 devices"):
        pool.draw(3 * BLOCK, 0, 0, 4)


def test_only_area_vectors_are_hidden_or_reversed(monkeypatch: pytest.MonkeyPatch) -> None:
    pool = BlockPool(EXAMPLES)
    plain = pool.blocks["surfel"].copy()
    monkeypatch.setattr(blocks, "HIDDEN", 0.5)
    monkeypatch.setattr(blocks, "REVERSED", 0.5)
    rows = pool.draw(8 * BLOCK, 0, 0).inputs["surfel"][0]
    assert rows.shape[:2] == (8, 12)
    np.testing.assert_array_equal(pool.blocks["surfel"], plain)
    kinds = set()
    for block in rows:
        (match,) = [p for p in plain if np.array_equal(np.delete(p, [3, 4, 5], 1), np.delete(block, [3, 4, 5], 1))]
        if not block[:, 3:6].any():
            kinds.add("hidden")
        else:
            np.testing.assert_array_equal(np.abs(block[:, 3:6]), np.abs(match[:, 3:6]))
            kinds.add("as it is" if np.array_equal(block, match) else "reversed")
    assert kinds == {"hidden", "reversed", "as it is"}


def test_shapes_that_the_closed_form_serves_well_weigh_more() -> None:
    near, far = EXAMPLES[0], EXAMPLES[1]
    graph: Any = near.graph
    exact = np.asarray(unshadowed_transfer(graph.blocks["normal"].reshape(-1, 3)[graph.slot], 3))
    pool = BlockPool([near._replace(coefficients=exact + np.float32(0.01)), far])
    assert pool.weight[0] > 2 * pool.weight[-1] and pool.weight.mean() == pytest.approx(1, rel=1e-5)


@pytest.mark.parametrize("workers", [1, 3])
def test_blocks_predict_as_the_whole_does(workers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inference, "CALLS", (4,))
    module = build_model(CONFIG)
    graph: Any = model_graph(CONFIG, _mesh(150, 7))
    variables = random_variables(module, graph.blocks)
    whole = np.asarray(jax.jit(module.apply)(variables, graph.blocks))[graph.slot]
    coefficients, error = predict_surfels(module, variables["params"], graph, workers)
    np.testing.assert_allclose(coefficients, whole[:, :9], atol=1e-5)
    np.testing.assert_allclose(error, by_band(jax.numpy.asarray(whole[:, 9:]), 3), atol=1e-5)
    assert not coefficients[3].any() and coefficients.shape == error.shape == (150, 9)


def test_small_meshes_keep_all_workers_busy() -> None:
    # by hand: 32 blocks for two workers are two calls of 16 (16 + 4), not one padded to 64 (64 + 4)
    assert inference.call_size(32, 2) == 16
    assert inference.call_size(5, 1) == 8
    assert inference.call_size(130, 2) == 64
    assert inference.call_size(100000, 2) == inference.call_size(100000, 1) == 64
    assert all(size % inference.GROUP == 0 for size in inference.CALLS)
