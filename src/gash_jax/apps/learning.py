"""Commands that load the neural-network libraries: predict, train, export."""

from pathlib import Path

import jax

from gash_jax.apps.pictures.plots import plot_curves
from gash_jax.apps.progress import progress_bar, say
from gash_jax.files.atomic import check_writable
from gash_jax.formats.meshes import read_mesh
from gash_jax.models.ambient import STRENGTH, ambient_refinement
from gash_jax.models.model import load_model, save_model
from gash_jax.prt.transfer import save_transfer
from gash_jax.train.config import load_config
from gash_jax.train.logs import read_lines
from gash_jax.train.run import best_so_far, run_config

CURVES = "curves.png"


def predict(mesh_path: Path, output: Path, model_name: str, ambient: bool, up: str, quiet: bool) -> None:
    """`gash predict`."""
    check_writable(output)
    model = load_model(model_name)
    mesh, health = read_mesh(mesh_path, up)
    transfer = model.predict(mesh)
    if ambient:
        transfer = transfer._replace(coefficients=ambient_refinement(mesh, transfer.coefficients), predicted_error=None)
        transfer.metadata["parameters"]["ambient"] = STRENGTH
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
    with progress_bar("corpus", quiet) as corpus, progress_bar(f"training {config.name}", quiet) as update:

        def report(phase: str, fraction: float, measures: dict[str, float]) -> None:
            update(round(1000 * fraction), 1000)

        path, validation = run_config(config, folder, corpus, report)
    plot_curves(folder, folder / CURVES)
    last = read_lines(folder)[-1]
    say(f"{len(validation)} validation shapes: skill {last['skill']:.3f}, relrmse {last['relrmse']:.4f}", quiet)
    say(f"wrote {path} and {folder / CURVES}", quiet)


def export(run: Path, output: Path, quiet: bool) -> None:
    """`gash export`: the best parameters of a run, finished or not, as a model file."""
    check_writable(output)
    if (run / "model.npz").is_file():
        model = load_model(run / "model.npz")
        save_model(output, model.config, model.params, **model.metadata)
    else:
        config, params, error = best_so_far(run)
        save_model(output, config.model, params, name=config.name, run=config.to_dict(), validation=error)
    arrays = load_model(output).params
    count = sum(leaf.size for leaf in jax.tree.leaves(arrays))
    say(f"wrote {output}: {count} parameters, format in docs/model_file.md", quiet)
