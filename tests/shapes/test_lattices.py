"""Box lattices: volumes and counts by hand, closed whatever is filled."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.lattices import boxes, lattice, lattice_surface
from gash_jax.shapes.triangles import signed_volume


def assert_closed(surface: RawMesh) -> None:
    edges = np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])
    np.testing.assert_array_equal(np.sort(edges @ [10**6, 1]), np.sort(edges @ [1, 10**6]))


def test_one_box_by_hand() -> None:
    surface = lattice_surface(np.ones((1, 1, 1), bool), [np.array([1.0, 3.0])] * 3, np.random.default_rng(0))
    assert surface.vertices.shape == (8, 3) and surface.faces.shape == (12, 3)
    np.testing.assert_array_equal(np.unique(surface.vertices), [-1, 1])
    assert signed_volume(surface) == pytest.approx(8.0)


def test_l_shape_and_frame_by_hand() -> None:
    spans = [np.array([0.0, 1, 3]), np.array([0.0, 2, 3]), np.array([0.0, 1])]
    filled = np.array([[[True], [True]], [[True], [False]]])
    surface = lattice_surface(filled, spans, np.random.default_rng(0))
    assert_closed(surface)
    assert signed_volume(surface) == pytest.approx(2 + 1 + 4)
    frame = np.ones((3, 3, 1), bool)
    frame[1, 1] = False
    ring = lattice_surface(frame, [np.arange(4.0), np.arange(4.0), np.arange(2.0)], np.random.default_rng(0))
    assert_closed(ring)
    assert signed_volume(ring) == pytest.approx(8.0)
    assert len(ring.vertices) - len(ring.faces) // 2 == 0  # one hole


@pytest.mark.parametrize("recipe", [lattice, boxes])
def test_recipes_are_closed_for_many_seeds(recipe) -> None:
    for seed in range(40):
        surface = recipe(np.random.default_rng(seed), 1000)
        assert_closed(surface)
        assert signed_volume(surface) > 0
        assert len(surface.vertices) <= 1300


def test_lattice_edges_have_two_faces() -> None:
    for seed in range(40):
        faces = lattice(np.random.default_rng(seed), 1000).faces
        edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        assert len(np.unique(edges @ [10**6, 1])) == len(edges)
