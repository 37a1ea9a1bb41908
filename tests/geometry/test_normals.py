import numpy as np

from gash_jax.geometry.mesh import Mesh, angle_weighted_normals
from gash_jax.geometry.normals import VertexNormals, vertex_normals
from gash_jax.geometry.orientation import orient
from gash_jax.shapes.primitives import icosphere, plane, spherical_bowl

BALL = icosphere(2)


def _normals(mesh: Mesh, own: np.ndarray | None, counted: np.ndarray | None = None) -> VertexNormals:
    points = mesh.vertices.astype(np.float64)
    which = np.ones(len(mesh.faces), dtype=bool) if counted is None else counted
    return vertex_normals(points, mesh.faces, which, orient(points, mesh.faces), own)


def test_computed_ones_are_angle_weighted_and_outward() -> None:
    expected = angle_weighted_normals(BALL.vertices, BALL.faces)
    for faces in (BALL.faces, BALL.faces[:, ::-1]):
        found = _normals(BALL._replace(faces=faces), None)
        np.testing.assert_allclose(found.normals, expected, atol=1e-12)
        assert not found.from_file and not len(found.missing)


def test_the_files_own_are_kept_and_made_unit() -> None:
    own = BALL.vertices * np.linspace(0.1, 900, len(BALL.vertices), dtype=np.float32)[:, None]
    found = _normals(BALL._replace(faces=BALL.faces[:, ::-1]), own)  # whatever the winding
    np.testing.assert_allclose(found.normals, BALL.normals, atol=1e-6)
    assert found.from_file and not len(found.negated) and not len(found.filled)
    tilted = BALL.normals + np.array([0.4, 0, 0], np.float32)
    kept = _normals(BALL, tilted).normals
    np.testing.assert_allclose(kept, tilted / np.linalg.norm(tilted, axis=1, keepdims=True), atol=1e-6)


def test_inward_ones_are_negated_only_where_outside_is_known() -> None:
    found = _normals(BALL, -BALL.normals)
    np.testing.assert_allclose(found.normals, BALL.normals, atol=1e-6)
    np.testing.assert_array_equal(found.negated, np.arange(len(BALL.vertices)))
    bowl = spherical_bowl(1.0, 8)
    assert not len(_normals(bowl, bowl.normals).negated) and not len(_normals(bowl, -bowl.normals).negated)
    scattered = np.random.default_rng(0).normal(size=BALL.vertices.shape)
    assert not len(_normals(BALL, scattered).negated)


def test_unusable_ones_are_replaced_and_isolated_vertices_have_none() -> None:
    own = BALL.normals.copy()
    own[3], own[4, 1], own[5, 2] = 0, np.nan, np.inf
    points = np.concatenate([BALL.vertices, [[9, 9, 9]]]).astype(np.float32)
    found = _normals(Mesh(points, own, BALL.faces), np.concatenate([own, [[0, 1, 0]]]))
    np.testing.assert_array_equal(found.filled, [3, 4, 5])
    expected = angle_weighted_normals(BALL.vertices, BALL.faces)
    np.testing.assert_allclose(found.normals[[3, 4, 5]], expected[[3, 4, 5]], atol=1e-12)
    np.testing.assert_array_equal(found.normals[-1], [0, 0, 0])
    assert not len(found.missing)


def test_a_file_with_only_unusable_normals_has_none() -> None:
    found = _normals(BALL, np.full_like(BALL.normals, np.nan))
    assert not found.from_file and not len(found.filled)
    np.testing.assert_allclose(found.normals, _normals(BALL, None).normals)


def test_left_out_faces_serve_only_vertices_without_others() -> None:
    flat = plane(1.0, 2)
    faces = np.concatenate([flat.faces, [[0, 1, 9]], [[9, 10, 11]], [[8, 12, 12]]])
    extra = np.array([[0, 1, 0], [0, 2, 0], [0, 1, 1], [3, 3, 3]], dtype=np.float32)
    mesh = Mesh(np.concatenate([flat.vertices, extra]), np.zeros((13, 3), np.float32), faces)
    found = _normals(mesh, None, np.arange(len(faces)) < 8)
    np.testing.assert_allclose(found.normals[:9], flat.normals, atol=1e-12)  # the ninth face tilts none of them
    np.testing.assert_allclose(found.normals[10:12], [[1, 0, 0], [1, 0, 0]], atol=1e-12)
    np.testing.assert_array_equal(found.missing, [12])
    own = np.zeros((13, 3))
    own[0] = [0, 1, 0]
    from_file = _normals(mesh, own, np.arange(len(faces)) < 8)
    np.testing.assert_array_equal(from_file.missing, [12])
    np.testing.assert_array_equal(from_file.filled, np.arange(1, 12))
