"""Layers of networks as ONNX nodes, by the names of their arrays (docs/model_file.md, section Layers).

x are states (v, c), table the senders (v, k) of every vertex; attention has h heads of w channels each.
"""

from gash_jax.apps.exports.graph import INT32, NEVER, Graph, Value
from gash_jax.nn.attention import SLOPE

VARIANCE_FLOOR = 1e-6  # Flax's


def dense(g: Graph, name: str, x: Value, bias: bool = True) -> Value:
    """x W + b."""
    product = x @ g.weight(f"{name}/kernel")
    return product + g.weight(f"{name}/bias") if bias else product


def layer_norm(g: Graph, name: str, x: Value) -> Value:
    """Over the channels; in parts, as ONNX has an operator of that name from opset 17 on only."""
    centred = x - x.mean(-1, keep=True)
    deviation = ((centred * centred).mean(-1, keep=True) + VARIANCE_FLOOR).apply("Sqrt")
    return centred / deviation * g.weight(f"{name}/scale") + g.weight(f"{name}/bias")


def leaky_relu(x: Value) -> Value:
    """x, and 0.2 x below 0."""
    return x.apply("LeakyRelu", alpha=SLOPE)


def attended(logits: Value, messages: Value, channels: int) -> Value:
    """Sum over the neighbours of messages (v, k, h, w) weighted by the softmax of logits (v, k, h): (v, channels)."""
    weights = logits.apply("Softmax", axis=1).unsqueeze(3)
    return (weights * messages).sum(1).reshape(-1, channels)


def transformer_conv(g: Graph, name: str, x: Value, table: Value, heads: int) -> Value:
    """Dot-product attention with a root projection."""
    channels = g.weights[f"{name}/query/kernel"].shape[1]
    width = channels // heads
    query, key, value = (dense(g, f"{name}/{n}", x).reshape(-1, heads, width) for n in ("query", "key", "value"))
    logits = (query.unsqueeze(1) * key.take(table)).sum(3) * (1 / width**0.5)
    return attended(logits, value.take(table), channels) + dense(g, f"{name}/root", x)


def vertex_numbers(x: Value) -> Value:
    """0, 1, 2 ... as a column (v, 1), int32: the row that every state stands in."""
    count = x.apply("Shape").take(0)
    numbers = x.graph.add("Range", 0, count, 1)
    return numbers.reshape(-1, 1).apply("Cast", to=INT32)


def gatv2_conv(g: Graph, name: str, x: Value, table: Value, heads: int, motors: Value | None) -> Value:
    """Attention through a nonlinearity: loops do not count, one is added. `motors`: of the edges (v, k, 8)."""
    attention = g.weight(f"{name}/attention")
    channels = g.weights[f"{name}/source/kernel"].shape[1]
    width = channels // heads
    source, target = (dense(g, f"{name}/{n}", x).reshape(-1, heads, width) for n in ("source", "target"))
    messages, own, target = source.take(table), source.unsqueeze(1), target.unsqueeze(1)
    if motors is not None:
        edge = g.weight(f"{name}/edge")
        messages = messages + (motors @ edge).reshape(0, 0, heads, width)
        own = own + edge.take(0).reshape(heads, width)  # the added edge moves nothing: its motor is 1
    loop = g.add("Equal", table, vertex_numbers(x)).unsqueeze(2)
    logits = [(leaky_relu(target + m) * attention).sum(3) for m in (messages, own)]
    logits[0] = g.where(loop, NEVER, logits[0])
    both = g.concat([messages, own], 1)
    return attended(g.concat(logits, 1), both, channels) + g.weight(f"{name}/bias")


def edge_attention(g: Graph, name: str, x: Value, edges: Value, table: Value, heads: int) -> Value:
    """Edge, sender and receiver meet under the nonlinearity; the message is the hidden vector of the edge."""
    channels = g.weights[f"{name}/edge"].shape[1]
    source, target = dense(g, f"{name}/source", x, bias=False), dense(g, f"{name}/target", x)
    hidden = leaky_relu(edges @ g.weight(f"{name}/edge") + source.take(table) + target.unsqueeze(1))
    messages = hidden.reshape(0, 0, heads, channels // heads)
    return attended(hidden @ g.weight(f"{name}/attention"), messages, channels)
