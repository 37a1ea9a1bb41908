"""Options that several commands share, and the command class that ends its help with an example."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from gash_jax.light.layouts import LAYOUTS

RESTS = ("drop", "occlude")  # prt.sequence

PATH = click.Path(path_type=Path)
LIGHT_HELP = "Environment map (.hdr, .exr), light (.npz), or a light by name, such as studio or sun-sky:elevation=30."
CommandFunction = TypeVar("CommandFunction", bound=Callable[..., Any])


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


bounces_option = click.option(
    "--bounces", type=click.IntRange(0, 256), default=0, show_default=True, help="How often light may be reflected."
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


vertices_option = click.option(
    "--vertices", default="", metavar="FIRST:LAST", help="Part of the animation to take, the last not included."
)
rest_option = click.option(
    "--rest",
    type=click.Choice(RESTS),
    default=RESTS[0],
    show_default=True,
    help="With --vertices: what the others do, leave or cast shadow.",
)


def light_option(text: str):
    """--light where it may be left out."""
    return click.option("--light", "light_path", type=PATH, help=text)


layout_option = click.option(
    "--layout",
    type=click.Choice(LAYOUTS),
    help="How the map is laid out.  [default: latlong if twice as wide as high, else recognised or refused]",
)


def check_layout(layout: str | None, light_path: Path | None) -> None:
    """Refuse a layout without a map that has it."""
    if layout and not light_path:
        raise click.UsageError("--layout says how the map of --light is laid out: give one, or leave it out")


overrides_argument = click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
output_option = click.option("-o", "--output", required=True, type=PATH, help="File to write.")


def measuring_options(command: CommandFunction) -> CommandFunction:
    """--rays of the reference, --up, -o, --json, --quiet: of a command that measures methods on meshes."""
    reference = click.option(
        "--rays",
        type=click.IntRange(64, 1 << 20),
        default=4096,
        show_default=True,
        help="Rays per vertex of the reference.",
    )
    results = click.option("-o", "--output", type=PATH, help="Results to write (.json).")
    return reference(up_option(results(json_option(quiet_option(command)))))
