"""Gears, plates and brackets: closed for every seed; plates have the volume of their drawing."""

import numpy as np
import pytest

from gash_jax.shapes.mechanical import _extruded, bracket, gear, plate
from gash_jax.shapes.triangles import signed_volume


def test_extrusion_with_a_square_hole_by_hand() -> None:
    rim = np.array([[-2.0, -2], [2, -2], [2, 2], [-2, 2]])
    hole = np.array([[-1.0, -1], [-1, 1], [1, 1], [1, -1]])
    prism = _extruded([rim, hole], 0.5)
    assert signed_volume(prism) == pytest.approx((16 - 4) * 0.5)
    assert len(prism.vertices) == 16 and len(prism.vertices) - len(prism.faces) // 2 == 0


@pytest.mark.parametrize("recipe", [gear, plate, bracket])
def test_recipes_are_closed_and_wound_outward(recipe) -> None:
    for seed in range(12):
        surface = recipe(np.random.default_rng(seed), 1200)
        edges = np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])
        np.testing.assert_array_equal(np.sort(edges @ [10**6, 1]), np.sort(edges @ [1, 10**6]))
        assert signed_volume(surface) > 0
        assert len(surface.vertices) < 1500


def test_plates_have_holes() -> None:
    genus = [
        1 - (len(s.vertices) - len(s.faces) // 2) / 2 for s in (plate(np.random.default_rng(i), 1500) for i in range(8))
    ]
    assert max(genus) > 5
