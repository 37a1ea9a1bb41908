"""From the positions of a deforming mesh to the few numbers that say its pose.

A pose is read off a sample of the vertices in faces, spread evenly over the rest: with d their displacement from it,
the pose is the linear map d A. Of blendshapes A is the pseudo-inverse of the shapes, so the pose is their weights,
exactly where the shapes differ on the sample; a shape that no training frame had stays its own number, which is held to
0: read as a mixture of the others it made larger errors. Of all other motions the pose is the leading
principal components of the displacements of the training frames, scaled to a variance of 1; where nothing moves it is a
single 0.

Each number is held to the range that it had in training, widened by a tenth and by what rounding of positions makes of
it: further out a fitted model says nothing that was ever measured.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.geometry.animation import Animation, Blend
from gash_jax.geometry.mesh import Mesh, referenced

SAMPLE = 200  # vertices
COMPONENTS = 32  # of motions that are not blendshapes
SMALLEST = 1e-5  # singular values, relative, that count
MARGIN = 0.1  # of the range of training
ROUNDING = 2.0**-22  # of a coordinate: that of float32 positions and of their differences, several times over


class PoseReader(NamedTuple):
    """The map of the module docstring, of NumPy or JAX arrays; indices are float32, as all arrays of a model file."""

    sample: Float[Any, "s"]
    still: Float[Any, "s 3"]
    matrix: Float[Any, "d p"]  # d = 3 s
    low: Float[Any, "p"]
    high: Float[Any, "p"]


POSE_SHAPES: dict[str, tuple[int | str, ...]] = {
    "pose/sample": ("s",),
    "pose/still": ("s", 3),
    "pose/matrix": ("d", "p"),
    "pose/low": ("p",),
    "pose/high": ("p",),
}


def reader_arrays(reader: PoseReader) -> dict[str, Any]:
    """A reader among the arrays of a model."""
    return dict(zip(POSE_SHAPES, reader, strict=True))


def reader_of(arrays: dict[str, Any]) -> PoseReader:
    """The reader among the arrays of a model."""
    return PoseReader(*(arrays[name] for name in POSE_SHAPES))


def spread_vertices(points: Float[np.ndarray, "v 3"], count: int) -> Int[np.ndarray, "s"]:
    """Vertices far apart, each the farthest from those before it; the first is the farthest from the middle."""
    count, found = min(count, len(points)), []
    apart = ((points - points.mean(axis=0)) ** 2).sum(axis=1)
    for _ in range(count):
        found.append(int(apart.argmax()))
        beside = ((points - points[found[-1]]) ** 2).sum(axis=1)
        apart = beside if len(found) == 1 else np.minimum(apart, beside)
    return np.array(found)


def spread_in_faces(mesh: Mesh, count: int) -> Int[np.ndarray, "s"]:
    """Vertices far apart of those that have a face; of all where none has one."""
    used = np.flatnonzero(referenced(mesh))
    used = used if len(used) else np.arange(len(mesh.vertices))
    return used[spread_vertices(mesh.vertices[used].astype(np.float64), count)]


def fit_reader(animation: Animation) -> tuple[PoseReader, Float[np.ndarray, "t p"]]:
    """The reader of an animation's frames, and their poses."""
    rest, sample = animation.mesh.vertices.astype(np.float64), spread_in_faces(animation.mesh, SAMPLE)
    seen = np.stack([frame[sample] for frame in animation.frames()]).astype(np.float64)
    motion, still = animation.motion, rest[sample]
    if isinstance(motion, Blend) and not motion.weights.shape[1]:
        lift = motion.deltas[:, sample].reshape(len(motion.deltas), -1).astype(np.float64)
        matrix = np.linalg.pinv(lift, rcond=SMALLEST)
    else:
        still = seen[0] + (seen - seen[0]).mean(axis=0)  # exactly seen[0] where nothing moves
        _, sizes, ways = np.linalg.svd((seen - still).reshape(len(seen), -1), full_matrices=False)
        count = max(1, min(COMPONENTS, int((sizes > SMALLEST * sizes[0]).sum())))
        scale = sizes[:count] / np.sqrt(len(seen))
        matrix = (ways[:count] / np.where(scale > 0, scale, np.inf)[:, None]).T
    poses = (seen - still).reshape(len(seen), -1) @ matrix
    low, high = poses.min(axis=0), poses.max(axis=0)
    rounding = ROUNDING * np.linalg.norm(still.reshape(-1, 1) * matrix, axis=0)
    room = np.maximum(MARGIN * (high - low), rounding)
    reader = PoseReader(*(part.astype(np.float32) for part in (sample, still, matrix, low - room, high + room)))
    return reader, poses


def read_pose(reader: PoseReader, positions: Float[Any, "v 3"]) -> Float[Any, "p"]:
    """The pose of a frame; arrays of NumPy or JAX."""
    xp = positions.__array_namespace__()
    apart = positions[reader.sample.astype("int32")] - reader.still
    return xp.clip(apart.reshape(-1) @ reader.matrix, reader.low, reader.high)


def poses_outside(reader: PoseReader, positions: Float[np.ndarray, "v 3"]) -> int:
    """How many numbers of a frame's pose had to be held to the range of training."""
    wide = (positions[reader.sample.astype(int)].astype(np.float64) - reader.still).reshape(-1) @ reader.matrix
    return int(((wide < reader.low) | (wide > reader.high)).sum())
