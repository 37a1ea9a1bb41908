"""Assembly and measures of raw triangle surfaces."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.triangles import (
    join,
    largest_parts,
    mean_normals,
    moved,
    random_rotation,
    signed_volume,
    tangential,
    unique_edges,
    without_unused,
)

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
TETRAHEDRON = RawMesh(CORNERS, np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]))


def test_signed_volume_of_the_corner_tetrahedron() -> None:
    assert signed_volume(TETRAHEDRON) == pytest.approx(1 / 6)
    assert signed_volume(moved(TETRAHEDRON, offset=(5, -3, 2), scale=2.0)) == pytest.approx(8 / 6)


def test_join_and_largest_parts() -> None:
    both = join([TETRAHEDRON, moved(TETRAHEDRON, offset=10.0)])
    assert both.vertices.shape == (8, 3) and both.faces.max() == 7
    many = join([both, RawMesh(CORNERS[:3], np.array([[0, 1, 2]]))])
    kept = largest_parts(many, 0.2)
    np.testing.assert_array_equal(kept.vertices, both.vertices)
    np.testing.assert_array_equal(kept.faces, both.faces)


def test_without_unused_keeps_the_order() -> None:
    surface = without_unused(RawMesh(np.arange(15.0).reshape(5, 3), np.array([[4, 1, 3]])))
    np.testing.assert_array_equal(surface.vertices[:, 0], [3, 9, 12])
    np.testing.assert_array_equal(surface.faces, [[2, 0, 1]])


def test_unique_edges_name_the_sides_of_each_face() -> None:
    edges, face_edges = unique_edges(TETRAHEDRON.faces)
    assert len(edges) == 6
    sides = np.sort(np.stack([TETRAHEDRON.faces, np.roll(TETRAHEDRON.faces, -1, axis=1)], -1), axis=-1)
    np.testing.assert_array_equal(edges[face_edges], sides)


def test_random_rotations_are_proper_and_cover_the_sphere() -> None:
    rng = np.random.default_rng(0)
    matrices = np.stack([random_rotation(rng) for _ in range(4000)])
    np.testing.assert_allclose(matrices @ matrices.transpose(0, 2, 1), np.eye(3)[None] + 0 * matrices, atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(matrices), 1.0)
    # columns of a uniform rotation have mean 0 and second moment 1/3; sd of a mean over 4000 is below 0.01
    assert np.abs(matrices.mean(axis=0)).max() < 0.04
    np.testing.assert_allclose((matrices**2).mean(axis=0), np.full((3, 3), 1 / 3), atol=0.02)


def test_tangential_removes_the_normal_part() -> None:
    flat = RawMesh(CORNERS[:3], np.array([[0, 1, 2]]))
    np.testing.assert_array_equal(mean_normals(flat), [[0, 0, 1]] * 3)
    np.testing.assert_array_equal(tangential(flat, np.full((3, 3), 2.0)), [[2, 2, 0]] * 3)
