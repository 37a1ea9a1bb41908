"""What is hard about light that bounces: walls that send back nothing or everything, no light, no normal at all."""

import numpy as np

from experiments.hard_cases.directions import SILENT
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.shading import shade
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import icosphere

UNIT = 2 * np.sqrt(np.pi)  # t_00 times this is what constant light of radiance 1 brings


def _bowl() -> Mesh:
    """The inside of a ball without its upper third."""
    ball = icosphere(2)
    kept = ball.faces[np.all(ball.vertices[ball.faces][..., 1] < 0.4, axis=1)]
    return ball._replace(normals=-ball.normals, faces=kept[:, ::-1].copy())


def black_walls() -> tuple[float, str]:
    """Albedo 0 against a direct bake of the same rays."""
    direct, bounced = (bake_transfer(_bowl(), rays=64, **more) for more in ({}, {"bounces": 8, "albedo": 0.0}))
    return float(np.abs(direct.coefficients - bounced.coefficients).max()), SILENT


def white_walls() -> tuple[float, str]:
    """What constant light of radiance 1 brings beyond 1 after 50 bounces off walls of albedo 1."""
    baked = bake_transfer(_bowl(), rays=64, replicates=1, bounces=50, albedo=1.0)
    return float(max(0.0, UNIT * baked.coefficients[:, 0].max() - 1)), SILENT


def black_light() -> tuple[float, str]:
    """Radiance without any light."""
    return float(np.abs(shade(bake_transfer(_bowl(), rays=64, bounces=3, albedo=0.9), np.zeros((9, 3)))).max()), SILENT


def no_normals() -> tuple[float, str]:
    """Transfer of a mesh none of whose vertices has a normal."""
    bowl = _bowl()
    baked = bake_transfer(bowl._replace(normals=0 * bowl.normals), rays=64, bounces=2, albedo=0.5)
    return float(np.abs(baked.coefficients).max()), SILENT


def brighter_than_white() -> object:
    """A wall that sends back more than it gets."""
    return bake_transfer(_bowl(), rays=64, bounces=1, albedo=1.2)
