"""A mesh that moves: its rest, what makes a frame of a row of numbers, and a row for each frame.

Two kinds of motion, both of float32 positions (v, 3) in the units of the mesh:

* `Blend`: shapes and bones. v' = sum_b w_vb T_b [rest_v + sum_k a_k delta_kv; 1]. A row holds the weights a of the K
  shapes, then the 12 numbers of each bone's matrix T (3, 4), row by row. With no bones it is blendshapes, with no
  shapes linear blend skinning. The rest is the pose of weights 0 and identity matrices.
* `Recorded`: frames as they are, kept in memory or read from the file when asked for; a row holds the frame's number.

A frame is made when it is asked for, so an animation may be larger than memory.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Num

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.geometry.mesh import Mesh, MeshError, angle_weighted_normals, referenced_by

_ROUNDED = 1e-2  # weights of bones may be stored in 8 bits


class Blend(NamedTuple):
    """Shapes and bones (module docstring)."""

    rest: Float[np.ndarray, "v 3"]
    deltas: Float[np.ndarray, "k v 3"]
    weights: Float[np.ndarray, "v b"]  # each row sums to 1; no columns where there are no bones

    def __call__(self, row: Float[np.ndarray, "p"]) -> Float[np.ndarray, "v 3"]:
        """Positions of a row of parameters, float32."""
        shapes, bones = len(self.deltas), self.weights.shape[1]
        active = np.flatnonzero(row[:shapes])
        points = self.rest.astype(np.float64)
        if len(active):
            points = points + np.tensordot(row[active].astype(np.float64), self.deltas[active], axes=1)
        if bones:
            matrices = (self.weights @ row[shapes:].astype(np.float64).reshape(bones, 12)).reshape(-1, 3, 4)
            points = np.einsum("vij,vj->vi", matrices[..., :3], points) + matrices[..., 3]
        return points.astype(np.float32)

    def reach(self, rows: Float[np.ndarray, "t p"]) -> Float[np.ndarray, "t"]:
        """A bound of all coordinates in each frame, without making it."""
        shapes, bones = len(self.deltas), self.weights.shape[1]
        wide = np.abs(rows.astype(np.float64))
        bound = np.abs(self.rest).max() + wide[:, :shapes] @ np.abs(self.deltas).max(axis=(1, 2), initial=0)
        if not bones:
            return bound
        matrices = wide[:, shapes:].reshape(len(rows), bones, 3, 4)
        return (matrices[..., :3].sum(axis=-1) * bound[:, None, None] + matrices[..., 3]).max(axis=(1, 2))


class Recorded(NamedTuple):
    """Frames as they are (module docstring)."""

    frames: Num[np.ndarray, "t v 3"]  # may be a memory map
    turn: Float[np.ndarray, "3 3"] | None = None  # that puts the file's up axis to +y

    def __call__(self, row: Float[np.ndarray, "p"]) -> Float[np.ndarray, "v 3"]:
        """Positions of the frame whose number the row holds."""
        points = np.asarray(self.frames[int(row[0])], np.float64)
        return (points if self.turn is None else points @ self.turn.T).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Animation:
    """A mesh in its rest pose, a row of parameters for each frame, and what makes positions of a row.

    `_replace(parameters=...)` gives other poses of the same motion: rows of random weights, say.

    >>> rest, corners = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]])
    >>> np.savez("moves.npz", base=rest, delta=np.ones((1, 3, 3), np.float32), names=np.array(["up"]), faces=corners)
    >>> animation = gash_jax.load_animation("moves.npz")
    >>> len(animation), animation.names, animation.frame(1)[0].tolist()
    (2, ('up',), [2.0, 1.0, 1.0])
    """

    mesh: Mesh
    parameters: Float[np.ndarray, "t p"]
    names: tuple[str, ...]  # of the shapes, then of the bones; ("frame",) where frames are recorded
    motion: Blend | Recorded
    seconds: Float[np.ndarray, "t"] | None = None  # of each frame, where the file says it
    notes: tuple[str, ...] = ()  # what reading had to decide

    def __len__(self) -> int:
        return len(self.parameters)

    def _replace(self, **changes: Any) -> "Animation":
        """A copy with some fields changed."""
        return replace(self, **changes)

    def frame(self, number: WholeNumber) -> Float[np.ndarray, "v 3"]:
        """Positions of a frame, float32. Raises ValueError for a number that no frame has."""
        return self.motion(self.parameters[whole_number(number, "frame", 0, len(self) - 1)])

    def frames(self) -> Iterator[Float[np.ndarray, "v 3"]]:
        """Positions of all frames, one after the other."""
        return (self.motion(row) for row in self.parameters)

    @property
    def shape_weights(self) -> Float[np.ndarray, "t k"]:
        """Weights of the shapes in every frame; no columns where there are none."""
        return self.parameters[:, : len(self.motion.deltas) if isinstance(self.motion, Blend) else 0]

    @property
    def transforms(self) -> Float[np.ndarray, "t b 3 4"]:
        """Matrices of the bones in every frame, from the rest pose; none where there are no bones."""
        bones = self.motion.weights.shape[1] if isinstance(self.motion, Blend) else 0
        return self.parameters[:, self.parameters.shape[1] - 12 * bones :].reshape(len(self.parameters), bones, 3, 4)


def part_of(animation: Animation, first: int, last: int, alone: bool = False) -> Animation:
    """The vertices first .. last - 1 of an animation with the faces among them, normals as they are in the whole.

    `alone`: a vertex that has lost a face gets the angle-weighted normal of those that it keeps.
    """
    mesh, motion, rows = animation.mesh, animation.motion, slice(first, last)
    if first == 0 and last == len(mesh.vertices):
        return animation
    inside = ((mesh.faces >= first) & (mesh.faces < last)).all(axis=1)
    part = Mesh(mesh.vertices[rows], mesh.normals[rows].copy(), mesh.faces[inside] - np.int32(first))
    cut = referenced_by(mesh.faces[~inside], len(mesh.vertices))[rows]
    if alone and cut.any():
        part.normals[cut] = angle_weighted_normals(part.vertices, part.faces)[cut]
    if isinstance(motion, Recorded):
        return animation._replace(mesh=part, motion=motion._replace(frames=motion.frames[:, rows]))
    deltas = np.ascontiguousarray(motion.deltas[:, rows])
    return animation._replace(mesh=part, motion=Blend(motion.rest[rows], deltas, motion.weights[rows]))


def blend_rows(weights: Float[np.ndarray, "t k"], transforms: Float[np.ndarray, "t b 3 4"]) -> Float[np.ndarray, "t p"]:
    """Rows of parameters of a `Blend`, float32."""
    rows = [weights, transforms.reshape(len(transforms), 12 * transforms.shape[1])]
    return np.concatenate(rows, axis=1).astype(np.float32)


def unit_weights(weights: np.ndarray) -> tuple[Float[np.ndarray, "v b"], tuple[str, ...]]:
    """Weights of bones, float64, that sum to 1 at each vertex, and what was changed. Raises MeshError."""
    wide = weights.astype(np.float64)
    bad = ~np.isfinite(wide).all(axis=1) | (wide < 0).any(axis=1) | (wide.sum(axis=1) <= 0)
    if bad.any():
        raise MeshError(
            f"{bad.sum()} vertices have no usable weights of bones (first: {np.argmax(bad)}, "
            f"sum {wide[np.argmax(bad)].sum():.3g}): bind them to a bone, with weights of 0 or more"
        )
    total = wide.sum(axis=1)
    off = np.abs(total - 1) > _ROUNDED
    note = (
        f"weights of bones of {off.sum()} vertices sum to something else than 1 (first: {np.argmax(off)}, "
        f"{total[np.argmax(off)]:.3g}): divided by their sum"
    )
    return wide / total[:, None], (note,) if off.any() else ()
