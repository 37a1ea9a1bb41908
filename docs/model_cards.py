"""The cards of the weights that ship, made from the files themselves and from the results: docs/model_cards.md."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from docs.baking_tables import origin
from docs.local_tables import table
from experiments.neural_gash.variants import SHIPPED
from gash_jax.models.families import labels_of
from gash_jax.models.model import Model, load_model, shipped_models

ROOT = Path(__file__).parents[1]

# the name under which the results know the shipped weights
MEASURED = {"local": "local", **SHIPPED}
WHAT = {
    "local": "Our own network over a tree of surfels; the default of `gash predict` and `load_model`.",
    "mlp": "The first paper's baseline: a motor of every vertex through an MLP, no neighbours.",
    "two-stage": "The GNN paper's network as published: TransformerConv visibility, then GATv2 coefficients.",
}
LIMITS = {
    "local": "Knows nothing of what is smaller than its surfels (of which a vertex reads 256 at most), nor of holes "
    "between them; soups of loose triangles are its weakest. `predicted_error` is an expectation over "
    "shapes like those of the corpus and such as were broken on purpose, and the bound made of it was found on these: "
    "the results say how many vertices of other meshes keep it.",
    "mlp": "Sees no occluder: what it knows is the corpus' average shadow at a place and a normal. Not equivariant: "
    "another orientation of the same mesh gets other coefficients.",
    "two-stage": "Sees 16 nearest neighbours a layer, so nothing far: where shadows come from afar it can be much "
    "worse than the closed form. Not equivariant: the twist of its frames is that of the paper's rotor. Here to "
    "reproduce the paper.",
}


def card(name: str, path: Path, result: dict[str, Any], corpora: dict[str, Any]) -> str:
    """The section of one model."""
    model = load_model(name)
    run, parameters = model.metadata["run"], sum(leaf.size for leaf in map(np.asarray, _leaves(model.params)))
    data, train = run["data"], run["train"]
    budget = f"{train['seconds']:.0f} s of {'CPU time of each core' if train.get('clock') == 'cpu' else 'wall time'}"
    if train.get("start_from"):
        budget += f", begun from {train['start_from']}"
    rows = [row["methods"][MEASURED[name]] for row in result["rows"]]
    skills = [row["skill"] for row in rows if isinstance(row["skill"], float)]
    shapes = (
        f"{data['shapes']} generated shapes, asked for {data['min_vertices']} to {data['max_vertices']} vertices each"
    )
    made = {row["config"]: row for row in corpora["rows"]}["local" if name == "local" else "base"]
    shapes += f" (made with {made['least']} to {made['most']})"
    lines = [
        ["parameters", f"{parameters} in {path.stat().st_size / 1e6:.2f} MB"],
        *_abilities(model),
        ["trained on", f"{shapes}, labels of {data['rays']} rays; no mesh from elsewhere"],
        ["budget", f"{budget}, seed {train['seed']}, {train['batch_vertices']} vertices a batch"],
        ["skill on unseen meshes", f"median {np.median(skills):.3f}, from {min(skills):.2f} to {max(skills):.2f}"],
        ["relative RMSE", f"median {np.median([r['relrmse'] for r in rows if r['relrmse'] is not None]):.4f}"],
        ["time", f"network {np.median([row['network_us'] for row in rows]):.1f} us a vertex"],
    ]
    return f"## `{name}`\n\n{WHAT[name]}\n\n{table(['', ''], lines)}\n\nLimits: {LIMITS[name]}\n"


def _abilities(model: Model) -> list[list[str]]:
    """What a network knows beyond what it says unasked, and the bound of its error."""
    (bands, bounces), lines = labels_of(model.config), []
    if bands > model.config.bands or bounces:
        lines.append(["can be asked for", f"1 to {bands} bands, up to {bounces} bounces"])
    if "bound" in model.metadata:
        lines.append(["bound of 90 % of the vertices", f"{model.metadata['bound']:.2f} times `predicted_error`"])
    return lines


def _leaves(tree: Any) -> list[Any]:
    return [leaf for value in tree.values() for leaf in _leaves(value)] if isinstance(tree, dict) else [tree]


def cards(result: dict[str, Any], corpora: dict[str, Any]) -> str:
    """The whole document."""
    head = "# Model cards\n\nThe weights inside the package. Measures are those of [the results](results.md): "
    head += (
        f"{len(result['rows'])} meshes that no network has seen, references of {result['arguments']['rays']} rays.\n"
    )
    sections = [card(name, path, result, corpora) for name, path in shipped_models().items()]
    return "\n".join([head, *sections, f"{origin(result)}.\n"])


def committed_cards() -> str:
    """The document of the results that are committed."""
    folder = ROOT / "docs" / "results"
    return cards(*(json.loads((folder / f"{name}.json").read_text()) for name in ("neural_gash", "corpus_sizes")))
