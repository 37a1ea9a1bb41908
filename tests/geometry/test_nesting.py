import numpy as np
import pytest

from gash_jax.geometry.mesh import concatenate, transform
from gash_jax.geometry.nesting import containment
from gash_jax.shapes.primitives import box, icosphere, torus
from tests.helpers.bumpy import random_rotation


def _inside(*meshes, solid=None) -> np.ndarray:
    scene = concatenate(meshes)
    sheet = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    chosen = np.ones(len(meshes), dtype=bool) if solid is None else np.array(solid)
    return containment(scene.vertices[scene.faces].astype(np.float64), sheet, chosen)


def test_shells_within_shells() -> None:
    shells = [transform(icosphere(2), scale=scale) for scale in (1.0, 3.0, 2.0)]
    expected = np.array([[0, 1, 1], [0, 0, 0], [0, 1, 0]], dtype=bool)
    np.testing.assert_array_equal(_inside(*shells), expected)
    np.testing.assert_array_equal(_inside(*shells, solid=[True, False, True]), [[False, True], [False, False]])


@pytest.mark.parametrize("seed", range(8))
def test_any_position_in_a_box(seed: int) -> None:
    """Against the box's own definition of inside, in any orientation; balls that stick out a little are left aside."""
    rng = np.random.default_rng(seed)
    rotation = random_rotation(seed)
    balls = [transform(icosphere(1), None, rng.uniform(-1.5, 1.5, size=3), 0.05) for _ in range(20)]
    depth = [np.abs(ball.vertices).max() for ball in balls]
    balls = [ball for ball, d in zip(balls, depth, strict=True) if not 1 <= d < 1.1]
    expected = [np.all(np.abs(ball.vertices) < 1) for ball in balls]
    moved = [transform(mesh, rotation) for mesh in [transform(box(), scale=2.0), *balls]]
    assert 0 < sum(expected) < len(balls)
    np.testing.assert_array_equal(_inside(*moved)[1:, 0], expected)


def test_in_the_hole_of_a_torus_is_outside() -> None:
    ball = transform(icosphere(1), scale=0.2)
    assert not _inside(torus(), ball).any()
    within = transform(ball, translation=np.array([1.0, 0, 0]))
    np.testing.assert_array_equal(_inside(torus(), within), [[False, False], [True, False]])


def test_a_ball_that_looks_out_is_not_inside() -> None:
    """Its bounding box is inside that of the outer one, but some of it is not."""
    shape = torus(1.0, 0.3)
    half_out = transform(icosphere(2), None, np.array([0.7, 0, 0]), 0.15)
    assert not _inside(shape, half_out).any()
