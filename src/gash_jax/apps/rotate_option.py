"""--rotate of the commands that have a light; apart from the other options, as it needs JAX, which takes a second."""

from typing import Any

import click
import numpy as np

from gash_jax.algebra.rotations import rotation_matrix


class Turn(click.ParamType):
    """Degrees about +y, or a quaternion w,x,y,z, as a rotation matrix (3, 3)."""

    name = "DEGREES | W,X,Y,Z"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> np.ndarray:
        """Refuse what is neither one nor four finite numbers, and quaternions that are not of length 1."""
        try:
            numbers = np.array([float(number) for number in value.split(",")])
        except ValueError:
            numbers = np.full(0, np.nan)
        if numbers.shape not in ((1,), (4,)) or not np.isfinite(numbers).all():
            self.fail(f"{value!r} is no rotation: give degrees about +y, as in 90, or a quaternion w,x,y,z", param, ctx)
        if numbers.size == 1:
            half = np.radians(numbers[0] / 2.0)
            numbers = np.array([np.cos(half), 0.0, np.sin(half), 0.0])
        try:
            return np.asarray(rotation_matrix(numbers))
        except ValueError as error:
            self.fail(str(error), param, ctx)


rotate_option = click.option(
    "--rotate",
    "turn",
    type=Turn(),
    help="Turn the light, not the mesh: degrees about +y, counter-clockwise from above, or a unit quaternion.",
)
