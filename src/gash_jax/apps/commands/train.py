"""`gash train`: a run of a config, from where it was left off."""

from dataclasses import fields
from pathlib import Path

import click

from gash_jax.apps.options import PATH, Command, overrides_argument, quiet_option
from gash_jax.apps.pictures.plots import plot_curves
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.files.settings import allowed_values
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.families import FAMILIES
from gash_jax.train.config import DataConfig, OptimConfig, RunConfig, TrainConfig, load_config, shipped_configs
from gash_jax.train.deforming_run import SCORES, run_deforming
from gash_jax.train.logs import CLOCKS, read_lines
from gash_jax.train.run import run_config

CURVES = "curves.png"


class TrainCommand(Command):
    """A command whose help also lists the configs that ship and what a config can say."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The example, the configs, the settings of every table."""
        super().format_epilog(ctx, formatter)
        with formatter.section("\nConfigs that ship"):
            formatter.write_dl([(name, _first_comment(path)) for name, path in shipped_configs().items()])
        tables = {"data": DataConfig, "optim": OptimConfig, "train": TrainConfig}
        for name, table in tables.items():
            with formatter.section(f"Settings [{name}]"):
                formatter.write_dl(_settings(name, table))
        for family, entry in [*FAMILIES.items(), *DEFORMING.items()]:
            with formatter.section(f'Settings [model] where model.name="{family}"'):
                formatter.write_dl(_settings("model", entry.config))


def _first_comment(path: Path) -> str:
    return path.read_text(encoding="utf-8").splitlines()[0].removeprefix("#").strip()


def _settings(table: str, config: type) -> list[tuple[str, str]]:
    """(key, meaning, range and default) of every setting of a config."""
    rows = []
    for entry in fields(config):
        if "meaning" in entry.metadata:
            allowed = allowed_values(entry.metadata)
            values = "; ".join([*([allowed] if allowed else []), f"default {entry.default!r}"])
            rows.append((f"{table}.{entry.name}", f"{entry.metadata['meaning']}  [{values}]"))
    return rows


@click.command(cls=TrainCommand, epilog="gash train local train.seconds=60 -o runs/local")
@click.argument("config", type=PATH)
@overrides_argument
@click.option("-o", "--output", type=PATH, help="Run folder.  [default: runs/NAME]")
@quiet_option
def train(config: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool) -> None:
    """Train the network that CONFIG (.toml, or a shipped name) describes.

    Run it again to continue after an interruption, or with a larger budget.
    """
    run = load_config(config, overrides)
    folder = output or Path("runs") / run.name
    if run.model.name in DEFORMING:
        _train_deforming(run, folder, quiet)
        return
    with progress_bar("corpus", quiet) as corpus, progress_bar(f"training {run.name}", quiet) as update:

        def report(phase: str, fraction: float, measures: dict[str, float]) -> None:
            update(round(1000 * fraction), 1000)

        path, validation = run_config(run, folder, corpus, report, lambda note: say(f"  {note}", quiet))
    plot_curves(folder, folder / CURVES)
    lines = read_lines(folder)
    last, steps = lines[-1], {line["phase"]: line["step"] for line in lines}
    if "skill" in last:  # there are shapes to validate on
        say(f"{len(validation)} validation shapes: skill {last['skill']:.3f}, relrmse {last['relrmse']:.4f}", quiet)
    if CLOCKS.keys() <= last.keys():  # older runs were not timed
        wall, cpu = (last[name] for name in CLOCKS)
        say(f"{sum(steps.values())} steps in {wall:.1f} s, {cpu:.1f} CPU seconds", quiet)
    say(f"wrote {path} and {folder / CURVES}", quiet)


def _train_deforming(run: RunConfig, folder: Path, quiet: bool) -> None:
    """Bake the frames of an object that deforms, fit its model, test it."""
    with progress_bar(f"frames of {run.name}", quiet) as update:
        path, scores = run_deforming(run, folder, update)
    measures = ", ".join(f"{name} {scores[name]:.4f}" for name in ("relrmse", "accuracy", "skill") if name in scores)
    say(f"{scores['test_frames']} test frames: {measures}", quiet)
    say(f"fitted in {scores['fit_seconds']['cpu']:.1f} CPU seconds, {scores['bytes'] / 1e6:.2f} MB", quiet)
    say(f"wrote {path} and {folder / SCORES}", quiet)
