"""Seeded deformations of a mesh: random blendshapes, and lattices that bend the space around it.

Both are blendshapes (`geometry.animation.Blend`): positions are linear in the parameters.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import comb

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.geometry.animation import Animation, Blend, blend_rows
from gash_jax.geometry.mesh import Mesh, normalized
from gash_jax.geometry.normalised import NormalisedMesh

ACTIVE = 8  # shapes that a frame has at the most
STRENGTH = 0.08  # spread of a lattice's points, in half diagonals of the box


def blendshape_animation(mesh: Mesh, seed: WholeNumber, frames: WholeNumber, shapes: WholeNumber = 30) -> Animation:
    """Random shapes, each a smooth bump of the surface, and frames of 1 to 8 of them with weights in 0..1.

    A shape moves what lies around a vertex by a displacement that falls off as a Gaussian of the distance; half of the
    shapes move along the normal, half any way. Frame 0 is the mesh.
    """
    rng = np.random.default_rng([whole_number(seed, "seed", 0), 0])
    frames, shapes = whole_number(frames, "frames", 1), whole_number(shapes, "shapes", 1)
    normalised = NormalisedMesh(mesh)
    points, size = mesh.vertices.astype(np.float64), normalised.half_diagonal
    centers = rng.choice(np.flatnonzero(normalised.referenced), shapes)
    reach = size * np.exp(rng.uniform(np.log(0.08), np.log(0.35), shapes))
    ways = normalized(rng.normal(size=(shapes, 3)))
    outward = (rng.random(shapes) < 0.5) & mesh.normals[centers].any(axis=1)
    ways[outward] = mesh.normals[centers[outward]]
    push = (reach * rng.uniform(0.2, 0.5, shapes) * rng.choice([-1.0, 1.0], shapes))[:, None] * ways
    squares = ((points - points[centers][:, None]) ** 2).sum(axis=2)
    deltas = np.exp(-squares / (2 * reach[:, None] ** 2))[..., None] * push[:, None]
    names = tuple(f"bump {number}" for number in range(shapes))
    return _blended(mesh, deltas, sparse_weights(rng, frames, shapes), names)


def sparse_weights(rng: np.random.Generator, frames: int, shapes: int) -> Float[np.ndarray, "t k"]:
    """Rows with 1 to 8 weights, uniform in 0..1; the first row is 0."""
    count = rng.integers(1, min(ACTIVE, shapes) + 1, (frames, 1))
    rank = np.argsort(np.argsort(rng.random((frames, shapes)), axis=1), axis=1)
    weights = np.where(rank < count, rng.random((frames, shapes)), 0.0)
    weights[0] = 0
    return weights


def has_random_poses(animation: Animation) -> bool:
    """Whether an animation has shapes and no bones."""
    motion = animation.motion
    return isinstance(motion, Blend) and not motion.weights.shape[1] and len(motion.deltas) > 0


def random_poses(animation: Animation, seed: WholeNumber, frames: WholeNumber, held_out: bool = False) -> Animation:
    """Frames of 1 to 8 of an animation's shapes at once with weights in 0..1, in place of its own.

    `held_out` gives others than without it, for tests. Raises ValueError for an animation with bones or without shapes.
    """
    seed, frames, shapes = whole_number(seed, "seed", 0), whole_number(frames, "frames", 1), len(animation.names)
    if not has_random_poses(animation):
        raise ValueError("random poses need blendshapes without bones: take the frames of the file")
    weights = sparse_weights(np.random.default_rng([seed, 4 + held_out]), frames + 1, shapes)[1:]
    return animation._replace(parameters=blend_rows(weights, np.zeros((frames, 0, 3, 4))), seconds=None)


def lattice_animation(mesh: Mesh, seed: WholeNumber, frames: WholeNumber, points: WholeNumber = 4) -> Animation:
    """Free-form deformation by a lattice of points³ control points around the mesh that sway independently.

    The position of a vertex is the Bernstein polynomial of the control points at its place in the box (Sederberg &
    Parry 1986), so a parameter is a displacement of one control point along x, y or z. Each sways as a sine of time
    with a frequency and a phase of its own, one to three times in the animation; frame 0 is the mesh.
    """
    rng = np.random.default_rng([whole_number(seed, "seed", 0), 1])
    frames, points = whole_number(frames, "frames", 1), whole_number(points, "points", 2, 8)
    normalised = NormalisedMesh(mesh)
    low, high = normalised.box
    place = np.clip((mesh.vertices - low) / np.where(high > low, high - low, 1), 0, 1)
    order = np.arange(points)
    bernstein = comb(points - 1, order) * place[..., None] ** order * (1 - place[..., None]) ** (points - 1 - order)
    shares = np.einsum("vi,vj,vk->ijkv", *bernstein.transpose(1, 0, 2)).reshape(points**3, -1)
    deltas = np.einsum("pv,ij->pivj", shares, np.eye(3)).reshape(3 * points**3, -1, 3)
    count = len(deltas)
    time, rounds, phase = np.linspace(0, 1, frames)[:, None], rng.uniform(1, 3, count), rng.uniform(0, 1, count)
    sway = np.sin(2 * np.pi * (rounds * time + phase)) - np.sin(2 * np.pi * phase)
    rows = STRENGTH * normalised.half_diagonal * rng.normal(size=count) * sway
    names = tuple(f"point {i} {j} {k} {axis}" for i, j, k in np.ndindex(points, points, points) for axis in "xyz")
    return _blended(mesh, deltas, rows, names)


def _blended(mesh: Mesh, deltas: np.ndarray, rows: np.ndarray, names: tuple[str, ...]) -> Animation:
    motion = Blend(mesh.vertices, deltas.astype(np.float32), np.zeros((len(mesh.vertices), 0)))
    return Animation(mesh, blend_rows(rows, np.zeros((len(rows), 0, 3, 4))), names, motion)
