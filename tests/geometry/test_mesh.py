import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gash_jax.geometry import mesh as m
from gash_jax.geometry.mesh import Mesh
from gash_jax.shapes.primitives import box, bumpy_sphere, icosphere

QUAD = Mesh(
    np.array([[0, 0, 0], [2, 0, 0], [2, 0, -2], [0, 0, -2], [50, 50, 50]], np.float32),
    np.array([[0, 1, 0]] * 4 + [[0, 0, 0]], np.float32),
    np.array([[0, 1, 2], [0, 2, 3]], np.int32),
)


def test_hand_worked_quad() -> None:
    """A horizontal square, CCW from above; vertex 4 is in no face."""
    np.testing.assert_array_equal(m.face_normals(QUAD.vertices, QUAD.faces), [[0, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(m.face_areas(QUAD.vertices, QUAD.faces), [2, 2])
    np.testing.assert_array_equal(m.referenced(QUAD), [True, True, True, True, False])
    np.testing.assert_array_equal(m.unique_edges(QUAD.faces), [[0, 1], [0, 2], [0, 3], [1, 2], [2, 3]])


def test_against_trimesh() -> None:
    mesh = bumpy_sphere(6)
    other = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    np.testing.assert_allclose(m.face_areas(mesh.vertices, mesh.faces), other.area_faces, rtol=1e-9)
    np.testing.assert_allclose(m.face_normals(mesh.vertices, mesh.faces), other.face_normals, atol=1e-9)
    angles = trimesh.geometry.weighted_vertex_normals(
        len(mesh.vertices), mesh.faces, other.face_normals, other.face_angles
    )
    np.testing.assert_allclose(m.angle_weighted_normals(mesh.vertices, mesh.faces), angles, atol=1e-9)
    np.testing.assert_array_equal(m.unique_edges(mesh.faces), np.unique(np.sort(other.edges, axis=1), axis=0))


def test_angle_weights_ignore_the_triangulation() -> None:
    """At a cube corner the three sides count the same, however their diagonals run; areas would not do."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 3)], np.float32)
    faces = np.array(trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 3]]).faces, np.int32)
    outward = (corners - [0.5, 0.5, 1.5]) * [2, 2, 2 / 3] / np.sqrt(3)
    box_vertices = trimesh.creation.box(bounds=[[0, 0, 0], [1, 1, 3]]).vertices.astype(np.float32)
    np.testing.assert_array_equal(np.unique(box_vertices, axis=0), np.unique(corners, axis=0))
    expected = outward[[np.argmin(np.abs(corners - v).sum(axis=1)) for v in box_vertices]]
    np.testing.assert_allclose(m.angle_weighted_normals(box_vertices, faces), expected, atol=1e-12)


def test_normals_that_cancel_or_do_not_exist_are_zero() -> None:
    double = np.array([[0, 1, 2], [0, 2, 1]])
    points = np.array([[0, 0, 0], [1, 0, 0], [0.3, 1, 0.7], [4, 4, 4]])
    np.testing.assert_array_equal(m.angle_weighted_normals(points, double), np.zeros((4, 3)))
    np.testing.assert_array_equal(m.angle_weighted_normals(points, np.array([[0, 0, 1], [1, 1, 1]])), np.zeros((4, 3)))


@settings(max_examples=15, deadline=None)
@given(st.integers(-6, 6), st.integers(0, 1000))
def test_normals_at_any_size_and_place(exponent: int, seed: int) -> None:
    """float64 inside: sizes from 1e-6 to 1e6 change nothing; neither does a place 1e6 sizes away (before float32)."""
    mesh, scale = icosphere(2), 10.0**exponent
    shift = np.random.default_rng(seed).uniform(-1e6, 1e6, size=3) * scale
    far = mesh.vertices.astype(np.float64) * scale + shift
    expected = m.angle_weighted_normals(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(m.angle_weighted_normals(far, mesh.faces), expected, atol=1e-8)


def test_transform_is_scale_rotation_translation() -> None:
    rotation = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # x -> y
    moved = m.transform(box(), rotation, np.array([10.0, 0, 0]), 2.0)
    np.testing.assert_allclose(moved.vertices, 2 * box().vertices @ rotation.T + [10, 0, 0])
    np.testing.assert_allclose(m.face_normals(moved.vertices, moved.faces), m.face_normals(*box()[::2]) @ rotation.T)
    np.testing.assert_allclose(moved.normals, box().normals @ rotation.T)
    back = m.transform(m.transform(moved, translation=np.array([-10.0, 0, 0])), rotation.T, scale=0.5)
    np.testing.assert_allclose(back.vertices, box().vertices, atol=1e-6)
    assert back.vertices.dtype == back.normals.dtype == np.float32


@pytest.mark.parametrize("rotation", [np.diag([1.0, 1, -1]), 2 * np.eye(3), np.ones((3, 3))])
def test_transform_refuses_what_is_no_rotation(rotation: np.ndarray) -> None:
    with pytest.raises(ValueError, match="proper rotation"):
        m.transform(box(), rotation)
    with pytest.raises(ValueError, match="positive"):
        m.transform(box(), scale=-1.0)


def test_components_are_those_of_shared_vertices() -> None:
    two = m.concatenate([icosphere(1), QUAD, icosphere(0)])
    expected = np.repeat([0, 1, 2], [80, 2, 20])
    np.testing.assert_array_equal(m.face_components(two.faces), expected)
    order = np.random.default_rng(0).permutation(len(two.faces))
    labels = m.face_components(two.faces[order])
    np.testing.assert_array_equal(labels[np.sort(np.unique(labels, return_index=True)[1])], [0, 1, 2])
    assert np.unique(np.stack([labels, expected[order]]), axis=1).shape[1] == 3  # the same partition
    np.testing.assert_array_equal(m.face_components(np.array([[0, 1, 2], [2, 3, 4]])), [0, 0])  # a vertex is enough


def test_subdivision_keeps_surface_and_vertices() -> None:
    mesh = bumpy_sphere(3)
    fine = m.subdivide_midpoint(mesh)
    np.testing.assert_array_equal(fine.vertices[: len(mesh.vertices)], mesh.vertices)
    np.testing.assert_array_equal(fine.normals[: len(mesh.vertices)], mesh.normals)
    assert len(fine.faces) == 4 * len(mesh.faces)
    assert len(fine.vertices) == len(mesh.vertices) + len(m.unique_edges(mesh.faces))
    quarter = np.repeat(m.face_areas(mesh.vertices, mesh.faces) / 4, 4)
    np.testing.assert_allclose(m.face_areas(fine.vertices, fine.faces), quarter, rtol=1e-5)
    parents = np.repeat(m.face_normals(mesh.vertices, mesh.faces), 4, axis=0)
    np.testing.assert_allclose(m.face_normals(fine.vertices, fine.faces), parents, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(fine.normals, axis=1), 1, atol=1e-6)
    np.testing.assert_array_equal(
        fine.vertices[len(mesh.vertices)], mesh.vertices[m.unique_edges(mesh.faces)[0]].mean(0)
    )


def test_subdivision_of_a_face_with_a_repeated_index() -> None:
    fine = m.subdivide_midpoint(QUAD._replace(faces=np.array([[0, 1, 1]], np.int32)))
    assert fine.faces.max() == 5 and fine.faces.min() == 0


def test_concatenate_shifts_faces() -> None:
    both = m.concatenate([QUAD, QUAD])
    np.testing.assert_array_equal(both.faces[2:], QUAD.faces + 5)
    np.testing.assert_array_equal(both.vertices[5:], QUAD.vertices)
    assert both.faces.dtype == np.int32
