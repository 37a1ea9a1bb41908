"""Signed distances against their formulas, and marching-cubes surfaces against known volumes."""

import numpy as np
import pytest

from gash_jax.shapes.sdf import (
    Field,
    box,
    capsule,
    creases,
    cylinder,
    placed,
    shell,
    smooth_minimum,
    sphere,
    subtract,
    surface_of,
    torus,
    union,
    value_noise,
    wave_noise,
    winding_folds,
)
from gash_jax.shapes.triangles import signed_volume

TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # x -> y


@pytest.mark.parametrize(
    ("field", "point", "value"),
    [
        (sphere((1, 0, 0), 0.5), (3, 0, 0), 1.5),
        (capsule((0, 0, 0), (2, 0, 0), 0.5, 0.1), (1, 1, 0), 0.7),
        (capsule((0, 0, 0), (2, 0, 0), 0.5, 0.1), (-1, 0, 0), 0.5),
        (box((1, 2, 3)), (4, 6, 3), 5.0),
        (box((1, 2, 3)), (0.5, 0, 0), -0.5),
        (cylinder(1.0, 0.5), (3, 0, 0), 2.0),
        (cylinder(1.0, 0.5), (0, 2, 0), 1.5),
        (torus(2.0, 0.5), (0, 0, 2), -0.5),
        (torus(2.0, 0.5), (0, 3, 2), 2.5),
        (placed(box((1, 0.1, 0.1)), TURN, (0, 0, 5)), (0, 0.9, 5), -0.1),
        (shell(sphere((0, 0, 0), 1.0), 0.2), (0.9, 0, 0), -0.1),
        (shell(sphere((0, 0, 0), 1.0), 0.2), (0, 0, 0), 0.8),
        (subtract(sphere((0, 0, 0), 1.0), [sphere((0, 0, 0), 0.4)]), (0, 0, 0), 0.4),
        (union([sphere((0, 0, 0), 1.0), sphere((3, 0, 0), 1.0)]), (1.5, 0, 0), 0.5),
    ],
)
def test_distances(field: Field, point: tuple[float, float, float], value: float) -> None:
    assert float(field(np.array([point], np.float32))[0]) == pytest.approx(value, abs=1e-6)


def test_smooth_minimum_is_sharp_outside_its_width_and_lower_inside() -> None:
    a, b = np.array([0.0, 0.0, 0.3]), np.array([0.5, 0.1, 0.3])
    np.testing.assert_allclose(smooth_minimum(a, b, 0.2), [0.0, -0.0125, 0.25])
    np.testing.assert_array_equal(smooth_minimum(a, b, 0.0), [0, 0, 0.3])


@pytest.mark.parametrize("target", [800, 3000])
@pytest.mark.parametrize("seed", range(3))
def test_surface_has_the_count_the_volume_and_the_winding(seed: int, target: int) -> None:
    surface = surface_of(torus(1.0, 0.4), np.random.default_rng(seed), target, 1.8)
    assert len(surface.vertices) == pytest.approx(target, rel=0.15)
    deficit = 1 - signed_volume(surface) / (2 * np.pi**2 * 0.16)  # chords cut the surface: proportional to 1 / count
    assert 0 < deficit < 40 / target
    assert len(surface.vertices) - len(surface.faces) // 2 == 0  # Euler characteristic of a torus


def test_surface_drops_crumbs_and_closes_what_leaves_the_ball() -> None:
    crumbs = union([sphere((0, 0, 0), 1.0), sphere((1.4, 0, 0), 0.08)])
    surface = surface_of(crumbs, np.random.default_rng(0), 2000, 1.6)
    assert surface.vertices[:, 0].max() < 1.1
    endless = surface_of(cylinder(0.5, 99.0), np.random.default_rng(0), 1500, 1.5)
    assert len(endless.vertices) - len(endless.faces) // 2 == 2


def test_noises_are_bounded_and_repeat_for_a_seed() -> None:
    points = np.random.default_rng(0).uniform(-3, 3, size=(5000, 3)).astype(np.float32)
    values = value_noise(np.random.default_rng(1), 2.0, octaves=3)(points)
    np.testing.assert_array_equal(values, value_noise(np.random.default_rng(1), 2.0, octaves=3)(points))
    assert np.abs(values).max() <= 1.75 and values.std() > 0.2
    assert np.abs(np.diff(value_noise(np.random.default_rng(1), 1.0, octaves=1)(points[:1] + np.zeros((2, 3))))) == 0
    waves = wave_noise(np.random.default_rng(2), 1.0, 4)(points)
    assert np.abs(waves).max() <= 3.2 and 0.5 < waves.std() < 1.6


def test_furrows_and_folds_of_a_known_noise() -> None:
    points = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0]], np.float32)
    np.testing.assert_allclose(creases(lambda p: p[:, 0], 0.5)(points), np.exp([0.0, -1, -4]), rtol=1e-6)
    np.testing.assert_allclose(winding_folds(lambda p: p[:, 0], 1.0)(points), [1, 0, 1], atol=1e-6)
