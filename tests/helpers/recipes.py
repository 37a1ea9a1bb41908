"""Meshes of single recipes, as the corpus makes them."""

import numpy as np

from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.shapes.procedural import Recipe, retessellated


def made(recipe: Recipe, seed: int, target: int) -> Mesh:
    surface = retessellated(recipe, np.random.default_rng([seed, target]), target)
    return prepare_mesh(surface.vertices.astype(np.float32), surface.faces.astype(np.int32))[0]


def closed(faces: np.ndarray) -> bool:
    """Whether every directed edge has as many opposites."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    return bool(np.array_equal(np.sort(edges @ [10**7, 1]), np.sort(edges @ [1, 10**7])))


def assert_repeatable(recipe: Recipe) -> None:
    """The same again for a seed, another for another."""
    first, again, other = (made(recipe, seed, 400) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.faces, again.faces)
    assert not np.array_equal(first.vertices, other.vertices)
