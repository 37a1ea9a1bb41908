"""`mlp`, `gnn`, `teacher` and `two-stage` as ONNX graphs: what each vertex says, and how it becomes transfer.

Inputs are what the config asks for: "motor" or what stands in its place, "neighbours", "visibility", and "normal".
"""

from typing import Any

from gash_jax.apps.exports.directions import (
    rotate_coefficients,
    rotor_matrices,
    unshadowed_transfer,
    zero_without_normal,
)
from gash_jax.apps.exports.graph import Graph, Value
from gash_jax.apps.exports.inputs import edge_motors, motor, neighbours, normal, vertex_inputs, visibility
from gash_jax.apps.exports.layers import dense, gatv2_conv, layer_norm, transformer_conv


def write_mlp(g: Graph, config: Any) -> Value:
    """Every vertex by itself."""
    x = vertex_inputs(g, config.encoding)
    for i in range(config.layers):
        x = dense(g, f"dense_{i}", x).apply("Relu")
    return _world(g, config, dense(g, "head", x))


def write_gnn(g: Graph, config: Any) -> Value:
    """The single-stage network."""
    return _world(g, config, _coefficients(g, config, "", vertex_inputs(g, config.encoding)))


def write_teacher(g: Graph, config: Any) -> Value:
    """The network that is told traced visibilities."""
    inputs = g.concat([vertex_inputs(g, config.encoding), visibility(g, config.visibility_directions)], 1)
    return _world(g, config, _coefficients(g, config, "", inputs))


def write_two_stage(g: Graph, config: Any) -> Value:
    """Visibilities first, coefficients from them."""
    own, table = vertex_inputs(g, config.encoding), neighbours(g, config.neighbours)
    x = dense(g, "visibility/embed", own)
    for i in range(config.visibility_layers):
        y = transformer_conv(g, f"visibility/conv_{i}", x, table, config.heads)
        x = x + layer_norm(g, f"visibility/norm_{i}", y).apply("Relu")
    seen = dense(g, "visibility/head", x).apply("Sigmoid")
    return _world(g, config, _coefficients(g, config, "coefficient/", g.concat([own, seen], 1)))


def _coefficients(g: Graph, config: Any, room: str, inputs: Value) -> Value:
    table = neighbours(g, config.neighbours)
    motors = edge_motors(g, config.neighbours) if config.encoding == "relative-motor" else None
    x = dense(g, f"{room}embed", inputs)
    for i in range(config.layers):
        x = x + gatv2_conv(g, f"{room}conv_{i}", x, table, config.heads, motors).apply("Relu")
    return dense(g, f"{room}head", x)


def _world(g: Graph, config: Any, said: Value) -> Value:
    """Section Output of docs/model_file.md."""
    if config.frame == "vertex":
        said = rotate_coefficients(g, said, rotor_matrices(g, motor(g)), config.bands)
    if config.residual:
        said = unshadowed_transfer(g, normal(g), config.bands) + said
    return zero_without_normal(g, said, normal(g))
