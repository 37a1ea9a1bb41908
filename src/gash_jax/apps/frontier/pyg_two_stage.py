"""The two-stage network in PyTorch Geometric, with the weights of one of our model files: what we are compared with.

Needs the extra `peers`. The layers are PyTorch Geometric's own; the blocks around them follow nn/two_stage.py.
"""

from pathlib import Path

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]
from torch_geometric.nn import GATv2Conv, TransformerConv  # pyright: ignore[reportMissingImports]

from gash_jax.models.model import load_model
from gash_jax.nn.two_stage import TwoStageConfig

CONV = {
    "GATv2Conv": {"lin_l": "source", "lin_r": "target"},
    "TransformerConv": {"lin_query": "query", "lin_key": "key", "lin_value": "value", "lin_skip": "root"},
}


def _linear(layer: nn.Module, weights: dict) -> None:
    layer.weight.data = torch.tensor(np.asarray(weights["kernel"]).T.copy())
    layer.bias.data = torch.tensor(np.asarray(weights["bias"]))


def load_layer(layer: nn.Module, weights: dict) -> None:
    """Copy one of our attention layers into PyTorch Geometric's."""
    for theirs, ours in CONV[type(layer).__name__].items():
        _linear(getattr(layer, theirs), weights[ours])
    if isinstance(layer, GATv2Conv):
        layer.att.data = torch.tensor(np.asarray(weights["attention"]))[None]
        layer.bias.data = torch.tensor(np.asarray(weights["bias"]))


class PygTwoStage(nn.Module):
    """Both stages for inference: motors (v, 32) and edges (2, e) to coefficients (v, B*B)."""

    def __init__(self, config: TwoStageConfig, params: dict) -> None:
        super().__init__()
        heads = config.heads
        self.embeds, self.heads = nn.ModuleList(), nn.ModuleList()
        stages = (
            ("visibility", TransformerConv, config.visibility_channels, config.visibility_layers),
            ("coefficient", GATv2Conv, config.channels, config.layers),
        )
        self.convs = nn.ModuleList()
        for room, kind, channels, layers in stages:
            weights, convs = params[room], nn.ModuleList()
            for i in range(layers):
                conv = kind(channels, channels // heads, heads=heads)
                load_layer(conv, weights[f"conv_{i}"])
                convs.append(conv)
            self.convs.append(convs)
            for name, target in (("embed", self.embeds), ("head", self.heads)):
                kernel = np.asarray(weights[name]["kernel"])
                layer = nn.Linear(*kernel.shape)
                _linear(layer, weights[name])
                target.append(layer)
        self.norms = nn.ModuleList()
        for i in range(config.visibility_layers):
            norm = nn.LayerNorm(config.visibility_channels, eps=1e-6)
            norm.weight.data = torch.tensor(np.asarray(params["visibility"][f"norm_{i}"]["scale"]))
            norm.bias.data = torch.tensor(np.asarray(params["visibility"][f"norm_{i}"]["bias"]))
            self.norms.append(norm)
        self.eval()

    def logits(self, motors: torch.Tensor, edges: torch.Tensor) -> torch.Tensor:
        """Stage 1."""
        x = self.embeds[0](motors)
        for conv, norm in zip(self.convs[0], self.norms, strict=True):
            x = x + torch.relu(norm(conv(x, edges)))
        return self.heads[0](x)

    def forward(self, motors: torch.Tensor, edges: torch.Tensor) -> torch.Tensor:
        """Coefficients; a vertex without a normal is the caller's affair."""
        seen = torch.sigmoid(self.logits(motors, edges))
        x = self.embeds[1](torch.cat([motors, seen], dim=1))
        for conv in self.convs[1]:
            x = x + torch.relu(conv(x, edges))
        return self.heads[1](x)


def load_pyg(path: str | Path) -> PygTwoStage:
    """The network of a two-stage model file."""
    model = load_model(path)
    if model.config.name != "two-stage":
        raise ValueError(f"{path} is a {model.config.name} model: only two-stage has a twin here")
    return PygTwoStage(model.config, model.params)


def predict(network: PygTwoStage, motors: np.ndarray, senders: np.ndarray, receivers: np.ndarray) -> np.ndarray:
    """Coefficients of all vertices."""
    edges = torch.tensor(np.stack([senders, receivers]).astype(np.int64))
    with torch.inference_mode():
        return network(torch.tensor(motors), edges).numpy()
