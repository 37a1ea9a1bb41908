"""The bake of an animation: the plain bake of every frame, of all vertices or of some of them.

The faces stay, so what a frame costs beyond its rays is its normals, its lifts and Embree's tree; programs are compiled
for the first frame alone. Normals of the rest are carried along (`geometry.carried_normals`).
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from gash_jax.algebra.arguments import shown
from gash_jax.geometry.animation import Animation, part_of
from gash_jax.geometry.carried_normals import carried_normals, posed_mesh
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.prt.bake import bake_transfer

RESTS = ("drop", "occlude")


class MovingScene(NamedTuple):
    """What moves and casts shadow, and which of its vertices get coefficients."""

    animation: Animation
    rows: slice

    @property
    def receivers(self) -> Animation:
        """The part that gets coefficients, by itself."""
        return part_of(self.animation, self.rows.start, self.rows.stop)


def moving_scene(animation: Animation, vertices: str = "", rest: str = "drop") -> MovingScene:
    """The vertices "first:last" of an animation, last not included; "" stands for all.

    `rest` says what the others do: "drop" leaves them out, "occlude" lets them cast shadow without coefficients of
    their own. Raises MeshError for what is no range of its vertices.
    """
    count = len(animation.mesh.vertices)
    if not vertices:
        return MovingScene(animation, slice(0, count))
    parts = vertices.split(":")
    numbers = [int(text) for text in parts if text.strip().isdecimal()]
    if len(parts) != 2 or len(numbers) != 2 or not 0 <= numbers[0] < numbers[1] <= count:
        raise MeshError(
            f"vertices {shown(vertices)} are no part of a mesh of {count}: give the first and the one after the last, "
            f"such as 0:{count}"
        )
    first, last = numbers
    if rest == "drop":
        return MovingScene(part_of(animation, first, last, alone=True), slice(0, last - first))
    return MovingScene(animation, slice(first, last))


def posed_meshes(animation: Animation, first: int = 0, last: int | None = None) -> Iterator[Mesh]:
    """Frames first .. last as meshes, normals carried along from the rest."""
    mesh = animation.mesh
    carried = carried_normals(mesh, mesh.faces)
    for row in animation.parameters[first:last]:
        yield posed_mesh(animation.motion(row), mesh.faces, carried)


def bake_pose(mesh: Mesh, rows: slice, bands: int, rays: int, seed: int) -> Float[np.ndarray, "v k"]:
    """Coefficients of some vertices of a frame by the plain bake."""
    return bake_frame(mesh, rows, bands, rays, seed)["coefficients"]


def bake_frame(
    mesh: Mesh, rows: slice, bands: int, rays: int, seed: int, glossy: bool = False
) -> dict[str, Float[np.ndarray, "v _"]]:
    """`coefficients` of some vertices of a frame by the plain bake, and of a glossy one their `visibility`."""
    some = None if rows == slice(0, len(mesh.vertices)) else rows
    found = bake_transfer(mesh, bands, rays, replicates=1, seed=seed, rows=some, glossy=glossy)
    return {name: np.asarray(getattr(found, name)) for name in ("coefficients", *(("visibility",) if glossy else ()))}
