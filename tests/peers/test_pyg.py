"""Live parity with PyTorch Geometric: both layers on random graphs, forward and gradients, and the two-stage network.

Needs the extra `peers` (`make peers`); values kept in tests/golden hold the layers to the same numbers without it.
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

REASON = "needs PyTorch Geometric: make peers"
torch: Any = pytest.importorskip("torch", reason=REASON)
pytest.importorskip("torch_geometric", reason=REASON)

from torch_geometric import nn as pyg  # noqa: E402  # pyright: ignore[reportMissingImports]

from gash_jax.apps.frontier import pyg_two_stage  # noqa: E402
from gash_jax.models.families import build_model, model_config, model_graph  # noqa: E402
from gash_jax.models.model import load_model, save_model  # noqa: E402
from gash_jax.nn.attention import GATv2Conv, TransformerConv  # noqa: E402
from gash_jax.nn.inputs import node_arrays  # noqa: E402
from gash_jax.shapes.procedural import make_shape  # noqa: E402
from tests.helpers.bumpy import bumpy_mesh, random_variables  # noqa: E402

LAYERS: dict[str, tuple[Any, Any]] = {
    "gatv2": (GATv2Conv, pyg.GATv2Conv),
    "transformer": (TransformerConv, pyg.TransformerConv),
}
WIDTH, HEADS, INPUTS = 5, 3, 7
pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")


def ragged_edges(seed: int) -> tuple[int, np.ndarray]:
    """Nodes and edges sorted by receiver, with loops, doubled edges, and nodes that nothing reaches."""
    rng = np.random.default_rng(seed)
    nodes = int(rng.integers(2, 40))
    senders, receivers = rng.integers(0, nodes, (2, int(rng.integers(0, 6 * nodes))))
    receivers[receivers == nodes // 2] = 0  # an isolated one
    senders = np.concatenate([senders, senders[:3], [1]])
    receivers = np.concatenate([receivers, receivers[:3], [1]])
    order = np.argsort(receivers, kind="stable")
    return nodes, np.stack([senders, receivers])[:, order]


def table_edges(seed: int) -> tuple[int, np.ndarray]:
    """Four senders at every node, among them the node itself now and then."""
    rng = np.random.default_rng(seed)
    nodes = int(rng.integers(6, 40))
    return nodes, np.stack([rng.integers(0, nodes, 4 * nodes), np.repeat(np.arange(nodes), 4)])


def _theirs(layer: Any, weights: Any, x: np.ndarray, edges: np.ndarray, cotangent: np.ndarray) -> dict[str, np.ndarray]:
    """Output and gradients by PyTorch Geometric, named and shaped as ours."""
    pyg_two_stage.load_layer(layer, weights)
    leaf = torch.tensor(x, requires_grad=True)
    out = layer(leaf, torch.tensor(edges))
    (out * torch.tensor(cotangent)).sum().backward()
    values = {"out": out.detach().numpy(), "x": leaf.grad.numpy()}
    for theirs, ours in pyg_two_stage.CONV[type(layer).__name__].items():
        part = getattr(layer, theirs)
        values |= {f"{ours}/kernel": part.weight.grad.numpy().T, f"{ours}/bias": part.bias.grad.numpy()}
    if hasattr(layer, "att"):
        values |= {"attention": layer.att.grad.numpy()[0], "bias": layer.bias.grad.numpy()}
    return values


def _ours(module: Any, weights: Any, x: np.ndarray, ends: tuple, cotangent: np.ndarray) -> dict[str, np.ndarray]:
    def loss(weights: Any, x: Any) -> tuple[jax.Array, jax.Array]:
        out = module.apply({"params": weights}, x, *ends)
        return jnp.sum(out * cotangent), out

    (by_weight, by_x), out = jax.grad(loss, argnums=(0, 1), has_aux=True)(weights, x)
    flat = {"/".join(key.key for key in path): leaf for path, leaf in jax.tree.leaves_with_path(by_weight)}
    return {"out": out, "x": by_x, **flat}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("path", ["ragged", "table", "masked"])
@pytest.mark.parametrize("layer", LAYERS)
def test_layers_and_their_gradients(layer: str, path: str, seed: int) -> None:
    ours, theirs = LAYERS[layer][0](WIDTH, HEADS), LAYERS[layer][1](INPUTS, WIDTH, heads=HEADS)
    nodes, edges = (table_edges if path == "table" else ragged_edges)(seed)
    rng = np.random.default_rng(100 + seed)
    x, cotangent = rng.normal(size=(nodes, INPUTS)), rng.normal(size=(nodes, WIDTH * HEADS))
    x, cotangent = x.astype(np.float32), cotangent.astype(np.float32)
    ends: tuple[Any, ...] = tuple(edges.astype(np.int32))
    if path == "table":
        ends = (ends[0].reshape(nodes, 4),)
    if path == "masked":  # further edges that do not count
        extra = rng.integers(0, nodes, (2, 9))
        both = np.concatenate([edges, extra], axis=1)
        order = np.argsort(both[1], kind="stable")
        keep = np.arange(both.shape[1]) < edges.shape[1]
        ends = (*both[:, order].astype(np.int32), keep[order])
    weights = random_variables(ours, x, *ends, spread=0.5)["params"]
    truth, found = _theirs(theirs, weights, x, edges, cotangent), _ours(ours, weights, x, ends, cotangent)
    assert set(truth) == set(found)
    for name, value in truth.items():
        np.testing.assert_allclose(found[name], value, atol=1e-5 * max(1, np.abs(value).max()), err_msg=name)


def test_the_comparison_sees_a_wrong_layer() -> None:
    nodes, edges = ragged_edges(0)
    x = np.random.default_rng(0).normal(size=(nodes, INPUTS)).astype(np.float32)
    module, ends = GATv2Conv(WIDTH, HEADS), tuple(edges.astype(np.int32))
    weights = random_variables(module, x, *ends, spread=0.5)["params"]
    cotangent = np.ones((nodes, WIDTH * HEADS), np.float32)
    wrong = pyg.GATv2Conv(INPUTS, WIDTH, heads=HEADS, negative_slope=0.1)
    truth = _theirs(wrong, weights, x, edges, cotangent)
    assert np.abs(_ours(module, weights, x, ends, cotangent)["out"] - truth["out"]).max() > 1e-3


def test_the_two_stage_network(tmp_path: Path) -> None:
    config = model_config("two-stage", channels=24, layers=2, visibility_channels=16, visibility_layers=2, neighbours=7)
    mesh = make_shape(3, 1, (300, 400))[1]
    path = tmp_path / "model.npz"
    weights = random_variables(build_model(config), model_graph(config, bumpy_mesh(30)), spread=0.2)["params"]
    save_model(path, config, weights, name="test")
    model = load_model(path)
    graph = model.graph(mesh)
    nodes = {name: np.asarray(leaf) for name, leaf in node_arrays(graph).items()}
    found = pyg_two_stage.predict(pyg_two_stage.load_pyg(path), nodes["motor"], graph.senders, graph.receivers)
    truth = np.asarray(model(graph))
    usable = np.any(nodes["normal"] != 0, axis=1)
    np.testing.assert_allclose(found[usable], truth[usable], atol=1e-5 * np.abs(truth).max())
