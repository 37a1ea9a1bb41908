"""`gash`: the command line. One short function a command; the work is done by the modules they call.

Every failure a user can cause is one line on the error stream that starts with "error:" and says what to do, exit
code 2, and nothing is written. Commands that need a network import it themselves: a bake should not wait for it.
"""

import json
import os
import sys
from pathlib import Path

# a user reads our errors, not the libraries' start-up messages
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")

import click

from gash_jax.apps import baking, commands
from gash_jax.apps.render import VIEWS

PATH = click.Path(path_type=Path)


class Command(click.Command):
    """A command whose help ends with an example, printed as it is to be typed."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the example without re-wrapping it."""
        if self.epilog:
            formatter.write(f"\nExample:\n  {self.epilog}\n")


def bands_option(default: int = 3):
    """--bands, the same everywhere."""
    return click.option(
        "--bands",
        type=click.IntRange(1, 10),
        default=default,
        show_default=True,
        help="SH bands B; B*B coefficients.",
    )


quiet_option = click.option("--quiet", is_flag=True, help="No progress bar, no summary.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON for programs.")
up_option = click.option(
    "--up",
    type=click.Choice(["x", "y", "z"]),
    default="y",
    show_default=True,
    help="Axis that points up in the file.",
)


def light_option(text: str):
    """--light where it may be left out."""
    return click.option("--light", "light_path", type=PATH, help=text)


output_option = click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="File to write.")


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="gash-jax", prog_name="gash")
def gash() -> None:
    """Precomputed radiance transfer you can trust: bake it, predict it, compare, relight, render.

    \b
      gash bake bunny.ply -o bunny.npz
      gash render bunny.npz --light studio.hdr -o bunny.png
    """


@gash.command(cls=Command, epilog="gash bake bunny.ply -o bunny.npz --error 0.02")
@click.argument("mesh", type=PATH)
@output_option
@bands_option()
@click.option("--rays", type=click.IntRange(1, 1 << 20), help="Rays per vertex.  [default: 256]")
@click.option("--error", type=float, help="Relative error to reach, 0.001 to 1; rays go where they are needed.")
@click.option("--auto", is_flag=True, help="Plan first, then follow the plan (--error 0.02 unless given).")
@light_option("With --auto: the light whose irradiance decides the bands (.hdr, .exr, .npz).")
@click.option(
    "--replicates",
    type=click.IntRange(1),
    help="Independent point sets the rays are split into for the standard error.  [default: 4; 1 below 16 rays]",
)
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the rays.")
@up_option
@quiet_option
def bake(
    mesh: Path,
    output: Path,
    bands: int,
    rays: int | None,
    error: float | None,
    auto: bool,
    light_path: Path | None,
    replicates: int | None,
    seed: int,
    up: str,
    quiet: bool,
) -> None:
    """Bake shadowed transfer of MESH with Embree, with a standard error for every coefficient."""
    if light_path and not auto:
        raise click.UsageError("--light decides the bands of a planned bake: add --auto")
    if error is None and not auto:
        baking.bake(mesh, output, bands, 256 if rays is None else rays, replicates, seed, up, quiet)
        return
    if rays is not None or replicates is not None:
        raise click.UsageError("--rays and --replicates do not go with --error or --auto: choose one way")
    baking.bake_error(mesh, output, bands, 0.02 if error is None else error, auto, light_path, seed, up, quiet)


@gash.command(cls=Command, epilog="gash plan bunny.ply --light studio.hdr --error 0.02")
@click.argument("mesh", type=PATH)
@light_option("Light whose irradiance decides the bands (.hdr, .exr, .npz).")
@click.option("--error", type=float, default=0.02, show_default=True, help="Relative error to reach, 0.001 to 1.")
@bands_option()
@up_option
@json_option
def plan(mesh: Path, light_path: Path | None, error: float, bands: int, up: str, as_json: bool) -> None:
    """Say what baking MESH needs: bands, rays, seconds and bytes, from a few pilot rays."""
    values = baking.plan(mesh, light_path, error, bands, up)
    click.echo(json.dumps(values) if as_json else baking.plan_text(values))


@gash.command(cls=Command, epilog="gash predict bunny.ply -o predicted.npz --model local")
@click.argument("mesh", type=PATH)
@output_option
@click.option("--model", default="local", show_default=True, help="Name of shipped weights, or a weights file (.npz).")
@up_option
@quiet_option
def predict(mesh: Path, output: Path, model: str, up: str, quiet: bool) -> None:
    """Predict the transfer of MESH with a network: no rays."""
    from gash_jax.apps import learning

    learning.predict(mesh, output, model, up, quiet)


@gash.command(cls=Command, epilog="gash compare predicted.npz reference.npz --json")
@click.argument("transfer", type=PATH)
@click.argument("reference", type=PATH)
@json_option
@quiet_option
def compare(transfer: Path, reference: Path, as_json: bool, quiet: bool) -> None:
    """Measure TRANSFER against REFERENCE (same mesh, same bands): relrmse, skill, equivalent rays and more."""
    values = commands.compare(transfer, reference, quiet)
    click.echo(json.dumps(values) if as_json else commands.comparison_text(values))


@gash.command(cls=Command, epilog="gash light studio.hdr -o studio.npz --bands 3")
@click.argument("map", type=PATH)
@output_option
@bands_option()
@quiet_option
def light(map: Path, output: Path, bands: int, quiet: bool) -> None:
    """Project an equirectangular environment map (.hdr, .exr) to spherical harmonics."""
    commands.light(map, output, bands, quiet)


@gash.command(cls=Command, epilog="gash render bunny.npz --light studio.hdr -o bunny.png --view front --view back")
@click.argument("transfer", type=PATH)
@click.option("--light", "light_path", required=True, type=PATH, help="Environment map (.hdr, .exr) or light (.npz).")
@output_option
@click.option(
    "--view",
    "views",
    multiple=True,
    type=click.Choice(list(VIEWS)),
    default=("front", "side", "back"),
    show_default=True,
    help="Camera; may be given several times.",
)
@click.option("--size", type=click.IntRange(16, 4096), default=512, show_default=True, help="Pixels per view.")
@quiet_option
def render(transfer: Path, light_path: Path, output: Path, views: tuple[str, ...], size: int, quiet: bool) -> None:
    """Relight TRANSFER and write a PNG of several views."""
    commands.render(transfer, light_path, output, views, size, quiet)


@gash.command(cls=Command, epilog="gash train experiments/demo/local.toml train.seconds=60 -o runs/local")
@click.argument("config", type=PATH)
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Run folder.  [default: runs/NAME]")
@quiet_option
def train(config: Path, overrides: tuple[str, ...], output: Path | None, quiet: bool) -> None:
    """Train the network that CONFIG (.toml) describes; run it again to continue after an interruption."""
    from gash_jax.apps import learning

    learning.train(config, overrides, output, quiet)


@gash.command(cls=Command, epilog="gash info bunny.npz")
@click.argument("file", type=PATH)
@json_option
def info(file: Path, as_json: bool) -> None:
    """Say what FILE (mesh, transfer, light or model) holds; a mesh gets its health report."""
    values = commands.info(file)
    click.echo(json.dumps(values) if as_json else commands.info_text(values))


@gash.command(cls=Command, epilog="gash demo -o demo --mesh bunny.ply --light studio.hdr")
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
    "--seconds",
    type=click.FloatRange(1.0, 3600.0),
    default=80.0,
    show_default=True,
    help="Training time for each of the two graph networks.",
)
@quiet_option
def demo(output: Path, mesh: Path | None, light_path: Path | None, seconds: float, quiet: bool) -> None:
    """From nothing to a relit prediction: corpus, training, bake, prediction, table and picture."""
    from gash_jax.apps.demo import run_demo

    run_demo(output, mesh, light_path, seconds, quiet)


def main() -> None:
    """Entry point: run a command and turn every failure into one line."""
    try:
        gash.main(standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.ctx.get_help() if error.ctx else error.format_message())
        sys.exit(2)
    except (click.Abort, KeyboardInterrupt):
        click.echo("error: interrupted; no half-written file was left", err=True)
        sys.exit(130)
    except click.ClickException as error:
        hint = f" (see `{error.ctx.command_path} --help`)" if isinstance(error, click.UsageError) and error.ctx else ""
        _fail(f"{error.format_message()}{hint}")
    except BrokenPipeError:
        sys.exit(1)
    except (ValueError, OSError, MemoryError) as error:
        _fail(str(error) or type(error).__name__)


def _fail(message: str) -> None:
    click.echo(f"error: {' '.join(message.split())}", err=True)
    sys.exit(2)
