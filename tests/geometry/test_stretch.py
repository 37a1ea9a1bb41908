import numpy as np
import pytest

from gash_jax.geometry.stretch import face_stretch, signed_areas, total_stretch, vertex_stretch
from gash_jax.shapes.primitives import plane

FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])


def _lifted(scale: tuple[float, float]) -> np.ndarray:
    return np.append(UV * scale, np.zeros((4, 1)), axis=1)


def test_stretch_by_hand() -> None:
    np.testing.assert_allclose(signed_areas(UV, FACES), 0.5)
    np.testing.assert_allclose(signed_areas(UV[::-1], FACES), -0.5)
    np.testing.assert_allclose(face_stretch(UV, _lifted((2, 1)), FACES), np.sqrt(5 / 2))
    # twice the area in space: sqrt(5/2) sqrt(1/2)
    assert total_stretch(UV, _lifted((2, 1)), FACES) == pytest.approx(np.sqrt(5) / 2)
    assert total_stretch(UV, _lifted((3, 3)), FACES) == pytest.approx(1)
    sheared = _lifted((1, 1)) + [[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 0, 0]]
    np.testing.assert_allclose(face_stretch(UV, sheared, FACES), np.sqrt(3 / 2))


def test_growth_counts_as_area() -> None:
    points = _lifted((2, 1))
    np.testing.assert_allclose(
        total_stretch(UV, points, FACES, np.full(2, 9.0)), total_stretch(UV, points, FACES)
    )  # scaled by 3 in length
    uneven = total_stretch(UV, _lifted((1, 1)), FACES, np.array([4.0, 1.0]))
    assert uneven == pytest.approx(np.sqrt(4 * 2 + 0.5) / 2.5)  # (4 * 2 + 1 * .5) / 2.5², the plane's area is 1


def test_vertices_average_their_faces() -> None:
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [3, 0]])
    points = np.append(uv, np.zeros((5, 1)), axis=1) * [1, 1, 1]
    points[4] = [2, 0, 0]
    faces = np.array([[0, 1, 2], [1, 4, 2]])
    each, area = face_stretch(uv, points, faces), np.array([0.5, 0.5])
    found = vertex_stretch(uv, points, faces)
    np.testing.assert_allclose(found[[0, 4]], each)
    assert found[1] == pytest.approx(np.sqrt(each**2 @ area / area.sum()))
    assert found[3] == 0  # in no face


def test_a_face_without_area_in_the_plane_is_infinitely_stretched_and_one_without_area_counts_for_nothing() -> None:
    flat = np.where(np.arange(4)[:, None] == 3, UV[2], UV)
    assert np.isinf(face_stretch(flat, _lifted((1, 1)), FACES)[1])
    faces = np.append(FACES, [[0, 2, 2]], axis=0)
    assert total_stretch(UV, _lifted((1, 1)), faces) == pytest.approx(1)


def test_motion_and_scale_change_nothing() -> None:
    mesh, rng = plane(1.0, 4), np.random.default_rng(0)
    uv = mesh.vertices[:, [2, 0]] + 0.05 * rng.normal(size=(25, 2))
    points = mesh.vertices + 0.2 * rng.normal(size=(25, 3))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    before = total_stretch(uv, points, mesh.faces)
    assert before > 1
    np.testing.assert_allclose(total_stretch(7 * uv, 3 * points @ turn + 1, mesh.faces), before)
