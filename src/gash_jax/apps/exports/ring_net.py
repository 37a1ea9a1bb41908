"""`rings` as an ONNX graph: surroundings in the frame of the vertex, the shadow as a residual to the closed form."""

from typing import Any

from gash_jax.apps.exports.directions import rotate_coefficients, unshadowed_transfer, zero_without_normal
from gash_jax.apps.exports.graph import Graph, Value
from gash_jax.apps.exports.inputs import edge_features, edge_motors, frame, neighbours, normal, vertex_inputs
from gash_jax.apps.exports.layers import dense, edge_attention, layer_norm


def write_ring_net(g: Graph, config: Any) -> Value:
    """Coefficients of every vertex."""
    table, edges = neighbours(g, config.neighbours), _edges(g, config)
    hidden = (edges @ g.weight("pooling/kernel") + g.weight("pooling/bias")).apply("Relu")
    x = dense(g, "pooling/mix", g.concat([hidden.mean(1), hidden.max(1)], 1))
    for i in range(config.layers):
        y = layer_norm(g, f"norm_{i}", x)
        x = x + dense(g, f"out_{i}", edge_attention(g, f"attention_{i}", y, edges, table, config.heads))
        y = dense(g, f"hidden_{i}", layer_norm(g, f"mlp_norm_{i}", x)).apply("Relu")
        x = x + dense(g, f"mlp_{i}", y)
    residual = dense(g, "head", layer_norm(g, "norm", x))
    world = zero_without_normal(g, rotate_coefficients(g, residual, frame(g), config.bands), normal(g))
    return unshadowed_transfer(g, normal(g), config.bands) + world


def _edges(g: Graph, config: Any) -> Value:
    count = config.neighbours
    if config.encoding in ("relative", "relative-motor"):
        return (edge_features if config.encoding == "relative" else edge_motors)(g, count)
    ends = vertex_inputs(g, config.encoding)
    senders = ends.take(neighbours(g, count))
    return g.concat([senders, g.add("Expand", ends.unsqueeze(1), senders.apply("Shape"))], 2)
