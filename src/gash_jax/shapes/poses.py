"""Limbs in poses in which they come near the body or each other: bones of figures, animals and hands, bent.

Capsules keep their shape where their ends are moved, so no pose can turn the surface inside out.
"""

import numpy as np
from jaxtyping import Float

from gash_jax.shapes.organic import Bone, animal
from gash_jax.shapes.rigs import figure_bones, posed_transforms
from gash_jax.shapes.sdf import Field, capsule, union


def posed_limbs(rng: np.random.Generator) -> Field:
    """The solid of a figure, a curled animal or a hand that closes, its joints blended a little."""
    bones = (_figure, _animal, _hand)[int(rng.choice(3, p=[0.5, 0.25, 0.25]))](rng)
    return union([capsule(*bone) for bone in bones], rng.uniform(0.02, 0.07))


def _figure(rng: np.random.Generator) -> list[Bone]:
    """Arms folded in front of the chest or at the sides, legs drawn up or together, head and back bent."""
    bones = figure_bones(rng)
    turns = 0.12 * rng.normal(size=(1, len(bones), 3))
    crouch, fold = rng.uniform(0.0, 2.3), rng.uniform(0.6, 1.7)
    for number, bone in enumerate(bones):
        side, part = np.sign(bone.start[0]), bone.name.split(" ", 1)[-1]
        turns[0, number] += {
            "chest": [0.4 * crouch, 0, 0],
            "head": [rng.uniform(0, 0.6), 0, 0],
            # arms point along x, the figure looks along z: first down or forward, then across
            "upper arm": [0, -side * fold * rng.uniform(0.7, 1.0), -side * rng.uniform(0.1, 1.1)],
            "forearm": [0, -side * rng.uniform(0.6, 2.2), 0],
            "hand": [0, -side * rng.uniform(0, 0.8), 0],
            "thigh": [-crouch * rng.uniform(0.9, 1.1), 0, -side * rng.uniform(0.0, 0.15)],
            "shin": [crouch * rng.uniform(0.9, 1.2), 0, 0],
        }.get(part, [0, 0, 0])
    matrices = posed_transforms(bones, turns)[0]
    ends = [[m[:, :3] @ at + m[:, 3] for at in (b.start, b.end)] for b, m in zip(bones, matrices, strict=True)]
    return [(start, end, bone.radius, bone.radius) for bone, (start, end) in zip(bones, ends, strict=True)]


def _animal(rng: np.random.Generator) -> list[Bone]:
    """An animal curled up: its back an arc about the legs, which draw together within it."""
    bones, curvature, twist = animal(rng), rng.uniform(0.8, 1.9), rng.uniform(-0.4, 0.4)

    def curled(point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        x, y, z = point
        angle, radius = curvature * z, 1 / curvature + y
        return np.array([x + twist * z * z, radius * np.cos(angle) - 1 / curvature, radius * np.sin(angle)])

    return [(curled(start), curled(end), r, s) for start, end, r, s in bones]


def _hand(rng: np.random.Generator) -> list[Bone]:
    """A hand whose fingers close to a fist, around a gap, or cross the thumb."""
    thick, count = rng.uniform(0.09, 0.13), int(rng.integers(3, 6))
    bones: list[Bone] = [(np.array([0, -1.1, 0]), np.array([0, -0.5, 0]), 1.6 * thick, 2 * thick)]
    closed = rng.uniform(0.7, 1.5)
    for x in np.linspace(-0.36, 0.36, count):
        root, length = np.array([x, 0.1, 0.0]), rng.uniform(0.26, 0.36)
        bones.append((np.array([0.5 * x, -0.5, 0]), root, 1.5 * thick, 1.2 * thick))
        angle, lean = 0.0, rng.normal(scale=0.08) - 0.1 * x
        for _ in range(3):
            angle += closed * rng.uniform(0.75, 1.1)
            tip = root + length * np.array([lean, np.cos(angle), np.sin(angle)])
            bones.append((root, tip, thick, 0.9 * thick))
            root, length = tip, 0.8 * length
    root = np.array([0.3, -0.45, 0.05])
    for way in ([0.22, 0.2, 0.2], [-0.05, 0.2, 0.2], [-0.25, 0.05, 0.1]):
        tip = root + np.array(way) + 0.04 * rng.normal(size=3)
        bones.append((root, tip, 1.1 * thick, thick))
        root = tip
    return bones
