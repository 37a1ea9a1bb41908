import time
import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.geometry import nesting
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, concatenate, transform
from gash_jax.geometry.nesting import containment
from gash_jax.shapes.primitives import box, bumpy_sphere, icosphere, torus
from tests.helpers.bumpy import random_rotation


def _inside(*meshes, solid=None) -> np.ndarray:
    scene = concatenate(meshes)
    sheet = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    chosen = np.ones(len(meshes), dtype=bool) if solid is None else np.array(solid)
    pairs = containment(scene.vertices[scene.faces].astype(np.float64), sheet, chosen)
    inside = np.zeros((np.count_nonzero(chosen),) * 2, dtype=bool)
    inside[tuple(pairs.T)] = True
    assert len(pairs) == inside.sum()
    return inside


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


def _scattered(seed: int) -> list[Mesh]:
    """Bumpy balls of many sizes, half of them crowded round the origin: disjoint, nested and crossing."""
    rng = np.random.default_rng(seed)
    scales = 10 ** rng.uniform(-1.5, 0.3, size=60)
    return [
        transform(bumpy_sphere(2), random_rotation(i), rng.normal(size=3) * (i % 2), s) for i, s in enumerate(scales)
    ]


@pytest.mark.parametrize("at_once", [1, 50, 1 << 20])
def test_against_the_definition_pair_by_pair(at_once: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """All sheets against all, all rays against all triangles, by solid angle instead of crossings."""
    monkeypatch.setattr(nesting, "_AT_ONCE", at_once)
    meshes = _scattered(3)
    turn = Rotation.from_rotvec([0.613, -1.127, 0.829]).as_matrix()
    corners = [mesh.vertices[mesh.faces].astype(np.float64) @ turn.T for mesh in meshes]
    expected = np.zeros((len(meshes),) * 2, dtype=bool)
    for i, inner in enumerate(corners):
        picks = np.linspace(0, len(inner) - 1, nesting.SAMPLES).astype(np.int64)
        for j, outer in enumerate(corners):
            within = np.all(inner.min((0, 1)) > outer.min((0, 1))) and np.all(inner.max((0, 1)) < outer.max((0, 1)))
            expected[i, j] = within and all(_solid_angle(outer - p) > 2 * np.pi for p in inner[picks].mean(axis=1))
    assert 20 < expected.sum() < 1000
    np.testing.assert_array_equal(_inside(*meshes), expected)


def _solid_angle(triangles: np.ndarray) -> float:
    """Of triangles seen from the origin (van Oosterom & Strackee 1983): 4 pi inside a closed surface, 0 outside."""
    a, b, c = np.moveaxis(triangles / np.linalg.norm(triangles, axis=-1, keepdims=True), 1, 0)
    cosines = 1 + (a * b).sum(-1) + (b * c).sum(-1) + (c * a).sum(-1)
    return float(2 * np.arctan2((a * np.cross(b, c)).sum(-1), cosines).sum())


def test_twenty_thousand_parts_take_seconds_and_little_memory() -> None:
    """Ten thousand hollow boxes: the walls of a hollow lie inside one box and face into it, as the file says."""
    cube, count = box(), 10_000
    place = np.stack(np.unravel_index(np.arange(count), (22, 22, 22)), axis=1)[:, None] * 2.0
    vertices = np.concatenate([cube.vertices + place, cube.vertices * 0.5 + place]).reshape(-1, 3)
    faces = np.concatenate([np.tile(cube.faces, (count, 1, 1)), np.tile(cube.faces[:, ::-1], (count, 1, 1))])
    faces = (faces + len(cube.vertices) * np.arange(2 * count)[:, None, None]).reshape(-1, 3)
    tracemalloc.start()
    start = time.process_time()
    _, report = prepare_mesh(vertices, faces)
    seconds, peak = time.process_time() - start, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert report.counts["inward_surfaces"] == 0 and report.counts["seamed_surfaces"] == 2 * count
    assert seconds < 5 and peak < 1 << 30
