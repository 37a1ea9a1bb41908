"""How the networks over motors end: numbers of a vertex become its transfer in the world.

The papers do not say in which frame the directions of the visibilities and the coefficients are (docs/choices.md). A
config's `frame` says it:

    mixed    visibilities in the frame of the vertex, coefficients in the world's: the network has to learn to rotate
    world    both in the world's: directions over the whole sphere, those below the horizon never visible
    vertex   both in the frame of the vertex: coefficients are turned into the world here

The frame of a vertex is what the rotor of its motor makes of the world's axes: +y becomes the normal. With `residual`
the network says what is to be added to the transfer without shadows. The loss sees coefficients in the world; a
rotation changes no mean square error.

The last layer of these networks starts at 0. From random weights it says numbers ten times as large as a transfer, and
a budget of 200 steps goes into unlearning them.
"""

import math
from dataclasses import dataclass

from jaxtyping import Array, Float

from gash_jax.algebra.closed_forms import unshadowed_transfer, zero_without_normal
from gash_jax.algebra.motors import rotor_to_matrix
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.settings import setting
from gash_jax.nn.config import ModelConfig

FRAMES = ("mixed", "world", "vertex")


@dataclass(frozen=True)
class OutputConfig(ModelConfig):
    """A network that ends in `world_coefficients`."""

    frame: str = setting(
        "mixed",
        "axes of visibilities and coefficients; mixed: the vertex's for one, the world's for the other",
        choices=FRAMES,
    )
    residual: bool = setting(False, "whether the network says what to add to the transfer without shadows")


def world_coefficients(
    said: Float[Array, "v k"], nodes: dict[str, Array], frame: str, residual: bool
) -> Float[Array, "v k"]:
    """Transfer in the world from what a network said of every vertex; exactly 0 where there is no normal.

    `nodes` holds "motor" (v, 32) and "normal" (v, 3).
    """
    if frame == "vertex":
        said = rotate_coefficients(said, rotor_to_matrix(nodes["motor"]))
    if residual:
        said = unshadowed_transfer(nodes["normal"], math.isqrt(said.shape[-1])) + said
    return zero_without_normal(said, nodes["normal"])
