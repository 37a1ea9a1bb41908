"""Vertices of two files of one surface."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import MeshError
from gash_jax.geometry.vertex_matching import mean_over, same_vertices, vertices_of
from gash_jax.shapes.primitives import icosphere

BALL = icosphere(2)
RNG = np.random.default_rng(2)


def test_split_and_shuffled_vertices_find_their_file_vertex() -> None:
    order = RNG.permutation(np.repeat(np.arange(len(BALL.vertices)), 2))
    engine = BALL.vertices[order] + 1e-7, BALL.normals[order]
    np.testing.assert_array_equal(vertices_of(engine, (BALL.vertices, BALL.normals)), order)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_at_one_place_the_normal_decides_at_any_scale(scale: float) -> None:
    """Two sheets back to back: four file vertices, two places."""
    places = scale * np.array([[0, 0, 0], [1, 0, 0], [0, 0, 0], [1, 0, 0]], np.float32)
    normals = np.array([[0, 0, 1], [0, 0, 1], [0, 0, -1], [0, 0, -1]], np.float32)
    tilted = np.array([[0, 0.6, -0.8], [0, 0.6, 0.8]], np.float32)
    assert vertices_of((places[[0, 1]], tilted), (places, normals)).tolist() == [2, 1]
    assert same_vertices(places, normals).tolist() == [0, 1, 2, 3]
    assert len(set(same_vertices(places, np.abs(normals)).tolist())) == 2


def test_vertices_that_are_nowhere_are_named() -> None:
    moved = BALL.vertices.copy()
    moved[[3, 5]] += 0.01
    with pytest.raises(MeshError, match=r"2 of 162 vertices of the \.glb \(first: 3\) are nowhere in the transfer"):
        vertices_of((moved, BALL.normals), (BALL.vertices, BALL.normals))


def test_means_by_hand() -> None:
    values = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 0.0]], np.float32)
    assert mean_over(np.array([0, 1, 0]), values).tolist() == [[3.0, 1.0], [3.0, 4.0], [3.0, 1.0]]
    assert mean_over(np.array([0, 1, 0]), values).dtype == np.float32
