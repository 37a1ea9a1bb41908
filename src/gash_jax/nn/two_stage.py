"""The two-stage network of the GNN paper (4.2): visibility from motors, coefficients from motors and visibility.

    stage 1   32 -> Dense 64 -> 3 x [x + ReLU(LayerNorm(TransformerConv(x)))] -> Dense 25 logits
    stage 2   32 motor + 25 probabilities -> Dense 96 -> 5 x [x + Dropout_0.2(ReLU(GATv2Conv(x)))] -> Dense B²

The paper gives no number of heads: 4 here, concatenated, so that a head has a quarter of the channels. It trains the
stages one after the other; `TwoStage` holds both, under the parameters "visibility" and "coefficient".

Stage 2 alone is two more of the paper's networks (4.1): the single-stage GNN, which reads motors only, and the teacher,
which reads the true visibility, 57 inputs with the 32 of the motor.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import jraph
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.files.settings import setting
from gash_jax.nn.attention import GATv2Conv, TransformerConv
from gash_jax.nn.config import check_heads
from gash_jax.nn.inputs import VERTEX_ENCODINGS, edge_arrays, edge_ends, node_arrays, vertex_inputs
from gash_jax.nn.output import OutputConfig, world_coefficients


@dataclass(frozen=True)
class GNNConfig(OutputConfig):
    """The single-stage network: stage 2 alone, from motors to coefficients."""

    channels: int = setting(96, "width of the coefficient net", least=1)
    layers: int = setting(5, "number of its GATv2 layers", least=1)
    heads: int = setting(4, "attention heads; all channels must be a multiple", least=1)
    neighbours: int = setting(16, "neighbours of a vertex", least=1)
    graph: str = setting("knn", "nearest vertices, or some drawn from rings around them", choices=("knn", "rings"))
    dropout: float = setting(0.2, "share of states dropped in training", least=0, below=1)
    block: int = setting(128, "vertices per block in inference; 0: all at once", least=0)
    encoding: str = setting(
        "motor", "what the network is told of a vertex", choices=(*VERTEX_ENCODINGS, "relative-motor")
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        check_heads(self.heads, [self.channels])


@dataclass(frozen=True)
class TeacherConfig(GNNConfig):
    """The teacher: stage 2 that is told traced visibilities."""

    visibility_directions: int = setting(25, "directions whose visibility is told", least=1)
    encoding: str = setting("motor", "what the network is told of a vertex", choices=VERTEX_ENCODINGS)


@dataclass(frozen=True)
class TwoStageConfig(TeacherConfig):
    """Both stages."""

    visibility_channels: int = setting(64, "width of the visibility net", least=1)
    visibility_layers: int = setting(3, "number of its TransformerConv layers", least=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_heads(self.heads, [self.visibility_channels])


class VisibilityNet(nn.Module):
    """Stage 1: logits of the visibility of `directions` directions.

    `neighbours`: the k of a graph with a fixed number of them, None for a ragged one. `block`: see `attention`.
    """

    channels: int = 64
    layers: int = 3
    heads: int = 4
    directions: int = 25
    neighbours: int | None = 16
    block: int | None = None
    encoding: str = "motor"

    @nn.compact
    def __call__(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v {self.directions}"]:
        """Logits of every node; where not `deterministic` (training) all vertices are one block."""
        ends, block = edge_ends(graph, self.neighbours), self.block if deterministic else None
        x = nn.Dense(self.channels, name="embed")(vertex_inputs(graph, self.encoding))
        for i in range(self.layers):
            y = TransformerConv(self.channels // self.heads, self.heads, block, name=f"conv_{i}")(x, *ends)
            x = x + nn.relu(nn.LayerNorm(name=f"norm_{i}")(y))
        return nn.Dense(self.directions, name="head")(x)


class CoefficientNet(nn.Module):
    """Stage 2: coefficients from the motor and, with `sees_visibility`, nodes["visibility"] (v, n) in 0 .. 1.

    With the encoding "relative-motor" it also reads edges["motor"]. `frame`, `residual`: how it ends, see `output`.
    """

    channels: int = 96
    layers: int = 5
    heads: int = 4
    bands: int = 3
    dropout: float = 0.2
    neighbours: int | None = 16
    block: int | None = None
    sees_visibility: bool = True
    encoding: str = "motor"
    frame: str = "mixed"
    residual: bool = False

    @nn.compact
    def __call__(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v {self.bands**2}"]:
        """Coefficients of every node; where not `deterministic` (training) it needs the random stream "dropout"."""
        ends, block = edge_ends(graph, self.neighbours), self.block if deterministic else None
        nodes = node_arrays(graph)
        x = vertex_inputs(graph, self.encoding)
        if self.sees_visibility:
            x = jnp.concatenate([x, nodes["visibility"]], axis=-1)
        motors = edge_arrays(graph)["motor"] if self.encoding == "relative-motor" else None
        x = nn.Dense(self.channels, name="embed")(x)
        for i in range(self.layers):
            y = GATv2Conv(self.channels // self.heads, self.heads, block, name=f"conv_{i}")(x, *ends, edges=motors)
            x = x + nn.Dropout(self.dropout, name=f"dropout_{i}")(nn.relu(y), deterministic=deterministic)
        x = nn.Dense(self.bands**2, kernel_init=nn.initializers.zeros, name="head")(x)
        return world_coefficients(x, nodes, self.frame, self.residual)


class TwoStage(nn.Module):
    """Both stages in sequence."""

    visibility: VisibilityNet
    coefficient: CoefficientNet

    def visibility_logits(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v n"]:
        """Stage 1 alone."""
        return self.visibility(graph, deterministic)

    def __call__(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v k"]:
        """Coefficients of every node from the visibility that stage 1 predicts."""
        probabilities = jax.nn.sigmoid(self.visibility_logits(graph, deterministic))
        nodes = {**node_arrays(graph), "visibility": probabilities}
        return self.coefficient(graph._replace(nodes=nodes), deterministic)


def build_coefficient_net(config: GNNConfig) -> CoefficientNet:
    """Stage 2 of a config; only the single-stage network does without visibilities."""
    sizes = config.channels, config.layers, config.heads, config.bands, config.dropout, config.neighbours
    end = config.encoding, config.frame, config.residual
    return CoefficientNet(*sizes, config.block or None, isinstance(config, TeacherConfig), *end)


def build_two_stage(config: TwoStageConfig) -> TwoStage:
    """Both stages of a config."""
    widths = config.visibility_channels, config.visibility_layers, config.heads, config.visibility_directions
    visibility = VisibilityNet(*widths, config.neighbours, config.block or None, config.encoding)
    return TwoStage(visibility, build_coefficient_net(config))
