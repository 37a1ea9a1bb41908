"""What holds for every model: order, padding, zero normals, transforms, and that it can learn at all."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import jraph
import numpy as np
import optax
import pytest

from gash_jax.graph.batching import batch_graphs, pad_graph
from gash_jax.graph.mesh_graph import build_graph, with_relative_edges
from gash_jax.models.families import build_model, model_config, model_graph
from tests.helpers.bumpy import bumpy_mesh, random_variables

NAMES = ("mlp", "two-stage", "rings", "versor")
SMALL = {
    "mlp": model_config("mlp", channels=64, layers=2),
    "two-stage": model_config(
        "two-stage", channels=16, layers=1, heads=2, neighbours=6, visibility_channels=16, visibility_layers=1
    ),
    "rings": model_config("rings", channels=16, layers=1, heads=2),
    "versor": model_config("versor", channels=4, layers=1),
}


def _graph(name: str, count: int = 40, seed: int = 0) -> Any:
    """A graph of a mesh with one vertex that has no normal."""
    mesh = bumpy_mesh(count, seed)
    mesh.normals[7] = 0
    return model_graph(SMALL[name], mesh)


@cache
def _model(name: str) -> tuple[Any, Any, Any]:
    """Module, jitted apply and variables that are random in every layer."""
    module = build_model(SMALL[name])
    return module, jax.jit(module.apply), random_variables(module, _graph(name))


@pytest.mark.parametrize("name", NAMES)
def test_jit_is_eager_and_one_row_per_vertex(name: str) -> None:
    module, apply, variables = _model(name)
    out = apply(variables, _graph(name))
    assert out.shape == (40, 9) and out.dtype == jnp.float32
    np.testing.assert_allclose(module.apply(variables, _graph(name)), out, atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_a_vertex_without_normal_gets_exactly_zero(name: str) -> None:
    _, apply, variables = _model(name)
    zero = np.flatnonzero(~np.any(np.asarray(apply(variables, _graph(name))), axis=1))
    np.testing.assert_array_equal(zero, [7])


@pytest.mark.parametrize("name", NAMES)
def test_renaming_vertices_renames_the_result(name: str) -> None:
    _, apply, variables = _model(name)
    graph = _graph(name)
    order = np.random.default_rng(0).permutation(40)
    table = graph.senders.reshape(40, -1)
    edges = {key: leaf.reshape(40, -1, leaf.shape[1])[order].reshape(leaf.shape) for key, leaf in graph.edges.items()}
    nodes = {key: leaf[order] for key, leaf in graph.nodes.items()}
    senders = np.argsort(order)[table[order]].reshape(-1).astype(np.int32)
    renamed = graph._replace(nodes=nodes, edges=edges, senders=senders)
    np.testing.assert_allclose(apply(variables, renamed), apply(variables, graph)[order], atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_padding_and_company_change_nothing(name: str) -> None:
    _, apply, variables = _model(name)
    graph, other = _graph(name), _graph(name, 30, 1)
    batched = apply(variables, batch_graphs([other, graph], (64, 80)))
    assert batched.shape == (80, 9) and np.isfinite(batched).all()
    np.testing.assert_allclose(batched[30:70], apply(variables, graph), atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_overfits_one_tiny_problem_with_finite_gradients(name: str) -> None:
    module, graph = build_model(SMALL[name]), pad_graph(_graph(name), 48)
    variables = random_variables(module, graph, spread=0.15)
    target = np.random.default_rng(3).normal(0, 0.3, (48, 9)).astype(np.float32)
    target[[7, *range(40, 48)]] = 0
    optimiser = optax.adam(2e-2)

    def loss(params: Any, nodes: Any, edges: Any) -> jax.Array:
        out: Any = module.apply(params, graph._replace(nodes=nodes, edges=edges))
        return jnp.mean((out - target) ** 2)

    @jax.jit
    def train(params: Any) -> tuple[jax.Array, Any]:
        def step(state: Any, _: None) -> tuple[Any, Any]:
            value, gradients = jax.value_and_grad(loss, argnums=(0, 1, 2))(state[0], graph.nodes, graph.edges)
            updates, moments = optimiser.update(gradients[0], state[1])
            sizes = jax.tree.map(lambda leaf: jnp.max(jnp.abs(leaf)), gradients)
            return (optax.apply_updates(state[0], updates), moments), (value, sizes)

        return jax.lax.scan(step, (params, optimiser.init(params)), None, 400)[1]

    values, sizes = train(variables)
    assert all(np.isfinite(size).all() for size in jax.tree.leaves(sizes))
    assert all(size[0] > 0 for size in jax.tree.leaves(sizes[0])), "a weight without influence"
    # at this rate the loss jumps up now and then for a few steps
    assert np.median(values[-20:]) < 0.1 * np.mean(target**2)


@pytest.mark.parametrize("name", ["two-stage", "rings", "versor"])
def test_a_graph_with_another_number_of_neighbours_is_refused(name: str) -> None:
    _, apply, variables = _model(name)
    graph = with_relative_edges(build_graph(bumpy_mesh(40), "knn", 5), bumpy_mesh(40))
    with pytest.raises(ValueError, match="neighbours"):
        apply(variables, graph)


def test_graphs_are_jraph() -> None:
    assert all(isinstance(_graph(name), jraph.GraphsTuple) for name in NAMES)
