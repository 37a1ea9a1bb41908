"""Normals of a pose on the device against NumPy's, by hand, and at vertices with more corners than a table has."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.mesh import angle_weighted_normals
from gash_jax.models.pose_normals import CORNERS, angle_of, corners_of, vertex_normals
from gash_jax.shapes.primitives import bumpy_sphere


def test_angles_are_those_of_arctan2() -> None:
    turns = np.concatenate([np.linspace(0, np.pi, 100001), [np.pi / 4, np.pi / 2, 3 * np.pi / 4]])
    for size in (1.0, 1e-12, 1e12):
        sine, cosine = (
            (np.maximum(size * np.sin(turns), 0)).astype(np.float32),
            (size * np.cos(turns)).astype(np.float32),
        )
        found = np.asarray(angle_of(jnp.asarray(sine), jnp.asarray(cosine)))
        assert np.abs(found - np.arctan2(sine.astype(np.float64), cosine)).max() < 4e-7


def test_the_slope_of_an_angle_is_that_of_turning() -> None:
    """d angle = cos d sin - sin d cos, on either side of where the polynomial changes its argument."""
    slope = jax.vmap(jax.grad(angle_of, argnums=(0, 1)))
    turns = jnp.asarray([0.1, 0.7, 0.9, 1.5, 1.7, 2.3, 2.5, 3.0])
    found = slope(jnp.sin(turns), jnp.cos(turns))
    np.testing.assert_allclose(found[0], jnp.cos(turns), atol=2e-5)
    np.testing.assert_allclose(found[1], -jnp.sin(turns), atol=2e-5)


def test_a_roof_by_hand() -> None:
    """Two unit triangles that meet at a right angle in an edge: its ends get the middle of both, others their own."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    found = vertex_normals(jnp.asarray(positions), np.array([[0, 1, 2], [0, 3, 1]], np.int32))
    half = np.sqrt(0.5)
    np.testing.assert_allclose(found, [[0, half, half], [0, half, half], [0, 0, 1], [0, 1, 0]], atol=1e-6)


@pytest.mark.parametrize("faces_at_middle", [3, CORNERS, CORNERS + 1, 40])
def test_a_vertex_may_have_any_number_of_faces(faces_at_middle: int) -> None:
    around = np.linspace(0, 2 * np.pi, faces_at_middle, endpoint=False)
    rim = np.stack([np.cos(around), np.sin(around), 0.3 * np.sin(3 * around + 1)], axis=1)
    positions = np.concatenate([[[0.1, 0.2, 0.7]], rim]).astype(np.float32)
    ends = 1 + np.arange(faces_at_middle)
    faces = np.stack([0 * ends, ends, np.roll(ends, -1)], axis=1).astype(np.int32)
    assert len(corners_of(faces, len(positions)).more) == max(faces_at_middle - CORNERS, 0)
    expected = angle_weighted_normals(positions.astype(np.float64), faces)
    np.testing.assert_allclose(vertex_normals(jnp.asarray(positions), faces), expected, atol=2e-6)


def test_many_poses_at_once_and_without_faces() -> None:
    mesh = bumpy_sphere(5)
    poses = jnp.asarray(np.stack([mesh.vertices, mesh.vertices * np.array([1, 2, 3], np.float32)]))
    found = jax.jit(jax.vmap(lambda pose: vertex_normals(pose, mesh.faces)))(poses)
    for pose, normals in zip(np.asarray(poses), found, strict=True):
        np.testing.assert_allclose(normals, angle_weighted_normals(pose.astype(np.float64), mesh.faces), atol=3e-6)
    assert not np.asarray(vertex_normals(poses[0], np.zeros((0, 3), np.int32))).any()
