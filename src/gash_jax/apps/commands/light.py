"""`gash light`: an environment map as spherical harmonics."""

from pathlib import Path

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, bands_option, layout_option, output_option, quiet_option
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.rotate_option import rotate_option
from gash_jax.files.atomic import check_writable
from gash_jax.light.environment import load_light, rotate_light, save_light


@click.command(cls=Command, epilog="gash light studio.hdr -o studio.npz --bands 3")
@click.argument("map", type=PATH)
@output_option
@bands_option()
@layout_option
@rotate_option
@quiet_option
def light(map: Path, output: Path, bands: int, layout: str | None, turn: np.ndarray | None, quiet: bool) -> None:
    """Project an environment map (.hdr, .exr) to spherical harmonics."""
    check_writable(output, [map])
    with progress_bar(f"projecting {map.name}", quiet) as update:
        projected = load_light(map, bands, layout, update)
    if turn is not None:
        projected = rotate_light(projected, turn)
    save_light(output, projected)
    for note in projected.metadata.get("notes", []):
        say(f"  {note}", quiet)
    say("coefficient      red      green       blue", quiet)
    for index, rgb in enumerate(np.asarray(projected.coefficients)):
        say(f"  {index:3d}     " + " ".join(f"{value:10.5f}" for value in rgb), quiet)
    say(f"wrote {output}", quiet)
