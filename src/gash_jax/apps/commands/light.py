"""`gash light`: an environment map as spherical harmonics."""

from pathlib import Path

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, bands_option, output_option, quiet_option
from gash_jax.apps.printing import say
from gash_jax.files.atomic import check_writable
from gash_jax.light.environment import load_light, save_light


@click.command(cls=Command, epilog="gash light studio.hdr -o studio.npz --bands 3")
@click.argument("map", type=PATH)
@output_option
@bands_option()
@quiet_option
def light(map: Path, output: Path, bands: int, quiet: bool) -> None:
    """Project an equirectangular environment map (.hdr, .exr) to spherical harmonics."""
    check_writable(output)
    projected = load_light(map, bands)
    save_light(output, projected)
    say("coefficient      red      green       blue", quiet)
    for index, rgb in enumerate(np.asarray(projected.coefficients)):
        say(f"  {index:3d}     " + " ".join(f"{value:10.5f}" for value in rgb), quiet)
    say(f"wrote {output}", quiet)
