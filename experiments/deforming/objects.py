"""The objects that models of deforming objects are measured on, each as a file that `gash train` reads.

face     blendshapes (--animation FILE), random sparse expressions
cloth    a generated sheet that falls over a swaying ball; frames between the others are for the test
figure   a generated figure of 6000 vertices with 16 bones in random poses
walk     a skinned figure that walks (--animation FILE); the last frames are for the test
bumps    a generated body with random bumps, small
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gash_jax.shapes.cloth import cloth_animation
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.shapes.rigs import figure_animation

FRAMES, POSES = 500, 1850  # of the generated cloth, and of the figure


class Object(NamedTuple):
    """An object by name."""

    title: str
    poses: str  # what its frames are, for the table
    write: Callable[[Path], None] | None  # None: its file has to be given
    split: str  # data.poses
    follow: bool  # whether its test frames follow one another in time


def _bumps(path: Path) -> None:
    moving = blendshape_animation(bumpy_sphere(8), 0, 2, 8)
    motion: Any = moving.motion
    np.savez(path, base=motion.rest, delta=motion.deltas, faces=moving.mesh.faces, names=np.array(moving.names))


def _cloth(path: Path) -> None:
    moving = cloth_animation(0, FRAMES)
    np.savez(path, verts=np.stack(list(moving.frames())), faces=moving.mesh.faces)


def _figure(path: Path) -> None:
    moving = figure_animation(0, POSES)
    motion: Any = moving.motion
    bones = {"weights": motion.weights, "transforms": moving.transforms, "names": np.array(moving.names)}
    np.savez(path, rest=motion.rest, faces=moving.mesh.faces, **bones)


RANDOM = "random sparse expressions, 1 to 8 shapes at once"
OBJECTS = {
    "face": Object("ICT face", RANDOM, None, "random", False),
    "cloth": Object(
        "Cloth over a ball", "one simulation, tested on frames between the others", _cloth, "between", False
    ),
    "figure": Object("Generated figure", "random poses of 16 bones", _figure, "file", False),
    "walk": Object("CesiumMan", "one walk, its last frames for the test", None, "file", True),
    "bumps": Object("Generated bumps", RANDOM, _bumps, "random", False),
}


def object_file(name: str, animation: Path | None, folder: Path) -> Path:
    """The file of an object: that which was given, or the generated one. Raises ValueError where it has to be given."""
    if animation is not None:
        return animation
    write = OBJECTS[name].write
    if write is None:
        raise ValueError(f"{name} is not generated: give its file with --animation")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.npz"
    write(path)
    return path
