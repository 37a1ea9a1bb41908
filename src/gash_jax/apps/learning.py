"""Commands that load the neural-network libraries: predict, train."""

import json
from pathlib import Path

import numpy as np

from gash_jax.apps.progress import progress_bar, say
from gash_jax.geometry.mesh_io import read_mesh
from gash_jax.geometry.npz_io import check_writable
from gash_jax.learn.batches import make_examples
from gash_jax.learn.config import load_config
from gash_jax.learn.corpus import build_corpus, split_indices
from gash_jax.learn.model import load_model
from gash_jax.learn.train import train_model
from gash_jax.prt.transfer import save_transfer


def predict(mesh_path: Path, output: Path, model_name: str, up: str, quiet: bool) -> None:
    """`gash predict`."""
    check_writable(output)
    model = load_model(model_name)
    mesh, health = read_mesh(mesh_path, up)
    transfer = model.predict(mesh)
    transfer.metadata["health"] = health.to_dict()
    save_transfer(output, transfer)
    for line in health.lines():
        say(f"  {line}", quiet)
    seconds = transfer.metadata["seconds"]
    say(
        f"{len(mesh.vertices)} vertices: graph {seconds['graph']:.2f} s, network {seconds['network']:.2f} s",
        quiet,
    )
    say(f"wrote {output}", quiet)


def train(config_path: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool) -> None:
    """`gash train`."""
    config = load_config(config_path, overrides)
    folder = output or Path("runs") / config.name
    training, validation = split_indices(config.data)
    with progress_bar("corpus", quiet) as update:
        items = build_corpus(config.data, config.model.bands, np.concatenate([training, validation]), update)
    examples = make_examples(items, config.model)
    with progress_bar(f"training {config.name}", quiet) as update:

        def report(phase: str, fraction: float, measures: dict[str, float]) -> None:
            update(round(1000 * fraction), 1000)

        path = train_model(config, examples[: len(training)], examples[len(training) :], folder, report)
    error = json.loads((path.parent / "metrics.jsonl").read_text().splitlines()[-1])["validation"]
    say(f"validation MSE {error:.3e} on {len(validation)} shapes that were not trained on", quiet)
    say(f"wrote {path}", quiet)
