"""The table of a vertex's edges: against the edges of the mesh, by hand, whatever the order of the faces."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import unique_edges
from gash_jax.graph.edge_table import edge_table
from gash_jax.shapes.primitives import bumpy_sphere, grid


def _pairs(table: np.ndarray, found: np.ndarray) -> set[tuple[int, int]]:
    return {(int(i), int(j)) for i, j in zip(*np.nonzero(found), strict=True) for j in [table[i, j]]}


def test_of_a_closed_mesh_it_holds_every_edge_in_both_directions() -> None:
    faces = bumpy_sphere(6).faces
    count = int(faces.max()) + 1
    edges = unique_edges(faces)
    width = int(np.bincount(edges.ravel()).max())
    expected = {(int(i), int(j)) for i, j in edges} | {(int(j), int(i)) for i, j in edges}
    table, found = edge_table(faces, count, width)
    assert _pairs(table, found) == expected
    assert found.sum() == len(expected)


def test_at_a_boundary_one_edge_is_left_out() -> None:
    _, _, faces = grid(3, 3)
    edges = unique_edges(faces)
    table, found = edge_table(faces, 16)
    pairs = _pairs(table, found)
    assert {tuple(sorted(pair)) for pair in pairs} == {(int(i), int(j)) for i, j in np.sort(edges, axis=1)}
    boundary = 12
    assert len(pairs) == 2 * len(edges) - boundary


@pytest.mark.parametrize("width", [1, 3])
def test_a_narrow_table_holds_some_of_the_edges_and_is_full_of_the_vertex_itself_elsewhere(width: int) -> None:
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4]], np.int32)
    table, found = edge_table(faces, 6, width)
    assert table.shape == found.shape == (6, width)
    assert found[0].all() and set(table[0]) <= {1, 2, 3}
    assert not found[5].any() and (table[~found] == np.nonzero(~found)[0]).all()


def test_without_faces_there_is_no_edge() -> None:
    table, found = edge_table(np.zeros((0, 3), np.int32), 3)
    assert not found.any()
    np.testing.assert_array_equal(table, np.arange(3)[:, None].repeat(table.shape[1], 1))


def test_the_checker_sees_a_missing_edge() -> None:
    faces = bumpy_sphere(6).faces
    table, found = edge_table(faces, int(faces.max()) + 1)
    whole = _pairs(table, found)
    found[3, 0] = False
    assert _pairs(table, found) != whole
