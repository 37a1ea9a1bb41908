"""Parts as drawing programs export them: closed, of few large faces, with what they are there for."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, RawMesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.drawn import Hole, _cap, _circle, _merged, _outline, _plate_faces, shaft
from gash_jax.shapes.procedural import DRAWN, RECIPES, make_shape
from gash_jax.shapes.triangles import signed_volume
from tests.helpers.recipes import assert_repeatable, closed, made
from tests.helpers.transfer_formulas import Y00

SQUARE = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])


@pytest.mark.parametrize("kind", DRAWN)
def test_closed_of_about_unit_size_with_no_more_vertices_than_asked_for(kind: str) -> None:
    for target in (200, 700, 3000):
        for seed in range(6):
            mesh = made(DRAWN[kind], seed, target)
            assert closed(mesh.faces) and np.isfinite(mesh.vertices).all()
            assert 20 < len(mesh.vertices) <= 1.3 * target
            assert 0.3 < np.abs(mesh.vertices).max() < 1.5
            assert signed_volume(RawMesh(mesh.vertices.astype(float), mesh.faces.astype(np.int64))) > 0


@pytest.mark.parametrize("kind", DRAWN)
def test_the_same_again_and_another_for_another_seed(kind: str) -> None:
    assert_repeatable(DRAWN[kind])


def _slenderness(mesh: Mesh) -> float:
    """Median over the faces of the longest side over the shortest."""
    corners = mesh.vertices[mesh.faces].astype(float)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    return float(np.median(sides.max(1) / sides.min(1)))


def test_faces_are_slender_where_those_of_other_kinds_are_not() -> None:
    for recipe in DRAWN.values():
        assert np.median([_slenderness(made(recipe, seed, 700)) for seed in range(6)]) > 3
    assert _slenderness(made(RECIPES["plate"], 0, 700)) < 3


@pytest.mark.slow
def test_between_stacked_plates_it_is_dark() -> None:
    seen = [
        bake_transfer(made(DRAWN["stacked"], s, 500), 1, 64, replicates=1).coefficients[:, 0] / Y00 for s in range(8)
    ]
    assert np.mean(np.concatenate(seen) < 0.1) > 0.15


def test_a_plate_with_one_of_every_hole_by_hand() -> None:
    """Volume of a square plate: less an open hole, a pocket and a stepped one, and with a boss on it."""
    corners, height = 24, 0.5
    ring = [0.3 * _circle(corners) + at for at in ([-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5])]
    bore = 0.1 * _circle(corners) + [0.5, 0.5]
    holes = [Hole(ring[0], None, None), Hole(ring[1], 0.2, None), Hole(ring[2], 0.2, bore), Hole(ring[3], 0.9, None)]
    surface = _merged(_plate_faces(SQUARE, holes, height))
    disk = 0.5 * corners * np.sin(2 * np.pi / corners)  # area over the square of the radius
    expected = 4 * height + disk * (0.09 * (-0.5 - 0.3 - 0.3 + 0.4) - 0.01 * 0.2)
    assert signed_volume(surface) == pytest.approx(expected, rel=1e-9)
    assert closed(surface.faces)
    # nothing but the corners of the drawing: two rims of each wall
    assert len(surface.vertices) == 2 * 4 + corners * (2 + 2 + 4 + 2)


def test_a_cap_has_its_holes() -> None:
    hole = 0.5 * _circle(12)
    cap = _cap(SQUARE, [hole], 2.0)
    a, b, c = cap.vertices[cap.faces].transpose(1, 0, 2)
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert area.sum() == pytest.approx(4 - 0.25 * 6 * np.sin(2 * np.pi / 12)) and (area > 0).all()
    np.testing.assert_array_equal(cap.vertices[:, 2], 2)


def test_outlines_are_convex_and_counter_clockwise() -> None:
    for seed in range(40):
        loop = _outline(np.random.default_rng(seed))
        step = np.roll(loop, -1, axis=0) - loop
        turn = step[:, 0] * np.roll(step, -1, axis=0)[:, 1] - step[:, 1] * np.roll(step, -1, axis=0)[:, 0]
        assert (turn > 0).all() and np.linalg.norm(loop, axis=1).max() < 1 + 1e-9


def test_shafts_are_round_about_y() -> None:
    for seed in range(5):
        vertices = shaft(np.random.default_rng(seed), 600).vertices
        radius = np.hypot(vertices[:, 0], vertices[:, 2])
        assert len(np.unique(np.round(radius, 9))) < 20


def test_they_are_kinds_of_the_whole_corpus_only() -> None:
    found = {make_shape(0, index, (200, 300), "all")[0] for index in range(27)}
    assert set(DRAWN) <= found and not set(DRAWN) & set(RECIPES)
