"""The local network turns with the mesh, whatever the order and the padding of its lists, and is continuous."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import transform
from gash_jax.graph.surfel_graph import normalised, part_arrays, plan_surfels, surfel_graph
from gash_jax.graph.surfels import FAN, surfel_records
from gash_jax.nn.surfel_net import SurfelNet
from gash_jax.nn.surfel_pairs import look
from tests.helpers.bumpy import random_rotation, surfel_parts
from tests.helpers.surfel_nets import (
    BUMPY,
    SMALL_SURFELS,
    bumpy_graph,
    bumpy_parts,
    filled_parts,
    joined_part,
    normals_of,
    surfel_apply,
    surfel_variables,
)

# what is asked for: bands and bounces
ASKED = [(3, 0), (6, 2)]


def _turned(output: Any, bands: int, bounces: int, rotation: np.ndarray) -> np.ndarray:
    """What is expected of the turned mesh: coefficients of every bounce turned, errors as they were."""
    matrix, k = jnp.asarray(rotation, jnp.float32)[None], bands**2
    turned = [rotate_coefficients(output[:, i * k : (i + 1) * k], matrix) for i in range(bounces + 1)]
    return np.concatenate([*turned, output[:, (bounces + 1) * k :]], axis=1)


def test_untrained_it_is_the_unshadowed_transfer() -> None:
    """Whatever its other weights are: the heads start at zero, so no bounce adds anything."""
    module = SurfelNet(**SMALL_SURFELS)
    fresh = jax.jit(lambda key: module.init(key, bumpy_parts())["params"])(jax.random.key(0))
    heads = {name: fresh[name] for name in ("head", "further_head")}
    out = surfel_apply(6, 2)({"params": {**surfel_variables()["params"], **heads}}, bumpy_parts())
    np.testing.assert_allclose(out[:, :36], unshadowed_transfer(normals_of(bumpy_parts()), 6), atol=1e-6)
    np.testing.assert_array_equal(out[:, 36:108], 0)
    assert np.abs(surfel_apply(6, 2)(surfel_variables(), bumpy_parts())[:, 36:108]).max() > 0.1


@pytest.mark.parametrize(("bands", "bounces"), ASKED)
def test_with_the_same_plan_its_prediction_turns_with_the_mesh(bands: int, bounces: int) -> None:
    apply, variables = surfel_apply(bands, bounces), surfel_variables()
    positions, _, _ = normalised(BUMPY)
    plan, _ = plan_surfels(BUMPY, positions)
    rotation = random_rotation(5)
    moved, normals = ((a @ rotation.T).astype(np.float32) for a in (positions, BUMPY.normals))
    graph = bumpy_graph()._replace(
        records=surfel_records(plan.tree, moved, plan.faces), parts=part_arrays(plan, moved, normals)
    )
    out = apply(variables, bumpy_parts())
    assert float(jnp.abs(out[:, : bands**2] - unshadowed_transfer(normals_of(bumpy_parts()), bands)).max()) > 0.1
    turned = apply(variables, filled_parts(graph))
    np.testing.assert_allclose(turned, _turned(out, bands, bounces, rotation), atol=3e-4)


def test_with_a_plan_of_its_own_the_moved_mesh_has_the_turned_prediction() -> None:
    apply, variables = surfel_apply(), surfel_variables()
    expected = np.asarray(apply(variables, bumpy_parts()))[bumpy_graph().slot]
    for seed in (1, 2):
        rotation = random_rotation(seed)
        graph = surfel_graph(transform(BUMPY, rotation, np.array([3.0, -1.0, 2.0]), 7.5))
        found = np.asarray(apply(variables, filled_parts(graph)))[graph.slot]
        difference = found - _turned(expected, 3, 0, rotation)
        assert np.sqrt(np.mean(difference**2)) < 5e-3


def test_order_and_padding_of_lists_do_not_matter() -> None:
    apply, part = surfel_apply(), bumpy_parts()[0]
    count, width = part["weight"].shape
    rng = np.random.default_rng(0)
    order = rng.permuted(np.tile(np.arange(width), (count, 1)), axis=1)
    shuffled = {**part, "surfel": np.take_along_axis(part["surfel"], order[..., None], axis=1)}
    shuffled["weight"] = np.take_along_axis(part["weight"], order, axis=1)
    # what fills a list may be any surfel, as its weight is 0
    filler = np.repeat(part["surfel"][:1, :9], count, axis=0)
    padded = {**part, "surfel": np.concatenate([part["surfel"], filler], axis=1)}
    padded["weight"] = np.concatenate([part["weight"], np.zeros((count, 9), np.float32)], axis=1)
    first = apply(surfel_variables(), (part,))
    for other in (shuffled, padded):
        np.testing.assert_allclose(apply(surfel_variables(), (other,)), first, atol=2e-5)
    # the weights of others do
    wrong = {**shuffled, "weight": part["weight"]}
    assert float(jnp.abs(first - apply(surfel_variables(), (wrong,))).max()) > 1e-3


def test_parts_may_be_put_together_in_any_way() -> None:
    """No vertex knows of another: all together in lists of one width, or apart by width, half of them at a time."""
    whole, start, expected = np.asarray(surfel_apply()(surfel_variables(), bumpy_parts())), 0, []
    parts = [part for part in surfel_parts(bumpy_graph()) if len(part["normal"])]
    assert len(parts) > 1
    for part in parts:
        own = whole[start : start + len(part["normal"])]
        expected += [own[0::2], own[1::2]]
        start += len(own)
    pieces = tuple({name: a[i::2] for name, a in part.items()} for part in parts for i in (0, 1))
    found = surfel_apply()(surfel_variables(), pieces)
    np.testing.assert_allclose(found, np.concatenate(expected), atol=2e-5)


def test_while_a_surfel_gives_way_to_its_children_the_output_is_continuous() -> None:
    """From wholly there to wholly its children, over all weights in between."""
    tree = plan_surfels(BUMPY, normalised(BUMPY)[0])[0].tree
    records, (part,), table = bumpy_graph().records, bumpy_parts(), joined_part(bumpy_graph())["table"]
    child = np.append(tree.first_child, -1)
    # the surfel that hides most of what some vertex has in its list as a whole
    whole = np.where((child[table] >= 0) & (part["weight"] == 1), look(part).above, 0)
    vertex, place = np.unravel_index(np.argmax(whole), whole.shape)
    own = {name: a[vertex : vertex + 1] for name, a in part.items()}
    first = int(child[table[vertex, place]])
    opened = np.linspace(0, 1, 201, dtype=np.float32)
    many = {name: np.repeat(a, len(opened), axis=0) for name, a in own.items()}
    children = np.tile(records[first : first + FAN], (len(opened), 1, 1))
    many["surfel"] = np.concatenate([many["surfel"], children], axis=1)
    many["weight"] = np.concatenate([many["weight"], np.repeat(opened[:, None], FAN, axis=1)], axis=1)
    many["weight"][:, place] = 1 - opened
    out = np.asarray(surfel_apply()(surfel_variables(), (many,)))
    without = {name: np.delete(many[name], place, axis=1) for name in ("surfel", "weight")}
    np.testing.assert_allclose(out[-1], surfel_apply()(surfel_variables(), ({**many, **without},))[-1], atol=1e-5)
    np.testing.assert_allclose(out[0], surfel_apply()(surfel_variables(), (own,))[0], atol=1e-5)
    steps = np.abs(np.diff(out, axis=0)).max(axis=1)
    total = np.abs(out[-1] - out[0]).max()
    assert 0 < steps.max() < 0.05 * max(total, 0.01)


def test_a_vertex_without_normal_gets_nothing() -> None:
    parts = tuple({**part, "normal": part["normal"].copy()} for part in bumpy_parts())
    parts[0]["normal"][[0, 7]] = 0
    out = surfel_apply(6, 2)(surfel_variables(), parts)
    np.testing.assert_array_equal(out[np.array([0, 7])], 0)
    assert np.isfinite(out).all() and np.all(np.any(np.delete(out, [0, 7], axis=0) != 0, axis=1))


def test_gradients_are_finite_also_where_points_coincide_and_lists_are_empty() -> None:
    module = SurfelNet(**SMALL_SURFELS, bands=4, bounces=1)
    parts = [{name: array.copy() for name, array in part.items()} for part in bumpy_parts()]
    surfels, near = parts[0]["surfel"], parts[0]["near"].reshape(-1, 8, 6)
    # a surfel of no extent at the vertex; corners there too; lists with little or nothing in them; no normal
    surfels[0, 3, :3], surfels[0, 3, 7:] = parts[0]["position"][0], 0
    near[0, :, :3], near[1, 2] = 0, 0
    surfels[1, 5:], surfels[2], parts[0]["weight"][3] = 0, 0, 0
    parts[0]["normal"][4] = 0

    def loss(weights: Any, parts: Any) -> jax.Array:
        return jnp.mean(jnp.square(module.apply(weights, parts)))  # type: ignore[arg-type]

    gradients = jax.jit(jax.grad(loss, argnums=(0, 1)))(surfel_variables(), tuple(parts))
    for path, leaf in jax.tree_util.tree_leaves_with_path(gradients):
        assert np.isfinite(leaf).all(), path
    assert all(float(jnp.abs(gradients[1][0][name]).max()) > 0 for name in ("position", "weight", "surfel"))


def test_jit_and_vmap_change_nothing() -> None:
    apply, variables = surfel_apply(), surfel_variables()
    plain = apply(variables, bumpy_parts())
    eager: Any = SurfelNet(**SMALL_SURFELS).apply(variables, bumpy_parts())
    np.testing.assert_allclose(eager, plain, atol=1e-5)
    other = jax.tree.map(lambda leaf: leaf * np.float32(0.5), variables)
    both = jax.tree.map(lambda *leaves: np.stack(leaves), variables, other)
    found = jax.vmap(lambda v: apply(v, bumpy_parts()))(both)
    for one, own in zip(found, (variables, other), strict=True):
        np.testing.assert_allclose(one, apply(own, bumpy_parts()), atol=1e-5)
