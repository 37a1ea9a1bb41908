"""The local network turns with the mesh, is the closed form on convex bodies, and knows when it had better be."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph.surfel_graph import SurfelGraph, block_arrays, normalised, plan_surfels, surfel_graph
from gash_jax.graph.surfels import surfel_records
from gash_jax.nn.surfel_net import SurfelNet, by_band, fall_back
from gash_jax.shapes.primitives import icosphere
from tests.helpers.bumpy import bumpy_mesh, random_rotation, random_variables

COUNT = 24
BUMPY: Mesh = bumpy_mesh(200)


@cache
def _graph() -> SurfelGraph:
    return surfel_graph(BUMPY, COUNT)


def _normals(graph: SurfelGraph) -> np.ndarray:
    return graph.blocks["normal"].reshape(-1, 3)


@cache
def _net(bands: int = 3) -> tuple[Any, Any]:
    module = SurfelNet(channels=8, layers=1, bands=bands)
    return jax.jit(module.apply), random_variables(module, _graph().blocks, spread=0.1)


def _by_vertex(graph: SurfelGraph, output: Any) -> np.ndarray:
    return np.asarray(output)[graph.slot]


def _turned(output: Any, bands: int, rotation: np.ndarray) -> np.ndarray:
    """What is expected of the turned mesh: coefficients turned, errors as they were."""
    matrix = jnp.asarray(rotation, jnp.float32)[None]
    return np.concatenate([rotate_coefficients(output[:, : bands**2], matrix), output[:, bands**2 :]], axis=1)


def test_untrained_it_is_the_unshadowed_transfer() -> None:
    """Whatever its other weights are: the head starts at zero."""
    (apply, variables), graph = _net(), _graph()
    module = SurfelNet(channels=8, layers=1)
    head = jax.jit(lambda key: module.init(key, graph.blocks)["params"]["head"])(jax.random.key(0))
    out = apply({"params": {**variables["params"], "head": head}}, graph.blocks)
    np.testing.assert_allclose(out[:, :9], unshadowed_transfer(_normals(graph), 3), atol=1e-7)


@pytest.mark.parametrize("bands", [3, 4])
def test_with_the_same_plan_its_prediction_turns_with_the_mesh(bands: int) -> None:
    apply, variables = _net(bands)
    positions, _, _ = normalised(BUMPY)
    plan, _ = plan_surfels(BUMPY, positions, COUNT)
    rotation = random_rotation(5)
    moved, normals = ((a @ rotation.T).astype(np.float32) for a in (positions, BUMPY.normals))
    blocks = block_arrays(plan, surfel_records(plan.tree, moved, plan.faces), moved, normals)
    out = apply(variables, _graph().blocks)
    assert float(jnp.abs(out[:, : bands**2] - unshadowed_transfer(_normals(_graph()), bands)).max()) > 0.1
    turned = apply(variables, blocks)
    np.testing.assert_allclose(turned, _turned(out, bands, rotation), atol=1e-4)


def test_with_a_plan_of_its_own_the_moved_mesh_has_the_turned_prediction() -> None:
    apply, variables = _net()
    expected = _by_vertex(_graph(), apply(variables, _graph().blocks))
    for seed in (1, 2):
        rotation = random_rotation(seed)
        graph = surfel_graph(transform(BUMPY, rotation, np.array([3.0, -1.0, 2.0]), 7.5), COUNT)
        difference = _by_vertex(graph, apply(variables, graph.blocks)) - _turned(expected, 3, rotation)
        assert np.sqrt(np.mean(difference**2)) < 5e-3


def test_on_a_convex_body_any_weights_give_the_unshadowed_transfer() -> None:
    apply, variables = _net()
    graph = surfel_graph(icosphere(2), COUNT)
    # it does look at surfels, and none stands above a tangent plane
    assert np.count_nonzero(graph.blocks["surfel"][..., 6]) > 0
    out = apply(variables, graph.blocks)
    np.testing.assert_allclose(out[:, :9], unshadowed_transfer(_normals(graph), 3), atol=1e-4)


def test_order_within_a_list_does_not_matter() -> None:
    apply, variables = _net()
    graph = _graph()
    surfels = graph.blocks["surfel"].copy()
    surfels[:, -4:] = 0
    rng = np.random.default_rng(0)
    order = rng.permuted(np.tile(np.arange(COUNT), (len(surfels), 1)), axis=1)
    shuffled = np.take_along_axis(surfels, order[..., None], axis=1)
    first, second = (apply(variables, {**graph.blocks, "surfel": s}) for s in (surfels, shuffled))
    np.testing.assert_allclose(first, second, atol=1e-5)
    assert float(jnp.abs(first - apply(variables, graph.blocks)).max()) > 1e-4


def test_a_vertex_without_normal_gets_nothing() -> None:
    apply, variables = _net()
    normals = _graph().blocks["normal"].copy()
    normals.reshape(-1, 3)[[0, 17]] = 0
    out = apply(variables, {**_graph().blocks, "normal": normals})
    np.testing.assert_array_equal(out[np.array([0, 17])], 0)
    assert np.isfinite(out).all() and np.all(np.any(np.delete(out, [0, 17], axis=0) != 0, axis=1))


def test_expected_errors_are_positive_and_finite() -> None:
    apply, variables = _net()
    out = apply(variables, _graph().blocks)
    assert out.shape == (len(_normals(_graph())), 12)
    assert np.isfinite(out).all() and np.all(out[:, 9:] > 0)


def test_gradients_are_finite_also_where_points_coincide_and_lists_are_empty() -> None:
    module = SurfelNet(channels=8, layers=1)
    variables, blocks = _net()[1], {name: array.copy() for name, array in _graph().blocks.items()}
    surfels, near = blocks["surfel"], blocks["near"].reshape(-1, 8, 6)
    # a surfel of no extent at the vertex; corners there too; lists with little or nothing in them; no normal
    surfels[0, 3, :3], surfels[0, 3, 7:] = blocks["position"][0, 0], 0
    near[0, :, :3], near[1, 2] = 0, 0
    surfels[1, 5:], surfels[2] = 0, 0
    blocks["normal"].reshape(-1, 3)[40] = 0

    def loss(weights: Any, blocks: Any) -> jax.Array:
        return jnp.mean(jnp.square(module.apply(weights, blocks)))  # type: ignore[arg-type]

    gradients = jax.jit(jax.grad(loss, argnums=(0, 1)))(variables, blocks)
    for path, leaf in jax.tree_util.tree_leaves_with_path(gradients):
        assert np.isfinite(leaf).all(), path
    assert float(jnp.abs(gradients[1]["position"]).max()) > 0


def test_jit_changes_nothing() -> None:
    apply, variables = _net()
    module = SurfelNet(channels=8, layers=1)
    eager: Any = module.apply(variables, _graph().blocks)
    np.testing.assert_allclose(eager, apply(variables, _graph().blocks), atol=1e-5)


def test_fallback_by_hand() -> None:
    normals = jnp.asarray([[0.0, 0.6, 0.8]])
    exact = unshadowed_transfer(normals, 2)
    # band 0: four times the square error of the closed form, a quarter of the trust; band 1: less, full trust
    own, formula = jnp.log(jnp.asarray([[4.0, 0.01]])), jnp.log(jnp.asarray([[1.0, 1.0]]))
    said = [exact + jnp.asarray([[1.0, 1, 2, 3]]), exact, own, formula]
    out = fall_back(jnp.concatenate(said, axis=1), normals, 2)
    np.testing.assert_allclose(out[:, :4], exact + jnp.asarray([[0.25, 1, 2, 3]]), atol=1e-6)
    np.testing.assert_allclose(out[:, 4:], [[np.sqrt(4 / 16 + 9 / 16), 0.1]], atol=1e-6)


def test_bands_by_hand() -> None:
    expected = [[1, 2, 2, 2, 3, 3, 3, 3, 3], [4, 5, 5, 5, 6, 6, 6, 6, 6]]
    np.testing.assert_array_equal(by_band(jnp.asarray([[1.0, 2, 3], [4, 5, 6]]), 3), expected)
