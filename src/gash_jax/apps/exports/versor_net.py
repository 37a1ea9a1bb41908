"""`versor` as an ONNX graph: `nn.versor_net` number for number, multivectors as (v, 16, c).

What follows from weights alone, the matrices of rotors and what is multiplied by the table of motors, is computed here.
"""

from typing import Any

import jax.numpy as jnp
import numpy as np

from gash_jax.algebra.even import MOTOR_PAIRS, even_product_table, motor_action_table
from gash_jax.apps.exports.directions import rotate_coefficients, unshadowed_transfer, zero_without_normal
from gash_jax.apps.exports.graph import Graph, Value
from gash_jax.apps.exports.inputs import edge_motors, frame, neighbours, normal
from gash_jax.apps.exports.layers import dense
from gash_jax.nn.versor_net import SMALLEST_SQUARE, versor_kernel


def write_versor_net(g: Graph, config: Any) -> Value:
    """Coefficients of every vertex."""
    motors = edge_motors(g, config.neighbours)
    first, second = MOTOR_PAIRS
    squares = motors.take(first, 2) * motors.take(second, 2)
    x = _layer(g, "first", config, squares, None)
    for i in range(config.layers):
        x = _layer(g, f"layer_{i}", config, squares, x)
    h = dense(g, "hidden", _blades(_normalised(x)))
    residual = dense(g, "head", h * h.apply("Sigmoid"))
    world = zero_without_normal(g, rotate_coefficients(g, residual, frame(g), config.bands), normal(g))
    return unshadowed_transfer(g, normal(g), config.bands) + world


def _layer(g: Graph, name: str, config: Any, squares: Value, x: Value | None) -> Value:
    y = None if x is None else _normalised(x)
    z = _versor_linear(g, f"{name}/receive", _normalised(_motor_action(g, f"{name}/action", config, squares, y)))
    x = z if x is None else x + z
    left, right = (_versor_linear(g, f"{name}/{side}", _normalised(x)) for side in ("left", "right"))
    p = _versor_linear(g, f"{name}/product", _normalised(_product(left, right)))
    return x + p * dense(g, f"{name}/gate", _blades(p)).apply("Sigmoid").unsqueeze(1)


def _blades(x: Value) -> Value:
    return x.reshape(0, -1)


def _normalised(x: Value) -> Value:
    row = _blades(x)
    return x / ((row * row).mean(1, keep=True) + SMALLEST_SQUARE).apply("Sqrt").unsqueeze(2)


def _weights(g: Graph, name: str) -> np.ndarray:
    return np.asarray(g.weights[name], np.float32)


def _versor_linear(g: Graph, name: str, x: Value) -> Value:
    bivectors, weights = (jnp.asarray(_weights(g, f"{name}/{part}")) for part in ("bivectors", "weights"))
    rows = _blades(x) @ np.asarray(versor_kernel(bivectors, weights))
    return rows.reshape(0, 16, weights.shape[1]) + g.weight(f"{name}/bias")


def _motor_action(g: Graph, name: str, config: Any, squares: Value, y: Value | None) -> Value:
    channels, own = config.channels, g.weight(f"{name}/bias")
    if y is not None:
        own = own + dense(g, f"{name}/own", _blades(y), bias=False).unsqueeze(1)
    logits = squares @ g.weight(f"{name}/key") + own
    values = None
    if y is not None:
        sent = dense(g, f"{name}/sent", _blades(y), bias=False).take(neighbours(g, config.neighbours))
        logits = logits + sent.take(np.arange(channels), 2)
        values = 1.0 + sent.take(np.arange(channels, 2 * channels), 2)
    weights = logits.apply("Sigmoid") / float(config.neighbours)
    weights = weights if values is None else weights * values
    summed = weights.transpose(0, 2, 1) @ squares  # (v, c, 36)
    acted = np.einsum("qij,jc->cqi", motor_action_table(), _weights(g, f"{name}/still"))
    return (summed.unsqueeze(2) @ acted).reshape(0, channels, 16).transpose(0, 2, 1)


def _product(a: Value, b: Value) -> Value:
    pairs = a.transpose(0, 2, 1).unsqueeze(3) * b.transpose(0, 2, 1).unsqueeze(2)  # (v, c, 16, 16)
    return (pairs.reshape(0, 0, 256) @ even_product_table().reshape(256, 16)).transpose(0, 2, 1)
