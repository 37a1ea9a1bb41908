"""The ring network turns with the mesh, starts as the closed form, and sees neither unit nor origin."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph.mesh_graph import edgeless_graph, rings_graph, with_relative_edges
from gash_jax.nn.ring_net import RingNet
from tests.helpers.bumpy import bumpy_mesh, random_rotation, random_variables

BUMPY: Mesh = bumpy_mesh(200)


@cache
def _net(bands: int = 3) -> tuple[Any, Any]:
    module = RingNet(channels=16, layers=2, heads=2, bands=bands)
    return jax.jit(module.apply), random_variables(module, rings_graph(BUMPY))


def _same_table(mesh: Mesh, graph: Any) -> Any:
    """The graph of another mesh with the edges of this one."""
    bare = edgeless_graph(mesh)
    return with_relative_edges(bare._replace(senders=graph.senders, receivers=graph.receivers), mesh)


def test_untrained_it_is_the_unshadowed_transfer() -> None:
    module, graph = RingNet(channels=8, layers=1, heads=2), rings_graph(BUMPY)
    variables = jax.jit(module.init)(jax.random.key(0), graph)
    out = jax.jit(module.apply)(variables, graph)
    np.testing.assert_array_equal(out, jax.jit(unshadowed_transfer, static_argnums=1)(BUMPY.normals, 3))


@pytest.mark.parametrize("bands", [3, 4])
def test_its_prediction_turns_with_the_mesh(bands: int) -> None:
    apply, variables = _net(bands)
    rotation, graph = random_rotation(5), rings_graph(BUMPY)
    out = apply(variables, graph)
    moved = apply(variables, _same_table(transform(BUMPY, rotation, np.array([3.0, -1.0, 2.0]), 7.5), graph))
    assert float(jnp.abs(out - unshadowed_transfer(BUMPY.normals, bands)).max()) > 0.1
    turned = rotate_coefficients(out, jnp.asarray(rotation, jnp.float32)[None])
    np.testing.assert_allclose(moved, turned, atol=1e-4)


def test_it_reads_nothing_but_relative_edges_frames_and_normals() -> None:
    apply, variables = _net()
    graph: Any = rings_graph(BUMPY)
    changed = {"motor": 5 * graph.nodes["motor"] + 1, "position": graph.nodes["position"] - 3}
    other = graph._replace(nodes={**graph.nodes, **changed}, globals={k: 2 * v for k, v in graph.globals.items()})
    np.testing.assert_array_equal(apply(variables, other), apply(variables, graph))


def test_the_order_of_neighbours_does_not_matter() -> None:
    apply, variables = _net()
    graph: Any = rings_graph(BUMPY)
    order = np.random.default_rng(0).permuted(np.tile(np.arange(32), (200, 1)), axis=1)
    index = (order + 32 * np.arange(200)[:, None]).ravel()
    shuffled = graph._replace(senders=graph.senders[index], edges={"relative": graph.edges["relative"][index]})
    np.testing.assert_allclose(apply(variables, shuffled), apply(variables, graph), atol=1e-5)


def test_its_reach_is_the_number_of_layers() -> None:
    """A change of one edge is felt at its receiver, and from there along edges, once per layer."""
    apply, variables = _net()
    graph: Any = rings_graph(BUMPY)
    relative = graph.edges["relative"].copy()
    relative[32 * 11] += 0.3
    changed = np.any(
        np.asarray(apply(variables, graph._replace(edges={"relative": relative})) != apply(variables, graph)), axis=1
    )
    reached = np.arange(200) == 11
    for _ in range(2):
        reached = reached | reached[graph.senders].reshape(200, 32).any(axis=1)
    assert changed[11] and changed.sum() > 1
    assert not np.any(changed & ~reached)


def test_blocks_change_nothing() -> None:
    _, variables = _net()
    graph = rings_graph(BUMPY)
    whole = RingNet(channels=16, layers=2, heads=2)
    out = jax.jit(whole.clone(block=64).apply)(variables, graph)
    np.testing.assert_allclose(out, _net()[0](variables, graph), atol=1e-5)
    assert "scan" not in str(jax.make_jaxpr(lambda v: whole.clone(block=64).apply(v, graph, False))(variables))
