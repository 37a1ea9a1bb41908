"""Which networks there are, what they are made of, and which graph each of them wants.

Every model answers one contract: `build_model(config).apply(variables, graph, deterministic=True)` -> (v, k), with
k = bands² and the nodes in the order of the mesh's vertices. Only `local` has nodes in the order of its blocks and
says after its coefficients how far it expects to be off, one number a band; `learn.model.Model` puts both in order.
"""

from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from flax import linen as nn

from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.nn.inputs import VERTEX_ENCODINGS
from gash_jax.nn.mlp import MLP
from gash_jax.nn.ring_net import RingNet
from gash_jax.nn.surfel_net import SurfelNet
from gash_jax.nn.two_stage import CoefficientNet, TwoStage, VisibilityNet

GRAPHS = ("knn", "rings", "surfels", "none")
# a model that reads what only one kind of graph has
OWN_GRAPH = {"rings": "rings", "local": "surfels", "mlp": "none"}
# what a model can be told of a vertex or of an edge, its default first
ENCODINGS = {
    "rings": ("relative", "relative-motor", *VERTEX_ENCODINGS),
    "local": ("surfels",),
    "two-stage": VERTEX_ENCODINGS,
    "gnn": (*VERTEX_ENCODINGS, "relative-motor"),
    "teacher": VERTEX_ENCODINGS,
    "mlp": VERTEX_ENCODINGS,
}


class _Defaults(NamedTuple):
    """What the fields of a config that are left at 0 (or "") become."""

    channels: int
    layers: int
    heads: int
    neighbours: int
    graph: str


DEFAULTS = {
    "rings": _Defaults(channels=32, layers=3, heads=4, neighbours=32, graph="rings"),
    "local": _Defaults(channels=16, layers=2, heads=1, neighbours=48, graph="surfels"),
    "two-stage": _Defaults(channels=96, layers=5, heads=4, neighbours=16, graph="knn"),
    "gnn": _Defaults(channels=96, layers=5, heads=4, neighbours=16, graph="knn"),
    "teacher": _Defaults(channels=96, layers=5, heads=4, neighbours=16, graph="knn"),
    "mlp": _Defaults(channels=128, layers=3, heads=1, neighbours=0, graph="none"),
}


@dataclass(frozen=True)
class ModelConfig:
    """Everything that determines a network; 0 and "" stand for the model's own default and are resolved at once.

    `channels`, `layers`, `heads` are those of the net that predicts coefficients; `visibility_channels` and
    `visibility_layers` belong to the two-stage network alone, `visibility_directions` also to the teacher, `dropout` to
    both and to the single-stage GNN. `block`: vertices per block in inference, 0 for all at once. `encoding`: see
    `nn.inputs` and `nn.ring_net`.
    Raises ValueError for values no network can be built from.
    """

    name: str = "local"
    bands: int = 3
    channels: int = 0
    layers: int = 0
    heads: int = 0
    neighbours: int = 0
    graph: str = ""
    visibility_channels: int = 64
    visibility_layers: int = 3
    visibility_directions: int = 25
    dropout: float = 0.2
    block: int = 128
    encoding: str = ""

    def __post_init__(self) -> None:
        if self.name not in DEFAULTS:
            raise ValueError(f"unknown model {self.name!r}: known are {', '.join(DEFAULTS)}")
        for key, default in DEFAULTS[self.name]._asdict().items():
            if not getattr(self, key):
                object.__setattr__(self, key, default)
        known = ENCODINGS[self.name]
        if not self.encoding:
            object.__setattr__(self, "encoding", known[0])
        if self.encoding not in known:
            raise ValueError(f"model {self.name} has no encoding {self.encoding!r}: known are {', '.join(known)}")
        self._check_numbers()
        if self.graph not in GRAPHS:
            raise ValueError(f"unknown graph {self.graph!r}: known are {', '.join(GRAPHS)}")
        own = OWN_GRAPH.get(self.name)
        if own and self.graph != own:
            raise ValueError(f"model {self.name} cannot use graph {self.graph}: it takes {own} and no other")
        if not own and self.graph in ("surfels", "none"):
            raise ValueError(f"model {self.name} cannot use graph {self.graph}: it needs edges between vertices")
        for width in (self.channels, self.visibility_channels):
            if width % self.heads:
                raise ValueError(f"{width} channels cannot be split into {self.heads} heads: use a multiple")
        if not 0 <= self.dropout < 1:
            raise ValueError(f"dropout = {self.dropout}: must be from 0 to below 1")

    def _check_numbers(self) -> None:
        least = dict.fromkeys(("channels", "layers", "heads", "visibility_channels", "visibility_layers"), 1)
        least |= {"bands": 1, "visibility_directions": 1, "neighbours": 0, "block": 0}
        for key, low in least.items():
            if getattr(self, key) < low:
                raise ValueError(f"{key} = {getattr(self, key)}: must be at least {low}")
        if self.bands > MAX_BANDS:
            raise ValueError(f"bands = {self.bands}: must be from 1 to {MAX_BANDS}")

    def to_dict(self) -> dict[str, Any]:
        """Plain values by field name."""
        return asdict(self)


def build_model(config: ModelConfig) -> nn.Module:
    """The network of a config."""
    channels, layers, heads, bands = config.channels, config.layers, config.heads, config.bands
    neighbours, block = config.neighbours, config.block or None
    if config.name == "mlp":
        return MLP(channels, layers, bands, config.encoding)
    if config.name == "rings":
        return RingNet(channels, layers, heads, bands, neighbours, block, config.encoding)
    if config.name == "local":
        return SurfelNet(channels, layers, bands, neighbours)
    sees = config.name != "gnn"
    coefficient = CoefficientNet(
        *(channels, layers, heads, bands, config.dropout, neighbours, block, sees, config.encoding)
    )
    if config.name != "two-stage":
        return coefficient
    widths = config.visibility_channels, config.visibility_layers
    visibility = VisibilityNet(*widths, heads, config.visibility_directions, neighbours, block, config.encoding)
    return TwoStage(visibility, coefficient)
