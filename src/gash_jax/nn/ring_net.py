"""A small network that sees each vertex's surroundings from the vertex's own frame, and predicts only the shadow.

What it reads are features of edges, measured in the frame of the receiving vertex: "relative", the 16 numbers of
`graph.encodings`, or "relative-motor", 8 numbers. Both stay the same when the mesh is moved, turned or scaled; absolute
coordinates do not enter. For comparison it can read an encoding of vertices instead (`nn.inputs`): an edge then has the
numbers of its two ends.

Output is the
residual to the closed form, as coefficients in the frame F_v, turned into the world:

    t(v) = A_l/pi Y(n_v) + D(F_v) r(v)        so t turns with the mesh exactly as transfer does

With e_ij the features of the edge from j to i and x the states (none in the beginning):

    x_i  = Dense([mean_j h, max_j h]),  h = ReLU(W e_ij + b)
    then per layer, with y = LayerNorm(x):
    h_ij = LeakyReLU_0.2(W_e e_ij + W_s y_j + W_t y_i + b),   w_ij = softmax_j(h_ij a)       one weight per head
    x_i += Dense(sum_j w_ij h_ij),   x_i += MLP(LayerNorm(x_i))

This is GATv2 with edge features whose message is the hidden vector itself: edge, sender and receiver meet under the
nonlinearity, and only one row of `channels` is gathered per edge. The last layer starts at 0, so an untrained network
is the closed form.
"""

from dataclasses import dataclass

import jax.numpy as jnp
import jraph
from flax import linen as nn
from jaxtyping import Array, Float, Int

from gash_jax.algebra.closed_forms import unshadowed_transfer, zero_without_normal
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.settings import setting
from gash_jax.nn.attention import SLOPE, neighbour_softmax, over_vertices
from gash_jax.nn.config import ModelConfig, check_heads
from gash_jax.nn.inputs import VERTEX_ENCODINGS, edge_arrays, edge_ends, node_arrays, vertex_inputs


@dataclass(frozen=True)
class RingConfig(ModelConfig):
    """The network over rings of neighbours."""

    channels: int = setting(32, "width of the states", least=1)
    layers: int = setting(3, "number of attention layers", least=1)
    heads: int = setting(4, "attention heads; the channels must be a multiple", least=1)
    neighbours: int = setting(32, "neighbours of a vertex, drawn from four rings; a multiple of 4", least=4)
    block: int = setting(128, "vertices per block in inference; 0: all at once", least=0)
    encoding: str = setting(
        "relative",
        "what the network is told of an edge",
        choices=("relative", "relative-motor", *VERTEX_ENCODINGS),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_heads(self.heads, [self.channels])


class EdgePooling(nn.Module):
    """First states: mean and maximum over the edges of a vertex of one layer on their features."""

    channels: int
    block: int | None = None

    @nn.compact
    def __call__(self, relative: Float[Array, "v k d"]) -> Float[Array, "v {self.channels}"]:
        """States from edges alone."""
        kernel = self.param("kernel", nn.initializers.lecun_normal(), (relative.shape[-1], self.channels))
        bias = self.param("bias", nn.initializers.zeros_init(), (self.channels,))

        def pool(edges: Array) -> Array:
            hidden = nn.relu(edges @ kernel + bias[None])
            return jnp.concatenate([jnp.mean(hidden, axis=0), jnp.max(hidden, axis=0)])

        return nn.Dense(self.channels, name="mix")(over_vertices(pool, (relative,), self.block))


class EdgeAttention(nn.Module):
    """Sum over neighbours of the hidden vector of each edge, weighted by attention."""

    channels: int
    heads: int
    block: int | None = None

    @nn.compact
    def __call__(
        self, x: Float[Array, "v c"], relative: Float[Array, "v k d"], table: Int[Array, "v k"]
    ) -> Float[Array, "v {self.channels}"]:
        """Messages to every vertex from the states of its neighbours and the edges to them."""
        lecun, width = nn.initializers.lecun_normal(), self.channels // self.heads
        source = nn.Dense(self.channels, use_bias=False, name="source")(x)
        target = nn.Dense(self.channels, name="target")(x)
        edge = self.param("edge", lecun, (relative.shape[-1], self.channels))
        attention = self.param("attention", lecun, (self.channels, self.heads))

        def attend(edges: Array, senders: Array, own: Array) -> Array:
            hidden = nn.leaky_relu(edges @ edge + source[senders] + own[None], SLOPE)
            weights = neighbour_softmax(hidden @ attention, None)
            return jnp.einsum("kh,khc->hc", weights, hidden.reshape(-1, self.heads, width)).reshape(self.channels)

        return over_vertices(attend, (relative, table, target), self.block)


class RingNet(nn.Module):
    """Coefficients from edges["relative"], nodes["frame"] and nodes["normal"] of a graph with k `neighbours`.

    `block`: vertices per block in inference, None: all at once.
    """

    channels: int = 32
    layers: int = 3
    heads: int = 4
    bands: int = 3
    neighbours: int = 32
    block: int | None = None
    encoding: str = "relative"

    @nn.compact
    def __call__(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v {self.bands**2}"]:
        """Coefficients of every node in world directions; where not `deterministic` (training) in one block."""
        table, _ = edge_ends(graph, self.neighbours)
        block = self.block if deterministic else None
        nodes, relative = node_arrays(graph), _edge_inputs(graph, self.encoding, table)
        x = EdgePooling(self.channels, block, name="pooling")(relative)
        for i in range(self.layers):
            y = nn.LayerNorm(name=f"norm_{i}")(x)
            y = EdgeAttention(self.channels, self.heads, block, name=f"attention_{i}")(y, relative, table)
            x = x + nn.Dense(self.channels, name=f"out_{i}")(y)
            y = nn.Dense(2 * self.channels, name=f"hidden_{i}")(nn.LayerNorm(name=f"mlp_norm_{i}")(x))
            x = x + nn.Dense(self.channels, name=f"mlp_{i}")(nn.relu(y))
        x = nn.LayerNorm(name="norm")(x)
        residual = nn.Dense(self.bands**2, kernel_init=nn.initializers.zeros_init(), name="head")(x)
        world = rotate_coefficients(residual, nodes["frame"])
        return unshadowed_transfer(nodes["normal"], self.bands) + zero_without_normal(world, nodes["normal"])


def _edge_inputs(graph: jraph.GraphsTuple, encoding: str, table: Int[Array, "v k"]) -> Float[Array, "v k d"]:
    name = {"relative": "relative", "relative-motor": "motor"}.get(encoding)
    if name:
        edges = edge_arrays(graph)[name]
        return edges.reshape(*table.shape, edges.shape[-1])
    ends = vertex_inputs(graph, encoding)
    receivers = jnp.broadcast_to(ends[:, None], (*table.shape, ends.shape[-1]))
    return jnp.concatenate([ends[table], receivers], axis=-1)


def build_ring_net(config: RingConfig) -> RingNet:
    """The network of a config."""
    sizes = config.channels, config.layers, config.heads, config.bands, config.neighbours
    return RingNet(*sizes, config.block or None, config.encoding)
