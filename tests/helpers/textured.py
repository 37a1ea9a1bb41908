"""Meshes with texture coordinates, small enough to work out by hand; (u, v) with v downwards."""

import numpy as np

from gash_jax.geometry.mesh import Mesh

SQUARE = Mesh(
    np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32),
    np.tile(np.array([0, 0, 1], np.float32), (4, 1)),
    np.array([[0, 1, 2], [0, 2, 3]], np.int32),
)
SQUARE_UV = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]], np.float32)
SQUARE_OBJ = """v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0
vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1
f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"""


def split_square(turn: float = 0.3) -> np.ndarray:
    """Texture coordinates of SQUARE with its two faces apart, the second turned by an angle: its diagonal is a seam."""
    first = np.array([[0.1, 0.45], [0.45, 0.45], [0.45, 0.1]])
    second = np.array([[0.1, 0.45], [0.45, 0.1], [0.1, 0.1]]) - 0.275
    c, s = np.cos(turn), np.sin(turn)
    return np.stack([first, second @ [[c, s], [-s, c]] + [0.72, 0.7]]).astype(np.float32)


def dented_sheet(resolution: int = 6) -> tuple[Mesh, np.ndarray]:
    """A sheet with a dent that shadows itself, and its texture coordinates, one chart."""
    u, w = np.meshgrid(np.linspace(0, 1, resolution + 1), np.linspace(0, 1, resolution + 1), indexing="xy")
    height = -0.5 * np.exp(-20 * ((u - 0.5) ** 2 + (w - 0.5) ** 2))
    vertices = np.stack([u.ravel(), height.ravel(), -w.ravel()], axis=1)
    first = (np.arange(resolution)[:, None] * (resolution + 1) + np.arange(resolution)).ravel()
    low = np.stack([first, first + 1, first + resolution + 2], axis=1)
    high = np.stack([first, first + resolution + 2, first + resolution + 1], axis=1)
    faces = np.stack([low, high], axis=1).reshape(-1, 3).astype(np.int32)
    from gash_jax.geometry.health import prepare_mesh

    mesh = prepare_mesh(vertices.astype(np.float32), faces)[0]
    places = np.stack([u.ravel(), 1 - w.ravel()], axis=1) * 0.9 + 0.05
    return mesh, places[faces].astype(np.float32)
