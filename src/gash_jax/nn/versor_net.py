"""A network whose layers are products in R(4,1): motors act on multivectors, which multiply one another.

It reads what `ring_net` reads of "relative-motor": the motors m_ij of the neighbours in the frame of each vertex. It
ends as that does, in the residual to the closed form, said in the frame and turned into the world. Nothing it reads
changes when the mesh is moved, turned or scaled, so blades are plain numbers of the vertex and may be read one by one.

States x are c even multivectors (`algebra.even`), 0 in the beginning. With N(x) = x over its root mean square, over all
blades and channels, and y = N(x), a layer is (after Ruhe et al., Geometric Clifford Algebra Networks, 2023):

    motors act on multivectors a     z_i = mean over j of w_ij m_ij a ~m_ij
                                     w_ij = sigmoid(K q_ij + O y_i + S y_j + b) (1 + T y_j)
    versors act on states            x += V N(z),   (V z)_n = b_n + sum over c of w_nc R_nc z_c ~R_nc
    states multiply                  p = V'' N((V x)(V' x)),   x += sigmoid(G p) p

a, b, w, K, O, S, T, G are learned, and so are the bivectors B of the rotors R = exp(B/2). V, V', V'' are layers of such
rotors each of its own; x in the last line is N(x). In the first layer there is no y, and motors alone say the weights.

q_ij are the products of two numbers of m_ij. Every blade of m a ~m is linear in them, so K q_ij is any linear gate on
what a motor makes of any multivectors, and the mean over j is taken of q_ij before it meets a: no multivector of an
edge is ever formed. Geometric products bring quadratic functions, inner products among them.

The last layer starts at 0, so an untrained network is the closed form.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import jraph
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float, Int

from gash_jax.algebra.closed_forms import unshadowed_transfer, zero_without_normal
from gash_jax.algebra.even import even_product, motor_action_table, motor_squares, rotor_actions
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.settings import setting
from gash_jax.nn.attention import over_vertices
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.inputs import edge_arrays, edge_ends, node_arrays

BIVECTOR_SPREAD = 0.5  # of fresh bivectors: rotors far enough from 1 that channels differ, near enough that exp is tame
SMALLEST_SQUARE = 1e-6


@dataclass(frozen=True)
class VersorConfig(ModelConfig):
    """The network of multivectors over rings of neighbours."""

    channels: int = setting(8, "multivectors at a vertex", least=1)
    layers: int = setting(2, "layers after the first, in which states of neighbours are read", least=1)
    neighbours: int = setting(32, "neighbours of a vertex, drawn from four rings; a multiple of 4", least=4)
    block: int = setting(128, "vertices per block in inference; 0: all at once", least=0)
    encoding: str = setting("relative-motor", "what the network is told of an edge", choices=("relative-motor",))


class Algebra(NamedTuple):
    """How the two products of the network are computed.

    `product`: a b of even multivectors (..., 16, c). `act`: at one vertex, the sum over its neighbours of w m a ~m from
    motors (k, 8), their squares (k, 36), weights w (k, c) and multivectors a (16, c).
    """

    product: Callable[[Array, Array], Array]
    act: Callable[[Array, Array, Array, Array], Array]


def summed_action(
    motors: Float[Array, "k 8"],
    squares: Float[Array, "k 36"],
    weights: Float[Array, "k c"],
    still: Float[Array | np.ndarray, "16 c"],
) -> Float[Array, "16 c"]:
    """Sum over neighbours of w m a ~m: the squares are summed first."""
    acted = jnp.einsum("qij,jc->qic", jnp.asarray(motor_action_table(), still.dtype), still)
    return jnp.einsum("qc,qic->ic", squares.T @ weights, acted)


SPARSE = Algebra(even_product, summed_action)


def _normalised(x: Float[Array, "v 16 c"]) -> Float[Array, "v 16 c"]:
    square = jnp.mean(jnp.square(x.astype(jnp.float32)), axis=(1, 2), keepdims=True)  # float16 would overflow
    return (x / jnp.sqrt(square + SMALLEST_SQUARE)).astype(x.dtype)


def _blades(x: Float[Array, "v 16 c"]) -> Float[Array, "v d"]:
    return x.reshape(len(x), -1)


def versor_kernel(
    bivectors: Float[Array | np.ndarray, "c n 10"], weights: Float[Array | np.ndarray, "c n"]
) -> Float[Array, "16*c 16*n"]:
    """The matrix of x -> sum_c w_cn R_cn x_c ~R_cn on blades in a row, channels fastest."""
    actions = rotor_actions(bivectors) * weights[..., None, None]
    return actions.transpose(3, 0, 2, 1).reshape(16 * weights.shape[0], 16 * weights.shape[1])


class VersorLinear(nn.Module):
    """Sums of multivectors on which learned rotors act, one for each pair of channels."""

    channels: int

    @nn.compact
    def __call__(self, x: Float[Array, "v 16 c"]) -> Float[Array, "v 16 {self.channels}"]:
        """The rotors' matrices are of parameters alone, so they are formed once for all vertices."""
        pair = (x.shape[-1], self.channels)
        bivectors = self.param("bivectors", nn.initializers.normal(BIVECTOR_SPREAD), (*pair, 10))
        weights = self.param("weights", nn.initializers.lecun_normal(), pair)
        bias = self.param("bias", nn.initializers.zeros_init(), (16, self.channels))
        kernel = versor_kernel(bivectors, weights).astype(x.dtype)
        return (_blades(x) @ kernel).reshape(len(x), 16, self.channels) + bias[None]


class MotorAction(nn.Module):
    """Mean over neighbours of what their motors make of learned multivectors, weighted by what both ends are."""

    channels: int
    algebra: Algebra = SPARSE
    block: int | None = None

    @nn.compact
    def __call__(
        self,
        motors: Float[Array, "v k 8"],
        squares: Float[Array, "v k 36"],
        table: Int[Array, "v k"],
        y: Float[Array, "v 16 c"] | None,
    ) -> Float[Array, "v 16 {self.channels}"]:
        """`y`: the states; None where there are none yet, and motors alone say the weights."""
        still = self.param("still", nn.initializers.normal(1.0), (16, self.channels))
        key = self.param("key", nn.initializers.lecun_normal(), (36, self.channels))
        bias = self.param("bias", nn.initializers.zeros_init(), (self.channels,))
        own = jnp.broadcast_to(bias, (len(table), self.channels))
        sent = None
        if y is not None:
            own = own + nn.Dense(self.channels, use_bias=False, name="own")(_blades(y))
            sent = nn.Dense(2 * self.channels, use_bias=False, name="sent")(_blades(y))

        def receive(motors: Array, squares: Array, senders: Array, own: Array) -> Array:
            logits, values = squares @ key + own[None], jnp.ones((), key.dtype)
            if sent is not None:
                gate, value = jnp.split(sent[senders], 2, axis=-1)
                logits, values = logits + gate, 1.0 + value
            weights = nn.sigmoid(logits) * values / len(senders)
            return self.algebra.act(motors, squares, weights, still)

        return over_vertices(receive, (motors, squares, table, own), self.block)


class VersorLayer(nn.Module):
    """Motors act, then versors, then multivectors multiply one another."""

    channels: int
    algebra: Algebra = SPARSE
    block: int | None = None

    @nn.compact
    def __call__(
        self,
        motors: Float[Array, "v k 8"],
        squares: Float[Array, "v k 36"],
        table: Int[Array, "v k"],
        x: Float[Array, "v 16 c"] | None,
    ) -> Float[Array, "v 16 c"]:
        """The states after the layer; `x` is None in the first."""
        y = None if x is None else _normalised(x)
        z = MotorAction(self.channels, self.algebra, self.block, name="action")(motors, squares, table, y)
        z = VersorLinear(self.channels, name="receive")(_normalised(z))
        x = z if x is None else x + z
        y = _normalised(x)
        left, right = (VersorLinear(self.channels, name=name)(y) for name in ("left", "right"))
        p = VersorLinear(self.channels, name="product")(_normalised(self.algebra.product(left, right)))
        return x + p * nn.sigmoid(nn.Dense(self.channels, name="gate")(_blades(p)))[:, None]


class VersorNet(nn.Module):
    """Coefficients from edges["motor"], nodes["frame"] and nodes["normal"] of a graph with k `neighbours`.

    `block`: vertices per block in inference, None: all at once.
    """

    channels: int = 8
    layers: int = 2
    bands: int = 3
    neighbours: int = 32
    block: int | None = None
    algebra: Algebra = SPARSE

    @nn.compact
    def __call__(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v {self.bands**2}"]:
        """Coefficients of every node in world directions; where not `deterministic` (training) in one block."""
        table, _ = edge_ends(graph, self.neighbours)
        nodes, motors = node_arrays(graph), edge_arrays(graph)["motor"].reshape(*table.shape, 8)
        edges = motors, motor_squares(motors), table
        layer = partial(VersorLayer, self.channels, self.algebra, self.block if deterministic else None)
        x = layer(name="first")(*edges, None)
        for i in range(self.layers):
            x = layer(name=f"layer_{i}")(*edges, x)
        h = nn.silu(nn.Dense(8 * self.channels, name="hidden")(_blades(_normalised(x))))
        residual = nn.Dense(self.bands**2, kernel_init=nn.initializers.zeros_init(), name="head")(h)
        world = rotate_coefficients(residual, nodes["frame"])
        return unshadowed_transfer(nodes["normal"], self.bands) + zero_without_normal(world, nodes["normal"])


def build_versor_net(config: VersorConfig) -> VersorNet:
    """The network of a config."""
    sizes = config.channels, config.layers, config.bands, config.neighbours
    return VersorNet(*sizes, config.block or None)
