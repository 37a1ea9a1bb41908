"""Encodings of vertices: by hand, nothing lost in the shorter ones, through jit."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from gash_jax.algebra.motors import motor
from gash_jax.graph.mesh_graph import edgeless_graph
from gash_jax.nn.inputs import MOTOR_7, vertex_inputs
from tests.helpers.bumpy import bumpy_mesh

GRAPH: Any = edgeless_graph(bumpy_mesh(50))


def test_motor_7_is_the_motor_without_zeros_and_repetitions() -> None:
    motor, short = GRAPH.nodes["motor"], np.asarray(vertex_inputs(GRAPH, "motor-7"))
    np.testing.assert_array_equal(vertex_inputs(GRAPH, "motor"), motor)
    assert short.shape == (50, 7) and (np.abs(short).max(0) > 0.01).all()
    rebuilt = np.zeros_like(motor)
    rebuilt[:, MOTOR_7] = short
    # e_inf = e+ + e-: the e- blade of a part follows its e+ blade by 8
    rebuilt[:, MOTOR_7[3:] + 8] = short[:, 3:]
    np.testing.assert_array_equal(rebuilt, motor)


def test_by_hand() -> None:
    # n = +x: h = (1, 1, 0) / sqrt 2, R = h_y + h_x e12; d = (0, -p / 2) R with p = (0, 2, 0)
    half = np.sqrt(0.5)
    nodes = {
        "motor": np.asarray(motor(jnp.array([[0.0, 2.0, 0.0]]), jnp.array([[1.0, 0.0, 0.0]]))),
        "position": np.array([[0.0, 2.0, 0.0]]),
        "normal": np.array([[1.0, 0.0, 0.0]]),
    }
    graph = GRAPH._replace(nodes=nodes)
    np.testing.assert_allclose(vertex_inputs(graph, "position-normal"), [[0, 2, 0, 1, 0, 0]])
    np.testing.assert_allclose(vertex_inputs(graph, "relative-motor"), [[half, half, 0]], atol=1e-6)
    # quaternion (w, i, j, k) = (half, 0, 0, -half); (0, 0, -1, 0) times it = (0, half, -half, 0)
    np.testing.assert_allclose(vertex_inputs(graph, "motor-7"), [[half, half, 0, half, -half, 0, 0]], atol=1e-6)


def test_under_jit_and_vmap() -> None:
    both: Any = jax.tree.map(lambda leaf: np.stack([leaf, leaf]), GRAPH)
    for encoding in ("motor", "motor-7", "position-normal", "relative-motor"):
        plain = vertex_inputs(GRAPH, encoding)
        np.testing.assert_array_equal(jax.jit(vertex_inputs, static_argnums=1)(GRAPH, encoding), plain)
        np.testing.assert_array_equal(jax.vmap(lambda g, e=encoding: vertex_inputs(g, e))(both)[1], plain)
