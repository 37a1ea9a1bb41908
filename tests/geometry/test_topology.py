import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.geometry import topology as t
from gash_jax.shapes.primitives import icosphere, torus

STRIP = np.array([[0, 1, 2], [2, 1, 3]])  # two triangles, properly wound, sharing edge 1-2


def _edges(faces: np.ndarray) -> t.Edges:
    return t.build_edges(faces, int(faces.max()) + 1)


def test_hand_worked_edges() -> None:
    edges = _edges(STRIP)
    np.testing.assert_array_equal(edges.vertices, [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]])
    np.testing.assert_array_equal(edges.faces_at, [1, 1, 2, 1, 1])
    np.testing.assert_array_equal(edges.edge, [0, 1, 2, 2, 3, 4])
    shared = edges.edge == 2
    assert set(edges.halfedge[shared]) == {1, 3}  # corner 1 of face 0, corner 0 of face 1
    assert sorted(edges.forward[shared]) == [False, True]
    np.testing.assert_array_equal(t.repeated_directions(edges), np.zeros(5))
    np.testing.assert_array_equal(t.repeated_directions(_edges(np.array([[0, 1, 2], [1, 2, 3]]))), [0, 0, 1, 0, 0])


def test_edges_against_a_dictionary() -> None:
    faces = np.random.default_rng(0).integers(0, 12, size=(60, 3))
    oracle: dict[tuple[int, int], list[tuple[int, bool]]] = {}
    for f, face in enumerate(faces.tolist()):
        for c in range(3):
            a, b = face[c], face[(c + 1) % 3]
            if a != b:
                oracle.setdefault((min(a, b), max(a, b)), []).append((3 * f + c, a < b))
    edges = _edges(faces)
    assert [tuple(pair) for pair in edges.vertices.tolist()] == sorted(oracle)
    for number, pair in enumerate(sorted(oracle)):
        members = edges.edge == number
        found = sorted(zip(edges.halfedge[members].tolist(), edges.forward[members].tolist(), strict=True))
        assert found == sorted(oracle[pair])
        twice = sum([way for _, way in oracle[pair]].count(direction) > 1 for direction in (True, False))
        assert t.repeated_directions(edges)[number] == twice
        assert edges.faces_at[number] == len(oracle[pair])


@pytest.mark.parametrize("count", [4, 2_000_001])
def test_duplicates_name_the_first(count: int) -> None:
    faces = np.array([[3, 1, 2], [0, 1, 2], [1, 2, 3], [2, 1, 0], [3, 2, 0], [2, 2, 0], [0, 0, 2], [2, 0, 2]])
    np.testing.assert_array_equal(t.first_of_duplicates(faces, count), [0, 1, 0, 1, 4, 5, 6, 5])
    far = faces.astype(np.int64) + count - 4
    np.testing.assert_array_equal(t.first_of_duplicates(far, count), [0, 1, 0, 1, 4, 5, 6, 5])


def test_winding_class_changes_with_a_swap_only() -> None:
    faces = np.array([[4, 7, 9], [7, 9, 4], [9, 4, 7], [7, 4, 9], [4, 9, 7], [9, 7, 4]])
    np.testing.assert_array_equal(t.cyclic_ascent(faces), [True] * 3 + [False] * 3)
    np.testing.assert_array_equal(
        t.has_repeated_index(np.array([[0, 1, 2], [0, 0, 1], [0, 1, 1], [1, 0, 1]])), [0, 1, 1, 1]
    )


def test_fans() -> None:
    bow = np.array([[0, 1, 2], [0, 3, 4]])  # two triangles touching in vertex 0
    np.testing.assert_array_equal(t.fan_counts(bow, _edges(bow), 6), [2, 1, 1, 1, 1, 0])
    np.testing.assert_array_equal(t.fan_counts(STRIP, _edges(STRIP), 4), [1, 1, 1, 1])
    sphere = icosphere(1).faces
    np.testing.assert_array_equal(t.fan_counts(sphere, _edges(sphere), 42), np.ones(42))
    cones = np.concatenate([sphere, np.where(sphere == 0, 0, sphere + 42)])  # two spheres sharing vertex 0: closed fans
    assert t.fan_counts(cones, _edges(cones), 84)[0] == 2
    book = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])  # three pages: one fan
    np.testing.assert_array_equal(t.fan_counts(book, _edges(book), 5), np.ones(5))
    pinned = np.array([[0, 1, 2], [3, 3, 3]])
    np.testing.assert_array_equal(t.fan_counts(pinned, _edges(pinned), 4), [1, 1, 1, 0])


def test_euler_characteristic() -> None:
    """V - E + F is 2 for a sphere and 0 for a torus."""
    for mesh, euler in ((icosphere(2), 2), (torus(segments=12, rings=7), 0)):
        assert len(mesh.vertices) - len(_edges(mesh.faces).start) + len(mesh.faces) == euler


def test_loops() -> None:
    square, other = [[0, 1], [1, 2], [2, 3], [0, 3]], [[10, 11], [11, 12], [10, 12]]
    labels = t.loop_labels(np.array([square[0], other[0], *square[1:], *other[1:]]))
    np.testing.assert_array_equal(labels, [0, 1, 0, 0, 0, 1, 1])
    assert len(t.loop_labels(np.zeros((0, 2), dtype=np.int64))) == 0


def test_weld_joins_equal_positions_only() -> None:
    points = np.array([[0.0, 1, 2], [0, 1, 2.5], [-0.0, 1, 2], [0, 1, 2 + 1e-12]])
    numbers = t.weld(points)
    assert numbers[0] == numbers[2] and len(set(numbers)) == 3
    turned = Rotation.from_rotvec([1, 2, 3]).apply(np.repeat(icosphere(1).vertices, 3, axis=0))
    assert t.weld(turned).max() + 1 == 42
