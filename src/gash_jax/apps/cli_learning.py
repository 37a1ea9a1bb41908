"""The commands that need a network or a corpus; each imports what it runs: a bake should not wait for it."""

from pathlib import Path

import click

from gash_jax.apps.options import (
    PATH,
    Command,
    json_option,
    output_option,
    quiet_option,
    reference_option,
    result_option,
    up_option,
)


@click.command(cls=Command, epilog="gash predict bunny.ply -o predicted.npz --model local")
@click.argument("mesh", type=PATH)
@output_option
@click.option("--model", default="local", show_default=True, help="Name of shipped weights, or a weights file (.npz).")
@click.option(
    "--ambient", is_flag=True, help="Darken crevices afterwards by geometric ambient occlusion (GNN paper, 4.3.2)."
)
@up_option
@quiet_option
def predict(mesh: Path, output: Path, model: str, ambient: bool, up: str, quiet: bool) -> None:
    """Predict the transfer of MESH with a network: no rays."""
    from gash_jax.apps import learning

    learning.predict(mesh, output, model, ambient, up, quiet)


@click.command(cls=Command, epilog="gash corpus base -o corpus.png")
@click.argument("config", type=PATH)
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--output", type=PATH, help="Contact sheet to draw (.png).")
@quiet_option
def corpus(config: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool) -> None:
    """Make and bake the shapes that CONFIG trains on, in parallel; run it again to continue after an interruption."""
    from gash_jax.apps.pictures import corpus_sheet

    corpus_sheet.corpus(config, overrides, output, quiet)


@click.command(cls=Command, epilog="gash train experiments/demo/local.toml train.seconds=60 -o runs/local")
@click.argument("config", type=PATH)
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Run folder.  [default: runs/NAME]")
@quiet_option
def train(config: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool) -> None:
    """Train the network that CONFIG (.toml) describes; run it again to continue after an interruption."""
    from gash_jax.apps import learning

    learning.train(config, overrides, output, quiet)


@click.command(cls=Command, epilog="gash sweep experiments/latent_depth/sweep.toml -o runs/latent_depth --jobs 2")
@click.argument("sweep_file", metavar="SWEEP", type=PATH)
@click.option("-o", "--output", required=True, type=PATH, help="Folder of the results; runs are kept in it.")
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True, help="Runs at a time, each on its cores.")
@quiet_option
def sweep(sweep_file: Path, output: Path, jobs: int, quiet: bool) -> None:
    """Train every combination that SWEEP (.toml) names; results as JSON lines, CSV, plot. Run again to continue."""
    from gash_jax.apps import sweeping

    sweeping.sweep(sweep_file, output, jobs, quiet)


@click.command(cls=Command, epilog="gash export runs/two-stage -o two-stage.npz")
@click.argument("run", type=PATH)
@output_option
@quiet_option
def export(run: Path, output: Path, quiet: bool) -> None:
    """Write the best weights of RUN, finished or not, as one npz that any runtime can read."""
    from gash_jax.apps import learning

    learning.export(run, output, quiet)


@click.command(cls=Command, epilog="gash bench bunny.ply --model local -o bench.json")
@click.argument("mesh", type=PATH)
@click.option("--model", "models", multiple=True, help="Shipped name or weights file; may be given several times.")
@reference_option
@up_option
@result_option
@json_option
@quiet_option
def bench(
    mesh: Path, models: tuple[str, ...], rays: int, up: str, output: Path | None, as_json: bool, quiet: bool
) -> None:
    """Speed against error on MESH: closed form, plain bakes, networks."""
    from gash_jax.apps import evaluating

    evaluating.bench(mesh, models or ("local",), rays, up, output, as_json, quiet)


@click.command(cls=Command, epilog="gash evaluate runs/two-stage bunny.ply spot.ply -o scores.json")
@click.argument("run", type=PATH)
@click.argument("meshes", nargs=-1, required=True, type=PATH, metavar="MESH...")
@reference_option
@up_option
@result_option
@json_option
@quiet_option
def evaluate(
    run: Path, meshes: tuple[Path, ...], rays: int, up: str, output: Path | None, as_json: bool, quiet: bool
) -> None:
    """Hold the model of RUN (or a weights file) against reference bakes of every MESH."""
    from gash_jax.apps import evaluating

    evaluating.evaluate(run, meshes, rays, up, output, as_json, quiet)


@click.command(cls=Command, epilog="gash demo -o demo --mesh bunny.ply --light studio.hdr")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("demo"),
    show_default=True,
    help="Folder to write.",
)
@click.option("--mesh", type=PATH, help="Mesh to predict.  [default: one that the project generates]")
@click.option("--light", "light_path", type=PATH, help="Environment map (.hdr, .exr).  [default: a generated studio]")
@click.option(
    "--train",
    "seconds",
    type=click.FloatRange(1.0, 3600.0),
    help="Train small networks first, two of them for so many seconds each.  [default: the weights that ship]",
)
@quiet_option
def demo(output: Path, mesh: Path | None, light_path: Path | None, seconds: float | None, quiet: bool) -> None:
    """Bake a mesh, predict it, relight it: a table of speed against error, and a picture."""
    from gash_jax.apps.demo import run_demo

    run_demo(output, mesh, light_path, seconds, quiet)
