"""What patches read of a pose: axes that move with them, kernels by hand, and which reading is chosen."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.animation import Animation, Recorded
from gash_jax.models.kernel_regression import products_of
from gash_jax.models.surroundings import (
    GROUPS,
    POINTS,
    REACH,
    SURROUNDINGS,
    WAYS,
    matern,
    patch_axes,
    pose_kernel,
    seen_points,
)
from gash_jax.models.surroundings_fit import divide_surface, find_candidates, patch_anchors, read_patch
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.bumpy import random_rotation

MESH = bumpy_sphere(6)
COUNT = len(MESH.vertices)
POINTS_OF = MESH.vertices.astype(np.float64)
MOVING = blendshape_animation(MESH, 0, 60, 5)
RNG = np.random.default_rng(9)


def readings(moving: Animation, outputs: np.ndarray, count: int = 6) -> dict[str, Any]:
    """The arrays of all patches, for outputs (t, v) of a number a vertex."""
    patch, middles = divide_surface(POINTS_OF, count)
    unit = float(np.linalg.norm(np.ptp(POINTS_OF, axis=0)))
    candidates = find_candidates(moving, middles, unit)
    found = []
    for number in range(len(middles)):
        own = outputs[:, patch == number].astype(np.float32)
        reading = read_patch(candidates, number, products_of(own), own.shape[1])
        found.append({**reading.arrays, "known": reading.knowing(99)[0]})
    stacked = {name: np.stack([arrays[name] for arrays in found]) for name in found[0]}
    return {**stacked, "anchors": candidates.anchors, "axes": candidates.axes, "unit": np.array([unit])}


@pytest.fixture(scope="module")
def arrays() -> dict[str, Any]:
    outputs = np.stack([frame[:, 0] for frame in MOVING.frames()]) + 0.001 * RNG.normal(size=(60, COUNT))
    found = readings(MOVING, outputs)
    return {name: jnp.asarray(np.asarray(array, np.float32)) for name, array in found.items()}


def test_patches_cover_the_surface() -> None:
    patch, middles = divide_surface(POINTS_OF, 6)
    assert set(patch) == set(range(6)) and len(middles) == 6 and np.bincount(patch).max() < 2 * COUNT / 6


def test_the_kernel_by_hand() -> None:
    far = np.sqrt(3) * 5 / REACH
    np.testing.assert_allclose(matern(np.array([0.0, 25])), [1, (1 + far) * np.exp(-far)])


def test_axes_by_hand() -> None:
    """Anchors at the corners of a rectangle, 2 long and 1 wide: x along the long side, y along the other."""
    corners = np.array([[-1.0, -0.5, 0], [1, -0.5, 0], [1, 0.5, 0], [-1, 0.5, 0]])
    axes = corners[None, :, :2] / 5.0
    middle, rows = patch_axes(jnp.asarray(corners + 3, jnp.float32), np.arange(4)[None], axes.astype(np.float32))
    np.testing.assert_allclose(middle, [[3, 3, 3]], atol=1e-6)
    np.testing.assert_allclose(rows[0], np.eye(3), atol=1e-6)
    found, ways = patch_anchors(corners, np.arange(4), np.zeros((1, 3)), 4)
    assert sorted(found[0]) == [0, 1, 2, 3]
    np.testing.assert_allclose(np.abs(ways[0]), np.abs(corners[found[0], :2]) / 5.0, atol=1e-12)


def test_what_a_patch_sees_does_not_change_when_the_body_moves(arrays: dict[str, Any]) -> None:
    turn, frame = random_rotation(3), MOVING.frame(7).astype(np.float64)
    moved = (frame @ turn.T + [1.0, -2.0, 0.5]).astype(np.float32)
    anchors, points = (np.asarray(arrays[name]).astype(int) for name in ("anchors", "points"))
    ways = np.asarray(arrays["axes"])
    still, other = (seen_points(jnp.asarray(p), anchors, ways, points) for p in (frame.astype(np.float32), moved))
    np.testing.assert_allclose(other, still, atol=2e-6)
    _, rows = patch_axes(jnp.asarray(moved), anchors, ways)
    np.testing.assert_allclose(rows @ rows.transpose(0, 2, 1), np.broadcast_to(np.eye(3), rows.shape), atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(rows), 1, atol=1e-5)
    kernels = [pose_kernel(arrays, jnp.asarray(p)) for p in (frame.astype(np.float32), moved)]
    np.testing.assert_allclose(kernels[1], kernels[0], atol=1e-4)


def test_the_kernel_of_a_pose_against_a_loop(arrays: dict[str, Any]) -> None:
    both = {**arrays, "together": jnp.asarray([1.0, 0, 1, 0, 1, 0])}
    frame = jnp.asarray(MOVING.frame(11))
    found = np.asarray(pose_kernel(both, frame))
    held = {name: np.asarray(array, np.float64) for name, array in both.items()}
    anchors, points = (held[name].astype(int) for name in ("anchors", "points"))
    seen = np.asarray(seen_points(frame, anchors, np.asarray(arrays["axes"]), points)) / held["unit"]
    for patch in range(6):
        told = (seen[patch] - held["still"][patch]).ravel() @ held["into"][patch]
        for pose in range(0, 60, 7):
            squares, amounts = (told - held["known"][patch, :, pose]) ** 2, held["amounts"][patch]
            if held["together"][patch]:
                expected = amounts[0] * matern(np.array(squares.sum()))
            else:
                expected = amounts @ matern(squares.reshape(GROUPS, -1).sum(axis=1))
            assert found[patch, pose] == pytest.approx(expected, abs=1e-5)


def test_transforms(arrays: dict[str, Any]) -> None:
    frames = jnp.stack([jnp.asarray(MOVING.frame(number)) for number in range(3)])
    one = jnp.stack([pose_kernel(arrays, frame) for frame in frames])
    np.testing.assert_allclose(jax.vmap(lambda frame: pose_kernel(arrays, frame))(frames), one, atol=1e-5)
    np.testing.assert_allclose(jax.jit(pose_kernel)(arrays, frames[0]), one[0], atol=1e-5)
    for frame in (frames[0], jnp.zeros_like(frames[0])):  # collapsed to a point
        slope = jax.grad(lambda p: pose_kernel(arrays, p).sum())(frame)
        assert np.isfinite(slope).all()


def test_training_poses_know_themselves(arrays: dict[str, Any]) -> None:
    assert {name: len(array.shape) for name, array in arrays.items()} == {k: len(s) for k, s in SURROUNDINGS.items()}
    assert arrays["points"].shape == (6, POINTS) and arrays["known"].shape == (6, WAYS, 60)
    for number in (0, 33):
        kernel = np.asarray(pose_kernel(arrays, jnp.asarray(MOVING.frame(number))))
        np.testing.assert_allclose(kernel[:, number], np.asarray(arrays["amounts"]).sum(axis=1), atol=1e-3)
        assert np.all(kernel.argmax(axis=1) == number)


def two_parts(frames: int) -> Animation:
    """A ball whose left and right quarter are each moved as a whole, at random and for itself."""
    side = np.sign(POINTS_OF[:, 0]) * (np.abs(POINTS_OF[:, 0]) > 0.55)
    moves = RNG.normal(size=(frames, 2, 3)) * 0.3
    seen = POINTS_OF + np.where(side[:, None] > 0, moves[:, None, 0], np.where(side[:, None] < 0, moves[:, None, 1], 0))
    return Animation(MESH, np.arange(float(frames))[:, None], ("frame",), Recorded(seen.astype(np.float32)))


def test_parts_are_added_up_where_each_has_an_effect_of_its_own() -> None:
    """Every vertex has the sum of a function of each side's place, one that no neighbour tells."""
    moving = two_parts(150)
    frames = np.stack(list(moving.frames()))
    left, right = (frames[:, np.argmax(way * POINTS_OF[:, 0])] for way in (-1, 1))
    both = (np.sin(5 * left) + np.cos(4 * right)).sum(axis=1)
    middle = np.abs(POINTS_OF[:, 0]) < 0.45
    outputs = np.where(middle, both[:, None] * (1 + POINTS_OF[:, 1]), 0) + 0.01 * RNG.normal(size=(150, COUNT))
    patch, _ = divide_surface(POINTS_OF, 24)
    found = readings(moving, outputs, 24)
    inner = np.flatnonzero(np.bincount(patch[middle], minlength=24) > 0.95 * np.bincount(patch))
    assert len(inner) and not found["together"][inner].any()
    for number in inner:
        moves = (np.abs(POINTS_OF[found["points"][number], 0]) > 0.55).reshape(GROUPS, -1).any(axis=1)
        assert found["amounts"][number][~moves].sum() < 0.05
    np.testing.assert_allclose(found["amounts"].sum(axis=1), 1, rtol=1e-5)


def test_what_is_near_is_read_together_where_it_alone_matters() -> None:
    frames = np.stack(list(MOVING.frames())).astype(np.float64)
    patch, _ = divide_surface(POINTS_OF, 6)
    outputs = np.empty((60, COUNT))
    for number in range(6):  # how far the patch's own vertices are apart
        own = frames[:, patch == number]
        apart = np.linalg.norm(own - own.mean(axis=1, keepdims=True), axis=2)
        outputs[:, patch == number] = np.sin(20 * apart)
    assert readings(MOVING, outputs)["together"].sum() >= 4
