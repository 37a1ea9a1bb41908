"""The two attention layers of the GNN paper (4.2), number for number those of PyTorch Geometric.

Notation: x_i the state of the receiver, x_j of a sender, C channels per head; softmax over the edges that end at i, for
each head; heads are concatenated.

    TransformerConv (Shi et al. 2020)   out_i = W_s x_i + b_s + sum_j softmax_j(q_i . k_j / sqrt(C)) v_j
    GATv2Conv (Brody et al. 2022)       out_i = b + sum_j softmax_j(a . LeakyReLU_0.2(r_i + l_j)) l_j

q, k, v, r (target) and l (source) are affine in the state. GATv2 drops the loops it is given and adds one at every
vertex; TransformerConv does not.

Edges come either as a flat list (senders, receivers: the segment path, any graph) or, where every vertex has k of
them, as a table (v, k) (the fixed path: gather and dense softmax, no scatter; the one to train, run and export). Both
read the same parameters. Masked edges count for nothing; a vertex without edges receives the sum over none, 0.
"""

from collections.abc import Callable
from typing import cast

import jax
import jax.numpy as jnp
import jraph
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Bool, Float, Int

SLOPE = 0.2
# PyTorch Geometric's softmax adds this to the denominator; it also keeps a vertex without edges at 0
EMPTY = 1e-16

Nodes = Float[Array | np.ndarray, "v c"]
Senders = Int[Array | np.ndarray, "e"] | Int[Array | np.ndarray, "v k"]
Mask = Bool[Array | np.ndarray, "e"] | Bool[Array | np.ndarray, "v k"]


def neighbour_softmax(logits: Float[Array, "*v k h"], mask: Bool[Array, "*v k"] | None) -> Float[Array, "*v k h"]:
    """Softmax over the neighbour axis; masked neighbours get 0, and all of them do where all are masked."""
    if mask is None:
        return jax.nn.softmax(logits, axis=-2)
    logits = jnp.where(mask[..., None], logits, -jnp.inf)
    largest = jax.lax.stop_gradient(jnp.max(logits, axis=-2, keepdims=True))
    # -inf - (-inf) would be NaN
    weights = jnp.exp(logits - jnp.where(jnp.isfinite(largest), largest, 0.0))
    return weights / (jnp.sum(weights, axis=-2, keepdims=True) + EMPTY)


def _segment_attend(
    logits: Float[Array, "e h"],
    values: Float[Array, "e h c"],
    receivers: Array,
    mask: Array | None,
    n_node: int,
) -> Float[Array, "v h c"]:
    """Softmax per receiver and weighted sum; masked edges are sent to one more segment that is thrown away."""
    segments = receivers if mask is None else jnp.where(mask, receivers, n_node)
    weights = cast(Array, jraph.segment_softmax(logits, segments, n_node + 1))
    return jax.ops.segment_sum(weights[..., None] * values, segments, n_node + 1)[:n_node]


def over_vertices(
    function: Callable[..., Array], arguments: tuple[Array | np.ndarray | None, ...], block: int | None
) -> Array:
    """`function` mapped over the rows of its arguments: all at once, or `block` rows at a time.

    On a CPU what a block gathers stays in the cache, which is worth more than the longer vectors; elsewhere, and
    where there is only one block, all rows go at once.
    """
    n_node = next(len(a) for a in arguments if a is not None)
    if block is None or n_node <= block or jax.default_backend() != "cpu":
        return jax.vmap(function)(*arguments)
    return jax.lax.map(lambda each: function(*each), arguments, batch_size=block)


class TransformerConv(nn.Module):
    """Dot-product attention with a root projection; output has features_per_head * heads channels.

    `block`: vertices per block of the fixed path, for inference on large graphs; None: all at once.
    """

    features_per_head: int
    heads: int
    block: int | None = None

    @nn.compact
    def __call__(
        self,
        x: Nodes,
        senders: Senders,
        receivers: Int[Array | np.ndarray, "e"] | None = None,
        mask: Mask | None = None,
    ) -> Float[Array, "v {self.features_per_head*self.heads}"]:
        """New states; `senders` is a table (v, k), or a list with its `receivers`. True in `mask`: the edge counts."""
        heads, width = self.heads, self.features_per_head
        names = ("query", "key", "value")
        query, key, value = (nn.Dense(heads * width, name=n)(x).reshape(-1, heads, width) for n in names)
        root = nn.Dense(heads * width, name="root")(x)
        scale = 1.0 / width**0.5

        def attend(q: Array, table: Array, keep: Array | None) -> Array:
            weights = neighbour_softmax(jnp.sum(q[None] * key[table], axis=-1) * scale, keep)
            return jnp.sum(weights[..., None] * value[table], axis=0)

        senders, keep = jnp.asarray(senders), None if mask is None else jnp.asarray(mask)
        if receivers is None:
            out = over_vertices(attend, (query, senders, keep), self.block)
        else:
            logits = jnp.sum(query[receivers] * key[senders], axis=-1) * scale
            out = _segment_attend(logits, value[senders], jnp.asarray(receivers), keep, len(x))
        return out.reshape(-1, heads * width) + root


class GATv2Conv(nn.Module):
    """Attention whose weights depend on the receiver through a nonlinearity; self-loops are added.

    `block`: vertices per block of the fixed path, for inference on large graphs; None: all at once.
    """

    features_per_head: int
    heads: int
    block: int | None = None

    @nn.compact
    def __call__(
        self,
        x: Nodes,
        senders: Senders,
        receivers: Int[Array | np.ndarray, "e"] | None = None,
        mask: Mask | None = None,
        edges: Float[Array | np.ndarray, "e d"] | None = None,
    ) -> Float[Array, "v {self.features_per_head*self.heads}"]:
        """New states; `senders` is a table (v, k), or a list with its `receivers`. True in `mask`: the edge counts.

        `edges`, with a table only, is the relative motor of each: l_j becomes l_j + W_e e_ij, in weight and message
        (PyTorch Geometric leaves the edge out of the message, where states that are alike then have nothing to say).
        Raises ValueError for edges with a list.
        """
        heads, width = self.heads, self.features_per_head
        glorot = nn.initializers.glorot_uniform()
        source, target = (
            nn.Dense(heads * width, kernel_init=glorot, name=n)(x).reshape(-1, heads, width)
            for n in ("source", "target")
        )
        attention = self.param("attention", glorot, (heads, width))
        bias = self.param("bias", nn.initializers.zeros_init(), (heads * width,))

        if edges is not None and receivers is not None:
            raise ValueError("edges of a list of senders and receivers: give a table of senders")
        relative = kernel = None
        if edges is not None:
            # the added loop is the motor that moves nothing
            loop = jnp.zeros((len(x), 1, edges.shape[-1])).at[..., 0].set(1.0)
            relative = jnp.concatenate([jnp.asarray(edges).reshape(len(x), -1, edges.shape[-1]), loop], axis=1)
            kernel = self.param("edge", glorot, (edges.shape[-1], heads * width))

        def attend(r: Array, table: Array, keep: Array, motors: Array | None) -> Array:
            messages = source[table]
            if motors is not None and kernel is not None:
                messages = messages + (motors @ kernel).reshape(messages.shape)
            logits = jnp.sum(attention[None] * nn.leaky_relu(r[None] + messages, SLOPE), axis=-1)
            return jnp.sum(neighbour_softmax(logits, keep)[..., None] * messages, axis=0)

        senders, own = jnp.asarray(senders), jnp.arange(len(x), dtype=jnp.int32)
        if receivers is None:
            keep = jnp.pad(_without_loops(senders, own[:, None], mask), ((0, 0), (0, 1)), constant_values=True)
            table = jnp.concatenate([senders, own[:, None]], axis=1)
            out = over_vertices(attend, (target, table, keep, relative), self.block)
        else:
            keep = jnp.pad(_without_loops(senders, receivers, mask), (0, len(x)), constant_values=True)
            senders, receivers = jnp.append(senders, own), jnp.append(jnp.asarray(receivers), own)
            messages = source[senders]
            logits = jnp.sum(attention[None] * nn.leaky_relu(target[receivers] + messages, SLOPE), axis=-1)
            out = _segment_attend(logits, messages, receivers, keep, len(x))
        return out.reshape(-1, heads * width) + bias[None]


def _without_loops(senders: Array, receivers: Array | np.ndarray, mask: Array | np.ndarray | None) -> Array:
    different = senders != receivers
    return different if mask is None else different & mask
