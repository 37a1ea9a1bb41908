"""`gash light`: an environment map, or a light from code, as spherical harmonics."""

from pathlib import Path

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, bands_option, layout_option, output_option, quiet_option
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.rotate_option import rotate_option
from gash_jax.files.atomic import check_writable
from gash_jax.light.environment import load_light, rotate_light, save_light
from gash_jax.light.windows import DIP, least_share

EVEN = 0.05  # share of the mean up to which a light comes from everywhere alike
FLOOR = -10.0  # degrees of elevation below which one asks whether the map is upside down


@click.command(cls=Command, epilog="gash light sun-sky:elevation=30,turbidity=2.5 -o sunny.npz")
@click.argument("source", type=PATH)
@output_option
@bands_option()
@layout_option
@rotate_option
@quiet_option
def light(source: Path, output: Path, bands: int, layout: str | None, turn: np.ndarray | None, quiet: bool) -> None:
    """Project an environment map (.hdr, .exr), or a light by name, to spherical harmonics.

    \b
    Names, with what may follow a colon (commas between; vectors and colours are three numbers):
      constant:radiance=1
      directional:direction=1,2,0.5,irradiance=3.14
      sphere:position=0,4,3,radius=1,radiance=10
      sun-sky:elevation=45,azimuth=0,turbidity=3,ground=0.2,sun=1
      studio
    """
    check_writable(output, [source])
    with progress_bar(f"projecting {source.name}", quiet) as update:
        projected = load_light(source, bands, layout, update)
    if turn is not None:
        projected = rotate_light(projected, turn)
    save_light(output, projected)
    for note in projected.metadata.get("notes", []):
        say(f"  {note}", quiet)
    say("coefficient      red      green       blue", quiet)
    for index, rgb in enumerate(np.asarray(projected.coefficients)):
        say(f"  {index:3d}     " + " ".join(f"{value:10.5f}" for value in rgb), quiet)
    for line in _found(np.asarray(projected.coefficients, np.float64)):
        say(line, quiet)
    say(f"wrote {output}", quiet)


def _found(coefficients: np.ndarray) -> list[str]:
    """Where most of a light comes from, and whether its few bands are negative anywhere."""
    if not coefficients.any():
        return ["the light is black"]
    lines = []
    toward = coefficients[[3, 1, 2]].sum(axis=1) if len(coefficients) > 1 else np.zeros(3)
    length = float(np.linalg.norm(toward))
    if length > EVEN * coefficients[0].sum():
        x, y, z = toward / length
        azimuth, elevation = np.degrees([np.arctan2(x, z), np.arcsin(np.clip(y, -1.0, 1.0))])
        below = ": flip the rows of the map if it is upside down" if elevation < FLOOR else ""
        lines.append(
            f"most light comes from ({x:z.2f}, {y:z.2f}, {z:z.2f}), azimuth {azimuth:z.0f} degrees from +z towards +x, "
            f"{abs(elevation):.0f} degrees {'below' if elevation < 0 else 'above'} the horizon{below}"
        )
    least = least_share(coefficients)
    if least == -np.inf:
        lines.append("its mean is negative in a colour: project the map again")
    elif least < -DIP:
        lines.append(
            f"its {round(len(coefficients) ** 0.5)} bands ring, down to {least:.2f} times the mean in a direction: "
            "gash render --window radiance damps that"
        )
    return lines
