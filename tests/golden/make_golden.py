"""Write pyg_layers.npz: what PyTorch Geometric's layers give and how they differentiate; run by hand, not by the tests.

Needs torch and torch_geometric, which the project does not (any virtual environment will do):

    python tests/golden/make_golden.py

Arrays are named case/layer/what, with case "fixed" (3 senders at every node) or "ragged" (a node without edges, one
with a loop). Weights keep PyTorch's names and shapes (output, input). The loss is sum(out * cotangent).
"""

from pathlib import Path
from typing import Any

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch_geometric.nn import GATv2Conv, TransformerConv  # pyright: ignore[reportMissingImports]

NODES, INPUTS, WIDTH, HEADS, NEIGHBOURS = 7, 5, 4, 3, 3
LAYERS = {
    "gatv2": lambda: GATv2Conv(INPUTS, WIDTH, heads=HEADS),
    "transformer": lambda: TransformerConv(INPUTS, WIDTH, heads=HEADS),
}


def edges(case: str, rng: np.random.Generator) -> np.ndarray:
    """(2, e) senders and receivers, sorted by receiver."""
    if case == "fixed":
        table = [rng.choice(np.delete(np.arange(NODES), i), NEIGHBOURS, replace=False) for i in range(NODES)]
        return np.stack([np.concatenate(table), np.repeat(np.arange(NODES), NEIGHBOURS)])
    senders = [1, 2, 3, 0, 2, 2, 4, 0, 1, 2, 3, 5, 6, 0, 5]
    receivers = [0, 0, 0, 1, 1, 2, 2, 4, 4, 4, 4, 4, 4, 5, 6]
    return np.stack([senders, receivers])


def run(case: str, name: str, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """One layer on one graph: inputs, weights, output, gradients."""
    layer, ends = LAYERS[name](), edges(case, rng)
    for parameter in layer.parameters():
        parameter.data = torch.tensor(rng.normal(0, 0.7, parameter.shape), dtype=torch.float32)
    x = torch.tensor(rng.normal(size=(NODES, INPUTS)), dtype=torch.float32, requires_grad=True)
    cotangent = torch.tensor(rng.normal(size=(NODES, WIDTH * HEADS)), dtype=torch.float32)
    out = layer(x, torch.tensor(ends))
    (out * cotangent).sum().backward()
    arrays = {"edges": ends.astype(np.int32), "x": x, "out": out, "cotangent": cotangent, "gradient/x": x.grad}
    for key, parameter in layer.named_parameters():
        arrays |= {f"weight/{key}": parameter, f"gradient/{key}": parameter.grad}
    as_numpy = {k: v.detach().numpy() if isinstance(v, torch.Tensor) else v for k, v in arrays.items()}
    return {f"{case}/{name}/{key}": value for key, value in as_numpy.items()}


if __name__ == "__main__":
    generator = np.random.default_rng(0)
    golden: dict[str, Any] = {}
    for case in ("fixed", "ragged"):
        for name in LAYERS:
            golden |= run(case, name, generator)
    np.savez_compressed(Path(__file__).with_name("pyg_layers.npz"), **golden)
