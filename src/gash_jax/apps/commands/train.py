"""`gash train`: a run of a config, from where it was left off."""

from pathlib import Path

import click

from gash_jax.apps.options import PATH, Command, quiet_option
from gash_jax.apps.pictures.plots import plot_curves
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.train.config import load_config
from gash_jax.train.logs import read_lines
from gash_jax.train.run import run_config

CURVES = "curves.png"


@click.command(cls=Command, epilog="gash train experiments/demo/local.toml train.seconds=60 -o runs/local")
@click.argument("config", type=PATH)
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Run folder.  [default: runs/NAME]")
@quiet_option
def train(config: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool) -> None:
    """Train the network that CONFIG (.toml) describes; run it again to continue after an interruption."""
    run = load_config(config, overrides)
    folder = output or Path("runs") / run.name
    with progress_bar("corpus", quiet) as corpus, progress_bar(f"training {run.name}", quiet) as update:

        def report(phase: str, fraction: float, measures: dict[str, float]) -> None:
            update(round(1000 * fraction), 1000)

        path, validation = run_config(run, folder, corpus, report)
    plot_curves(folder, folder / CURVES)
    last = read_lines(folder)[-1]
    say(f"{len(validation)} validation shapes: skill {last['skill']:.3f}, relrmse {last['relrmse']:.4f}", quiet)
    say(f"wrote {path} and {folder / CURVES}", quiet)
