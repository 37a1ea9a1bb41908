"""`versor` turns with the mesh, starts as the closed form, and its layers do by hand what versors do."""

from functools import cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gash_jax.algebra import cga
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.even import BIVECTORS, EVEN, MOTOR_8, motor_squares
from gash_jax.algebra.motors import matrix_to_rotor
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph.mesh_graph import edgeless_graph, with_frames, with_relative_motors
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.nn.versor_net import MotorAction, VersorLinear
from tests.helpers.bumpy import bumpy_mesh, random_rotation, random_variables

BUMPY: Mesh = bumpy_mesh(200)
CONFIG: Any = model_config("versor", channels=4, layers=1)
PLACE = {int(blade): place for place, blade in enumerate(EVEN)}


@cache
def _net() -> tuple[Any, Any, Any]:
    module, graph = build_model(CONFIG), model_graph(CONFIG, BUMPY)
    return jax.jit(module.apply), random_variables(module, graph), graph


def _same_table(mesh: Mesh, graph: Any) -> Any:
    """The graph of another mesh with the edges of this one."""
    bare = edgeless_graph(mesh)._replace(senders=graph.senders, receivers=graph.receivers)
    return with_relative_motors(with_frames(bare), mesh)


def test_untrained_it_is_the_unshadowed_transfer() -> None:
    module, graph = build_model(CONFIG), _net()[2]
    out = jax.jit(module.apply)(jax.jit(module.init)(jax.random.key(0), graph), graph)
    np.testing.assert_array_equal(out, jax.jit(unshadowed_transfer, static_argnums=1)(BUMPY.normals, 3))


def test_its_prediction_turns_with_the_mesh() -> None:
    apply, variables, graph = _net()
    out, rotation = apply(variables, graph), random_rotation(5)
    moved = apply(variables, _same_table(transform(BUMPY, rotation, np.array([3.0, -1.0, 2.0]), 7.5), graph))
    assert float(jnp.abs(out - unshadowed_transfer(BUMPY.normals, 3)).max()) > 0.1
    turned = rotate_coefficients(out, jnp.asarray(rotation, jnp.float32)[None])
    np.testing.assert_allclose(moved, turned, atol=2e-4)


def test_it_reads_nothing_but_motors_of_edges_frames_and_normals() -> None:
    apply, variables, graph = _net()
    changed = {"motor": 5 * graph.nodes["motor"] + 1, "position": graph.nodes["position"] - 3}
    other = graph._replace(nodes={**graph.nodes, **changed}, globals={k: 2 * v for k, v in graph.globals.items()})
    np.testing.assert_array_equal(apply(variables, other), apply(variables, graph))
    motors = graph.edges["motor"].copy()
    motors[:, -1] += 0.1
    assert np.abs(apply(variables, graph._replace(edges={"motor": motors})) - apply(variables, graph)).max() > 1e-3


def test_both_signs_of_a_motor_are_one_motion() -> None:
    apply, variables, graph = _net()
    signs = np.random.default_rng(0).choice([-1, 1], (len(graph.senders), 1)).astype(np.float32)
    flipped = graph._replace(edges={"motor": signs * graph.edges["motor"]})
    np.testing.assert_array_equal(apply(variables, flipped), apply(variables, graph))


def test_the_order_of_neighbours_does_not_matter() -> None:
    apply, variables, graph = _net()
    order = np.random.default_rng(0).permuted(np.tile(np.arange(32), (200, 1)), axis=1)
    index = (order + 32 * np.arange(200)[:, None]).ravel()
    shuffled = graph._replace(senders=graph.senders[index], edges={"motor": graph.edges["motor"][index]})
    np.testing.assert_allclose(apply(variables, shuffled), apply(variables, graph), atol=1e-4)


def test_its_reach_is_the_number_of_layers() -> None:
    """A change of one edge is felt at its receiver, and from there along edges, once per layer."""
    apply, variables, graph = _net()
    motors = graph.edges["motor"].copy()
    motors[32 * 11] += 0.3
    other = graph._replace(edges={"motor": motors})
    changed = np.any(np.asarray(apply(variables, other) != apply(variables, graph)), axis=1)
    reached = np.arange(200) == 11
    reached = reached | reached[graph.senders].reshape(200, 32).any(axis=1)
    assert changed[11] and changed.sum() > 1 and not np.any(changed & ~reached)


def test_blocks_change_nothing() -> None:
    apply, variables, graph = _net()
    module: Any = build_model(CONFIG)
    whole = jax.jit(module.clone(block=None).apply)(variables, graph)
    np.testing.assert_allclose(apply(variables, graph), whole, atol=1e-5)
    assert "scan" in str(jax.make_jaxpr(lambda v: module.apply(v, graph))(variables))
    assert "scan" not in str(jax.make_jaxpr(lambda v: module.apply(v, graph, False))(variables))


def test_a_layer_of_versors_by_hand() -> None:
    """exp(-pi/4 e12) turns e1 I = e23+- to e2 I = -e13+-; times its weight 2, with the bias 0.5 on the scalar."""
    bivectors = np.zeros((1, 1, 10), np.float32)
    bivectors[..., BIVECTORS.tolist().index(PLACE[cga.E12])] = -np.pi / 2
    bias = np.zeros((16, 1), np.float32)
    bias[PLACE[cga.SCALAR]] = 0.5
    params = {"bivectors": bivectors, "weights": np.full((1, 1), 2.0, np.float32), "bias": bias}
    both = cga.EP | cga.EM
    x = jnp.zeros((1, 16, 1)).at[0, PLACE[cga.E23 | both], 0].set(1.0)
    expected = np.zeros((1, 16, 1))
    expected[0, PLACE[cga.E13 | both]], expected[0, PLACE[cga.SCALAR]] = -2.0, 0.5
    found: Any = VersorLinear(1).apply({"params": params}, x)
    np.testing.assert_allclose(found, expected, atol=5e-6)


def test_motors_act_by_hand() -> None:
    """Two neighbours, one that is turned by a quarter about z, one that is not: half of what each makes of e1 I, as the
    gate is 1/2 without weights, and half of their sum."""
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]], np.float32)
    motors = jnp.stack([matrix_to_rotor(turn), matrix_to_rotor(np.eye(3, dtype=np.float32))])[None][..., MOTOR_8]
    both = cga.EP | cga.EM
    still = np.zeros((16, 1), np.float32)
    still[PLACE[cga.E23 | both]] = 1.0
    params = {"still": still, "key": np.zeros((36, 1), np.float32), "bias": np.zeros(1, np.float32)}
    table = jnp.zeros((1, 2), jnp.int32)
    found: Any = MotorAction(1).apply({"params": params}, motors, motor_squares(motors), table, None)
    expected = np.zeros((1, 16, 1))
    expected[0, PLACE[cga.E23 | both]], expected[0, PLACE[cga.E13 | both]] = 0.25, -0.25
    np.testing.assert_allclose(found, expected, atol=5e-6)
