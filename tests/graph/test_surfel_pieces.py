"""Ways of cutting a face: parts fill it, slivers end up short, and few faces make enough leaves."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import face_areas
from gash_jax.graph.surfel_pieces import (
    LEAVES,
    MOST_PARTS,
    MOST_SLICED,
    MOST_SLICES,
    PIECE_COUNT,
    PIECE_START,
    PIECES,
    cut_faces,
)
from tests.helpers.bumpy import bumpy_mesh

CORNERS = np.array([[0, 0, 0], [3, 0, 1], [1, 2, -1]], np.float64)


def _cross(parts: np.ndarray) -> np.ndarray:
    return np.cross(parts[:, 1] - parts[:, 0], parts[:, 2] - parts[:, 0])


def _squares(parts: np.ndarray) -> np.ndarray:
    """Second moments about the origin, times 12 over the area."""
    middles, area = parts.mean(1), np.linalg.norm(_cross(parts), axis=1)
    return np.einsum("m,mvi,mvj->ij", area, parts, parts) + 9 * np.einsum("m,mi,mj->ij", area, middles, middles)


@pytest.mark.parametrize("way", range(len(PIECE_COUNT)))
def test_pieces_fill_the_face_without_overlap(way: int) -> None:
    parts = PIECES[PIECE_START[way] :][: PIECE_COUNT[way]] @ CORNERS
    # all wound as the face; the second moments are those of the face only if there are neither overlaps nor gaps
    assert np.all(_cross(parts) @ _cross(CORNERS[None])[0] > 0)
    np.testing.assert_allclose(_cross(parts).sum(0), _cross(CORNERS[None])[0], atol=1e-5)
    np.testing.assert_allclose(_squares(parts), _squares(CORNERS[None]), rtol=1e-5)


def test_even_parts_are_equal() -> None:
    assert len(PIECES) == PIECE_COUNT.sum() and len(PIECE_COUNT) == MOST_PARTS + 3 * (MOST_SLICES - 1)
    for k in range(1, MOST_PARTS + 1):
        parts = PIECES[PIECE_START[k - 1] :][: k * k] @ CORNERS
        np.testing.assert_allclose(_cross(parts), np.tile(_cross(CORNERS[None]) / k**2, (k * k, 1)), atol=1e-5)


def test_two_slices_by_hand() -> None:
    """Towards corner 2: halfway along both long sides."""
    parts = PIECES[PIECE_START[MOST_PARTS + 2] :][:3] @ CORNERS
    a, b, c = CORNERS
    expected = [[a, b, (a + c) / 2], [(a + c) / 2, (b + c) / 2, c], [b, (b + c) / 2, (a + c) / 2]]
    np.testing.assert_allclose(parts, expected, atol=1e-6)


def _fan(count: int, width: float) -> tuple[np.ndarray, np.ndarray]:
    """So many slivers of unit length from one point, their short sides in any place of a face."""
    angle = width * np.arange(count + 1)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = np.concatenate([[[0, 0, 0]], rim]).astype(np.float32)
    i = np.arange(count)
    faces = np.stack([0 * i, 1 + i, 2 + i], axis=1)
    return vertices, np.stack([np.roll(face, shift) for shift, face in enumerate(faces)])


def _longest(vertices: np.ndarray, faces: np.ndarray, face: np.ndarray, piece: np.ndarray) -> float:
    corners = PIECES[piece] @ vertices[faces[face]]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max())


def test_slivers_are_cut_across() -> None:
    vertices, faces = _fan(40, 0.002)
    face, piece = cut_faces(vertices, faces, face_areas(vertices, faces))
    np.testing.assert_array_equal(np.bincount(face), 2 * MOST_SLICES - 1)
    # a sixteenth of the length, and no wider than the sliver
    assert _longest(vertices, faces, face, piece) < 1.001 * np.hypot(1 / MOST_SLICES, 0.002)
    # evenly cut the same leaves would be twice as long
    assert _longest(vertices, faces, face, piece) < 1 / MOST_PARTS


def test_no_more_leaves_for_slivers_than_the_mesh_may_have() -> None:
    vertices, faces = _fan(4000, 5e-5)
    face, _ = cut_faces(vertices, faces, face_areas(vertices, faces))
    assert MOST_SLICED / 2 < len(face) - len(faces) <= MOST_SLICED


@pytest.mark.parametrize("count", [40, 300])
def test_a_mesh_of_few_even_faces_has_about_so_many_leaves(count: int) -> None:
    mesh = bumpy_mesh(count)
    face, piece = cut_faces(mesh.vertices, mesh.faces, face_areas(mesh.vertices, mesh.faces))
    assert min(LEAVES, MOST_PARTS**2 * len(mesh.faces) // 2) < len(face) < 2 * LEAVES
    np.testing.assert_array_equal(np.unique(face), np.arange(len(mesh.faces)))
    assert len(np.unique(np.stack([face, piece]), axis=1).T) == len(face)


def test_faces_without_area_are_leaves() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], np.float32)
    for faces in ([[0, 1, 2]], [[0, 1, 2], [0, 0, 0], [0, 1, 3]]):
        face, _ = cut_faces(vertices, np.array(faces), face_areas(vertices, np.array(faces)))
        np.testing.assert_array_equal(np.unique(face), np.arange(len(faces)))
