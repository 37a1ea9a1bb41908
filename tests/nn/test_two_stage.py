"""The two stages apart and together: shapes of the paper, ragged graphs, dropout."""

from functools import cache
from typing import Any

import jax
import numpy as np

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.mesh_graph import knn_graph, mesh_edge_graph
from gash_jax.models.families import build_model, model_config
from gash_jax.nn.two_stage import CoefficientNet, TwoStage, VisibilityNet
from tests.helpers.bumpy import bumpy_mesh, random_variables

MESH: Mesh = bumpy_mesh(40)
GRAPH = knn_graph(MESH, 4)


def _shapes(params: dict) -> dict[str, tuple[int, ...]]:
    flat, _ = jax.tree_util.tree_flatten_with_path(params)
    return {"/".join(part.key for part in path): leaf.shape for path, leaf in flat}


def test_widths_are_those_of_the_paper() -> None:
    module = build_model(model_config("two-stage"))
    shapes = _shapes(jax.eval_shape(module.init, jax.random.key(0), knn_graph(MESH))["params"])
    assert shapes["visibility/embed/kernel"] == (32, 64)
    assert shapes["visibility/conv_2/query/kernel"] == (64, 64)
    assert shapes["visibility/norm_2/scale"] == (64,)
    assert shapes["visibility/head/kernel"] == (64, 25)
    assert shapes["coefficient/embed/kernel"] == (57, 96)
    assert shapes["coefficient/conv_4/attention"] == (4, 24)
    assert shapes["coefficient/head/kernel"] == (96, 9)
    assert "visibility/conv_3/query/kernel" not in shapes and "coefficient/conv_5/attention" not in shapes
    # 32*64+64, 3 (4 (64*64+64) + 2*64), 64*25+25; 57*96+96, 5 (2 (96*96+96) + 2*96), 96*9+9
    sizes = sum(int(np.prod(shape)) for shape in shapes.values())
    assert sizes == 2112 + 3 * (4 * 4160 + 128) + 1625 + 5568 + 5 * (2 * 9312 + 192) + 873


def _small(block: int | None = None) -> TwoStage:
    return TwoStage(VisibilityNet(8, 1, 2, 25, 4, block), CoefficientNet(8, 1, 2, 3, 0.2, 4, block))


@cache
def _variables() -> Any:
    return random_variables(_small(), GRAPH)


def test_stages_compose() -> None:
    both, params = _small(), _variables()["params"]
    logits = jax.jit(lambda v: both.apply(v, GRAPH, method="visibility_logits"))(_variables())
    assert logits.shape == (40, 25)
    stage_1 = jax.jit(VisibilityNet(8, 1, 2, 25, 4).apply)({"params": params["visibility"]}, GRAPH)
    np.testing.assert_allclose(stage_1, logits, atol=1e-6)
    seen: Any = {**GRAPH.nodes, "visibility": 1 / (1 + np.exp(-np.asarray(logits)))}  # type: ignore[dict-item]
    stage_2 = jax.jit(CoefficientNet(8, 1, 2, 3, 0.2, 4).apply)
    expected = stage_2({"params": params["coefficient"]}, GRAPH._replace(nodes=seen))
    np.testing.assert_allclose(jax.jit(both.apply)(_variables(), GRAPH), expected, atol=1e-5)


def test_a_ragged_graph_gives_what_a_table_of_the_same_edges_gives() -> None:
    table, ragged = VisibilityNet(8, 1, 2, neighbours=4), VisibilityNet(8, 1, 2, neighbours=None)
    variables = random_variables(table, GRAPH)
    out = jax.jit(table.apply)(variables, GRAPH)
    np.testing.assert_allclose(jax.jit(ragged.apply)(variables, GRAPH), out, atol=1e-5)
    assert np.isfinite(jax.jit(ragged.apply)(variables, mesh_edge_graph(MESH))).all()


def test_blocks_serve_inference_alone_and_change_nothing() -> None:
    blocks = _small(16)
    out = jax.jit(blocks.apply)(_variables(), GRAPH)
    np.testing.assert_allclose(out, jax.jit(_small().apply)(_variables(), GRAPH), atol=1e-5)

    def training(variables: Any) -> Any:
        return blocks.apply(variables, GRAPH, False, rngs={"dropout": jax.random.key(0)})

    assert "scan" in str(jax.make_jaxpr(blocks.apply)(_variables(), GRAPH))
    assert "scan" not in str(jax.make_jaxpr(training)(_variables()))


def test_dropout_acts_in_training_alone() -> None:
    apply = jax.jit(lambda v, key: _small().apply(v, GRAPH, False, rngs={"dropout": key}))
    first, second = (np.asarray(apply(_variables(), jax.random.key(i))) for i in (0, 1))
    still = np.asarray(jax.jit(_small().apply)(_variables(), GRAPH))
    assert np.abs(first - second).max() > 1e-3
    # kept units are scaled up by 1/0.8: the mean over many draws is the value without dropout, through one layer
    keys = jax.random.split(jax.random.key(2), 400)
    mean = jax.lax.map(lambda key: apply(_variables(), key), keys).mean(axis=0)
    deviation = np.abs(first - still).max()
    assert np.abs(mean - still).max() < 0.2 * deviation
