"""`gash`: the command line. A command's options and work stand in its file of `commands`, imported when it is called.

Every failure a user can cause is one line on the error stream that starts with "error:" and says what to do, exit
code 2, and nothing is written.
"""

import sys
from importlib import import_module

import click

from gash_jax.files.caches import keep_compiled_programs, quiet_compiler

# what `gash --help` says of each command, in the command's own words; the file is commands/NAME.py
COMMANDS = {
    "animate": "Write the transfer of every frame of ANIMATION: baked, or by a model of the object that deforms.",
    "bake": "Bake shadowed transfer of MESH with Embree, with an error bar for every coefficient.",
    "bench": "Speed against error on MESH: closed form, plain bakes, networks.",
    "compare": "Measure TRANSFER against REFERENCE (same mesh, same bands): relrmse, skill, equivalent rays and more.",
    "convert": "Write a light or a transfer the way another program reads it, and back: numbers, or a .glb file.",
    "corpus": "Make and bake the shapes that CONFIG trains on, in parallel; run it again to continue after an "
    "interruption.",
    "demo": "Bake a mesh, predict it, relight it: a table of speed against error, a picture, and a page to turn it on.",
    "evaluate": "Hold the model of RUN (or a weights file) against reference bakes of every MESH.",
    "export": "Write the best weights of RUN, finished or not, for other runtimes: as .npz, or as .onnx with the "
    "network.",
    "info": "Say what FILE holds: a mesh with its health, an animation, a map, a config, an ONNX file, what gash "
    "wrote.",
    "light": "Project an environment map (.hdr, .exr), or a light by name, to spherical harmonics.",
    "plan": "Say what baking MESH needs: bands, rays, seconds and bytes, from a few pilot rays.",
    "predict": "Predict the transfer of MESH with a network: no rays.",
    "render": "Relight TRANSFER and write a picture (.png, .jpg) of several views.",
    "serve": "Answer meshes with their transfer over HTTP, by a network; meshes that deform send positions only.",
    "sweep": "Train every combination that SWEEP (.toml) names; results as JSON lines, CSV, plot. Run again to "
    "continue.",
    "train": "Train the network that CONFIG (.toml, or a shipped name) describes.",
    "view": "Write a page that shows transfer under light: turn both, compare results, see errors. FILE is a transfer "
    "(.npz), the transfer of an animation's frames (.npz), or a mesh, which is baked and predicted first; several "
    "FILEs are results for one mesh.",
}


def load_command(name: str) -> click.Command:
    """The command itself, from its file."""
    return getattr(import_module(f"gash_jax.apps.commands.{name}"), name)


class Listing(click.Group):
    """A group that lists its commands from the table and imports only the one that is called."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click does it, but with the command in place of its entry in the list."""
        name, entry, rest = super().resolve_command(ctx, args)
        return name, entry if name is None else load_command(name), rest


@click.group(
    cls=Listing,
    commands=[click.Command(name, help=text) for name, text in COMMANDS.items()],
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="gash-jax", prog_name="gash")
def gash() -> None:
    """Precomputed radiance transfer you can trust: bake it, predict it, compare, relight, render.

    \b
      gash bake bunny.ply -o bunny.npz
      gash render bunny.npz --light studio.hdr -o bunny.png
    """


def main() -> None:
    """Entry point: run a command and turn every failure into one line."""
    try:
        quiet_compiler()  # a user reads our errors, not its messages
        keep_compiled_programs()
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
