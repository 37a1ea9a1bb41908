"""A generated figure with a skeleton: a smooth body around bones, weights that fade across joints, random poses.

A bone is turned about its own start, in the frame of the bone above it; what hangs from it goes along. Its matrix takes
the rest to the pose: T_b = T_above R_b, with R_b the rotation about the bone's start.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.geometry.animation import Animation, Blend, blend_rows
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import lengths
from gash_jax.shapes.sdf import capsule, surface_of, union

BLEND = 0.06  # width of the joints between capsules, in units of a figure about 2 high
BENT = 0.35  # spread of the angle of a joint, radians


class Bone(NamedTuple):
    """A capsule of the rest pose and the bone that it hangs from."""

    name: str
    above: int  # -1 for the root
    start: Float[np.ndarray, "3"]
    end: Float[np.ndarray, "3"]
    radius: float


def figure_bones(rng: np.random.Generator) -> list[Bone]:
    """A standing figure of random proportions, arms held out: 16 bones, each after the one that it hangs from."""
    girth = rng.uniform(0.15, 0.22)
    arm, leg = rng.uniform(0.27, 0.36), rng.uniform(0.38, 0.48)
    bones = [Bone("pelvis", -1, np.array([0, -0.15, 0]), np.array([0, 0.1, 0]), girth)]
    bones.append(Bone("chest", 0, np.array([0, 0.1, 0]), np.array([0, 0.45, 0]), girth * rng.uniform(0.95, 1.2)))
    bones.append(Bone("neck", 1, np.array([0, 0.45, 0]), np.array([0, 0.72, 0]), 0.45 * girth))
    bones.append(Bone("head", 2, np.array([0, 0.72, 0]), np.array([0, 0.88, 0.03]), rng.uniform(0.13, 0.19)))
    for side, name in ((1.0, "left"), (-1.0, "right")):
        # within the body, so that the surface is one
        shoulder, hip = np.array([side * 0.8 * girth, 0.42, 0]), np.array([side * 0.62 * girth, -0.2, 0])
        out, down = np.array([side, -0.25, 0]), np.array([side * 0.08, -1, 0])
        thin, thick, above = 0.42 * girth, 0.55 * girth, 1
        for part, share in (("upper arm", 1.0), ("forearm", 0.9), ("hand", 0.45)):
            end = shoulder + share * arm * out
            bones.append(Bone(f"{name} {part}", above, shoulder, end, thin))
            shoulder, thin, above = end, 0.88 * thin, len(bones) - 1
        above = 0
        for part, way in (("thigh", leg * down), ("shin", leg * down), ("foot", np.array([0, -0.02, 0.17]))):
            bones.append(Bone(f"{name} {part}", above, hip, hip + way, thick))
            hip, thick, above = hip + way, 0.8 * thick, len(bones) - 1
    return bones


def skin_weights(points: Float[np.ndarray, "v 3"], bones: list[Bone]) -> Float[np.ndarray, "v b"]:
    """Weights that fall off with the distance from each capsule, over about the width of a joint; rows sum to 1."""
    start, axis = np.array([bone.start for bone in bones]), np.array([bone.end - bone.start for bone in bones])
    radius = np.array([bone.radius for bone in bones])
    from_start = points[:, None] - start
    along = np.clip(np.einsum("vbi,bi->vb", from_start, axis) / np.einsum("bi,bi->b", axis, axis), 0, 1)
    away = from_start - along[..., None] * axis
    distance = lengths(away.reshape(-1, 3)).reshape(len(points), -1) / radius
    close = np.exp(-4 * (distance - distance.min(axis=1, keepdims=True)))
    return close / close.sum(axis=1, keepdims=True)


def posed_transforms(bones: list[Bone], turns: Float[np.ndarray, "t b 3"]) -> Float[np.ndarray, "t b 3 4"]:
    """Matrices of all bones for rotation vectors about their starts, in radians."""
    count = len(turns)
    rotations = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(count, len(bones), 3, 3)
    placed = np.tile(np.eye(4), (count, len(bones), 1, 1))
    for number, bone in enumerate(bones):
        placed[:, number, :3, :3] = rotations[:, number]
        placed[:, number, :3, 3] = bone.start - rotations[:, number] @ bone.start
        if bone.above >= 0:
            placed[:, number] = placed[:, bone.above] @ placed[:, number]
    return placed[:, :, :3]


def figure_animation(seed: WholeNumber, frames: WholeNumber, vertices: WholeNumber = 6000) -> Animation:
    """A figure of about so many vertices in random poses: every joint turned by a random small rotation.

    Frame 0 is the rest. The same in every process for the same seed.
    """
    rng = np.random.default_rng([whole_number(seed, "seed", 0), 2])
    frames, vertices = whole_number(frames, "frames", 1), whole_number(vertices, "vertices", 200)
    bones = figure_bones(rng)
    solid = union([capsule(bone.start, bone.end, bone.radius, bone.radius) for bone in bones], BLEND)
    surface = surface_of(solid, rng, vertices, 2.2)
    mesh, _ = prepare_mesh(surface.vertices.astype(np.float32), surface.faces.astype(np.int32))
    turns = BENT * rng.normal(size=(frames, len(bones), 3))
    turns[0] = 0
    motion = Blend(
        mesh.vertices, np.zeros((0, *mesh.vertices.shape), np.float32), skin_weights(mesh.vertices.astype(float), bones)
    )
    rows = blend_rows(np.zeros((frames, 0)), posed_transforms(bones, turns))
    return Animation(mesh, rows, tuple(bone.name for bone in bones), motion)
