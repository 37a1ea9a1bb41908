"""Vertices with frames and shifts at random: what the kernels of a bake work on."""

import numpy as np

from gash_jax.algebra.directions import orthonormal_frame


def random_rows(count: int = 7, rotations: int = 3, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Origins, frames and shifts; the frames are turned about their normals at random."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    angle = rng.random(count) * 2 * np.pi
    turn = np.zeros((count, 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(angle)
    turn[:, 1, 0], turn[:, 0, 1], turn[:, 2, 2] = np.sin(angle), -np.sin(angle), 1.0
    frames = np.asarray(orthonormal_frame(normals)) @ turn
    origins = rng.normal(size=(count, 3)).astype(np.float32)
    return origins, frames.astype(np.float32), rng.random((count, rotations, 2), np.float32)
