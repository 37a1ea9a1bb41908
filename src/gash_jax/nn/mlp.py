"""The first Neural-GASh: every vertex by itself, 32 motor components -> B² coefficients (GNN paper, 2.3).

It cannot know of occlusion beyond what position and normal say about the shapes it was trained on.
"""

from dataclasses import dataclass

import jraph
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.files.settings import setting
from gash_jax.nn.inputs import VERTEX_ENCODINGS, node_arrays, vertex_inputs
from gash_jax.nn.output import OutputConfig, world_coefficients


@dataclass(frozen=True)
class MLPConfig(OutputConfig):
    """The MLP over single vertices."""

    channels: int = setting(128, "width of the hidden layers", least=1)
    layers: int = setting(3, "number of hidden layers", least=1)
    encoding: str = setting("motor", "what the network is told of a vertex", choices=VERTEX_ENCODINGS)


class MLP(nn.Module):
    """`layers` hidden layers of `channels`, ReLU; reads the vertex in its `encoding`.

    `frame`, `residual`: how it ends, see `output`.
    """

    channels: int = 128
    layers: int = 3
    bands: int = 3
    encoding: str = "motor"
    frame: str = "mixed"
    residual: bool = False

    @nn.compact
    def __call__(self, graph: jraph.GraphsTuple, deterministic: bool = True) -> Float[Array, "v {self.bands**2}"]:
        """Coefficients of every node; nothing here is random, so `deterministic` changes nothing."""
        x = vertex_inputs(graph, self.encoding)
        for i in range(self.layers):
            x = nn.relu(nn.Dense(self.channels, name=f"dense_{i}")(x))
        x = nn.Dense(self.bands**2, kernel_init=nn.initializers.zeros, name="head")(x)
        return world_coefficients(x, node_arrays(graph), self.frame, self.residual)


def build_mlp(config: MLPConfig) -> MLP:
    """The network of a config."""
    return MLP(config.channels, config.layers, config.bands, config.encoding, config.frame, config.residual)
