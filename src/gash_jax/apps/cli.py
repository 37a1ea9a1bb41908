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

from gash_jax.apps import baking, cli_learning, commands
from gash_jax.apps.options import (
    PATH,
    Command,
    bands_option,
    json_option,
    light_option,
    output_option,
    quiet_option,
    up_option,
)
from gash_jax.apps.pictures.views import VIEWS


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


@gash.command(cls=Command, epilog="gash info bunny.npz")
@click.argument("file", type=PATH)
@json_option
def info(file: Path, as_json: bool) -> None:
    """Say what FILE (mesh, transfer, light or model) holds; a mesh gets its health report."""
    values = commands.info(file)
    click.echo(json.dumps(values) if as_json else commands.info_text(values))


for command in vars(cli_learning).values():
    if isinstance(command, click.Command):
        gash.add_command(command)


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
