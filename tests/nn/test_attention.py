"""Both attention layers: PyTorch Geometric's numbers, fixed path = segment path = blocks, masks, transforms."""

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.nn.attention import GATv2Conv, TransformerConv, neighbour_softmax, over_vertices
from tests.helpers.bumpy import random_variables

GOLDEN = dict(np.load(Path(__file__).parents[1] / "golden" / "pyg_layers.npz"))
LAYERS: dict[str, Callable[..., Any]] = {"gatv2": GATv2Conv, "transformer": TransformerConv}
NAMES = {
    "gatv2": {"lin_l": "source", "lin_r": "target"},
    "transformer": {"lin_query": "query", "lin_key": "key", "lin_value": "value", "lin_skip": "root"},
}


def _golden(case: str, layer: str, kind: str) -> dict[str, Any]:
    """Parameters (or their gradients) of PyTorch Geometric in our tree."""
    params: dict[str, Any] = {}
    for torch_name, name in NAMES[layer].items():
        weight, bias = (GOLDEN[f"{case}/{layer}/{kind}/{torch_name}.{part}"] for part in ("weight", "bias"))
        params[name] = {"kernel": weight.T, "bias": bias}
    if layer == "gatv2":
        params["attention"] = GOLDEN[f"{case}/{layer}/{kind}/att"][0]
        params["bias"] = GOLDEN[f"{case}/{layer}/{kind}/bias"]
    return params


@pytest.mark.parametrize("layer", LAYERS)
@pytest.mark.parametrize(
    ("case", "path"), [("fixed", "table"), ("fixed", "list"), ("ragged", "list"), ("ragged", "mask")]
)
def test_pytorch_geometric_gives_the_same_numbers_and_gradients(layer: str, case: str, path: str) -> None:
    value = {key: GOLDEN[f"{case}/{layer}/{key}"] for key in ("x", "edges", "out", "cotangent", "gradient/x")}
    senders, receivers = value["edges"]
    ends: tuple[Any, ...] = (senders, receivers)
    if path == "table":
        ends = (senders.reshape(len(value["x"]), -1),)
    if path == "mask":
        # the ragged graph as a table: free places point anywhere and are masked
        column = np.concatenate([np.arange(n) for n in np.bincount(receivers, minlength=len(value["x"]))])
        table, mask = np.zeros((len(value["x"]), 8), np.int32), np.zeros((len(value["x"]), 8), bool)
        table[receivers, column], mask[receivers, column] = senders, True
        ends = (table, None, mask)
    module = LAYERS[layer](4, 3)

    def loss(params: Any, x: Any) -> tuple[jax.Array, jax.Array]:
        out = module.apply({"params": params}, x, *ends)
        return jnp.sum(out * value["cotangent"]), out

    gradient = jax.jit(jax.grad(loss, argnums=(0, 1), has_aux=True))
    gradients, out = gradient(_golden(case, layer, "weight"), value["x"])
    np.testing.assert_allclose(out, value["out"], atol=1e-5)
    np.testing.assert_allclose(gradients[1], value["gradient/x"], atol=1e-5)
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), gradients[0], _golden(case, layer, "gradient")
    )


@cache
def _module(layer: str) -> tuple[Any, Any]:
    module = LAYERS[layer](4, 2)
    return module, random_variables(module, np.zeros((2, 6), np.float32), np.zeros((2, 1), np.int32))


def _problem(layer: str, seed: int, v: int = 23, k: int = 5) -> tuple[Any, Any, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(v, 6)).astype(np.float32)
    return *_module(layer), x, rng.integers(0, v, (v, k)).astype(np.int32)


@pytest.mark.parametrize("layer", LAYERS)
@pytest.mark.parametrize("block", [None, 8])
def test_table_is_list_is_blocks(layer: str, block: int | None) -> None:
    module, variables, x, table = _problem(layer, 0)
    receivers = np.repeat(np.arange(len(x), dtype=np.int32), table.shape[1])
    by_list = jax.jit(lambda x, table, mask: module.apply(variables, x, table.ravel(), receivers, mask.ravel()))
    by_table = jax.jit(lambda x, table, mask: module.clone(block=block).apply(variables, x, table, None, mask))
    for seed in range(12):
        _, _, x, table = _problem(layer, seed)
        mask = np.random.default_rng(seed).random(table.shape) >= seed / 11
        np.testing.assert_allclose(by_table(x, table, mask), by_list(x, table, mask), atol=1e-6)


@pytest.mark.parametrize("layer", LAYERS)
def test_masking_an_edge_is_leaving_it_out(layer: str) -> None:
    module, variables, x, table = _problem(layer, 1)
    receivers = np.repeat(np.arange(len(x), dtype=np.int32), table.shape[1])
    mask = np.random.default_rng(0).random(table.shape) < 0.5
    apply = jax.jit(module.apply)
    kept = apply(variables, x, table[mask], receivers[mask.ravel()])
    np.testing.assert_allclose(apply(variables, x, table, None, mask), kept, atol=1e-6)


@pytest.mark.parametrize("layer", LAYERS)
def test_an_unmasked_table_is_one_with_a_mask_of_true(layer: str) -> None:
    module, variables, x, table = _problem(layer, 0)
    apply = jax.jit(module.apply)
    out = apply(variables, x, table, None, np.ones(table.shape, bool))
    np.testing.assert_allclose(apply(variables, x, table), out, atol=1e-6)


@pytest.mark.parametrize("layer", LAYERS)
@pytest.mark.parametrize("path", ["table", "list"])
def test_a_vertex_without_edges_is_finite_and_what_the_formula_says(layer: str, path: str) -> None:
    module, variables, x, table = _problem(layer, 1)
    mask = np.ones(table.shape, bool)
    mask[3] = False
    receivers = np.repeat(np.arange(len(x), dtype=np.int32), table.shape[1])
    ends = (table, None, mask) if path == "table" else (table.ravel(), receivers, mask.ravel())
    out = jax.jit(module.apply)(variables, x, *ends)
    name = "root" if layer == "transformer" else "source"
    part = variables["params"][name]
    alone = x[3] @ part["kernel"] + part["bias"] + (variables["params"]["bias"] if layer == "gatv2" else 0)
    np.testing.assert_allclose(out[3], alone, atol=1e-6)
    gradients = jax.jit(jax.grad(lambda p, y: jnp.sum(module.apply(p, y, *ends) ** 2), argnums=(0, 1)))(variables, x)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradients))


@pytest.mark.parametrize("layer", LAYERS)
def test_large_logits_stay_finite(layer: str) -> None:
    module, variables, x, table = _problem(layer, 2)
    mask = np.arange(table.size).reshape(table.shape) % 3 > 0
    for keep in (None, mask):
        run = jax.jit(jax.value_and_grad(lambda y, keep=keep: jnp.sum(module.apply(variables, y, table, None, keep))))
        for factor in (1e-30, 1e3, 1e6):
            value, gradient = run(factor * x)
            assert np.isfinite(value) and np.isfinite(gradient).all()


@pytest.mark.parametrize("layer", LAYERS)
def test_renaming_vertices_renames_the_result(layer: str) -> None:
    module, variables, x, table = _problem(layer, 3)
    order = np.random.default_rng(0).permutation(len(x))
    renamed = np.argsort(order)[table[order]].astype(np.int32)
    apply = jax.jit(module.apply)
    out = apply(variables, x, table)
    np.testing.assert_allclose(apply(variables, x[order], renamed), out[order], atol=1e-6)
    shuffled = np.random.default_rng(1).permuted(table, axis=1)
    np.testing.assert_allclose(apply(variables, x, shuffled), out, atol=1e-6)


@pytest.mark.parametrize("layer", LAYERS)
def test_under_jit_and_vmap(layer: str) -> None:
    module, variables, x, table = _problem(layer, 4)
    out = module.apply(variables, x, table)
    np.testing.assert_allclose(jax.jit(module.apply)(variables, x, table), out, atol=1e-6)
    pair = jnp.stack([x, 2 * x])
    mapped = jax.jit(jax.vmap(lambda y: module.apply(variables, y, table)))(pair)
    for i in range(2):
        np.testing.assert_allclose(mapped[i], module.apply(variables, pair[i], table), atol=1e-5)


def test_softmax_by_hand() -> None:
    logits = jnp.log(jnp.asarray([[1.0], [2.0], [5.0]]))
    np.testing.assert_allclose(neighbour_softmax(logits, None)[:, 0], [0.125, 0.25, 0.625], atol=1e-6)
    masked = neighbour_softmax(logits, jnp.asarray([True, False, True]))
    np.testing.assert_allclose(masked[:, 0], [1 / 6, 0, 5 / 6], atol=1e-6)
    np.testing.assert_array_equal(neighbour_softmax(logits, jnp.zeros(3, bool)), jnp.zeros((3, 1)))


def test_blocks_cover_every_row_once() -> None:
    rows = jnp.arange(10.0)
    np.testing.assert_array_equal(over_vertices(lambda a, b: a + b, (rows, rows), 4), 2 * rows)
    text = str(jax.make_jaxpr(lambda r: over_vertices(jnp.sin, (r,), 4))(rows))
    assert "scan" in text
    assert "scan" not in str(jax.make_jaxpr(lambda r: over_vertices(jnp.sin, (r,), 10))(rows))
    assert "scan" not in str(jax.make_jaxpr(lambda r: over_vertices(jnp.sin, (r,), None))(rows))


@pytest.mark.parametrize("layer", LAYERS)
def test_the_fixed_path_scatters_nothing(layer: str) -> None:
    module, variables, x, table = _problem(layer, 5)
    assert "scatter" not in str(jax.make_jaxpr(module.apply)(variables, x, table))
    receivers = np.repeat(np.arange(len(x), dtype=np.int32), table.shape[1])
    assert "scatter" in str(jax.make_jaxpr(module.apply)(variables, x, table.ravel(), receivers))


def test_motors_of_edges_enter_weight_and_message_of_gatv2() -> None:
    rng = np.random.default_rng(0)
    v, k, heads, width = 6, 3, 2, 4
    x, edges = rng.normal(size=(v, 5)).astype(np.float32), rng.normal(size=(v * k, 8)).astype(np.float32)
    table = np.stack([rng.permutation(np.delete(np.arange(v), i))[:k] for i in range(v)]).astype(np.int32)
    module = GATv2Conv(width, heads)
    variables = random_variables(module, x, table, None, None, edges)
    p = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), variables["params"])
    assert p["edge"].shape == (8, heads * width)
    affine = lambda name: x @ p[name]["kernel"] + p[name]["bias"]  # noqa: E731
    source, target, expected = affine("source"), affine("target"), np.zeros((v, heads * width))
    identity = np.eye(8)[0]
    for i in range(v):
        ends = [(j, edges[i * k + n]) for n, j in enumerate(table[i])] + [(i, identity)]
        messages = np.array([source[j] + e @ p["edge"] for j, e in ends]).reshape(-1, heads, width)
        hidden = messages + target[i].reshape(heads, width)
        weights = np.exp((np.where(hidden > 0, hidden, 0.2 * hidden) * p["attention"]).sum(-1))
        expected[i] = ((weights / weights.sum(0))[..., None] * messages).sum(0).ravel() + p["bias"]
    found = jax.jit(module.apply)(variables, x, table, None, None, edges)
    np.testing.assert_allclose(found, expected, atol=1e-5)
    with pytest.raises(ValueError, match="give a table"):
        module.apply(variables, x, table.ravel(), np.repeat(np.arange(v, dtype=np.int32), k), None, edges)
