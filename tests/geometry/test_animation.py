import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.geometry.animation import Animation, Blend, Recorded, blend_rows, unit_weights
from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.shapes.primitives import icosphere

BALL = icosphere(1)
COUNT = len(BALL.vertices)
STILL = np.eye(3, 4)
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # 90 degrees about z: x -> y


def _blend(shapes: int, bones: int) -> Blend:
    rng = np.random.default_rng(0)
    weights = rng.random((COUNT, bones))
    weights = weights / weights.sum(axis=1, keepdims=True) if bones else weights
    return Blend(BALL.vertices, rng.normal(size=(shapes, COUNT, 3)).astype(np.float32), weights)


def _row(weights: list[float], *matrices: np.ndarray) -> np.ndarray:
    return blend_rows(np.array([weights]), np.array([matrices]).reshape(1, len(matrices), 3, 4))[0]


def test_one_bone_turned_by_90_degrees_by_hand() -> None:
    rest = np.array([[1.0, 0, 0], [2, 0, 0], [3, 0, 0]], np.float32)
    elbow = np.concatenate([TURN, [[2.0], [-2], [0]]], axis=1)  # about (2, 0, 0)
    motion = Blend(rest, np.zeros((0, 3, 3), np.float32), np.array([[1.0, 0], [0.5, 0.5], [0, 1]]))
    np.testing.assert_allclose(motion(_row([], STILL, elbow)), [[1, 0, 0], [2, 0, 0], [2, 1, 0]], atol=1e-6)


def test_shapes_come_before_bones() -> None:
    rest = np.array([[1.0, 0, 0]], np.float32)
    motion = Blend(rest, np.array([[[1, 0, 0]]], np.float32), np.ones((1, 1)))
    turn = np.concatenate([TURN, [[0.0], [0], [5]]], axis=1)
    np.testing.assert_allclose(motion(_row([0.5], turn)), [[0, 1.5, 5]], atol=1e-6)


@pytest.mark.parametrize(("shapes", "bones"), [(0, 0), (3, 0), (0, 2), (3, 2)])
def test_the_rest_is_the_pose_of_no_weight_and_no_motion(shapes: int, bones: int) -> None:
    row = _row([0.0] * shapes, *[STILL] * bones)
    np.testing.assert_allclose(_blend(shapes, bones)(row), BALL.vertices, atol=1e-6)


def test_one_motion_of_all_bones_moves_rigidly() -> None:
    rotation = Rotation.from_rotvec([0.3, -1, 2]).as_matrix()
    matrix = np.concatenate([rotation, [[1.0], [2], [3]]], axis=1)
    moved = _blend(0, 3)(_row([], matrix, matrix, matrix))
    np.testing.assert_allclose(moved, BALL.vertices @ rotation.T + [1, 2, 3], atol=1e-5)


def test_blendshapes_are_linear() -> None:
    motion, rng = _blend(4, 0), np.random.default_rng(1)
    a, b = rng.random((2, 4)).astype(np.float32)
    together = motion(a + b) - motion(0 * a)
    np.testing.assert_allclose(together, motion(a) + motion(b) - 2 * motion(0 * a), atol=1e-5)
    expected = BALL.vertices + np.einsum("k,kvi->vi", a, motion.deltas)
    np.testing.assert_allclose(motion(a), expected, atol=1e-5)


def test_the_reach_bounds_every_frame() -> None:
    rng = np.random.default_rng(2)
    for shapes, bones in ((3, 0), (0, 2), (3, 2)):
        motion, rows = _blend(shapes, bones), rng.normal(size=(6, shapes + 12 * bones)).astype(np.float32)
        largest = np.array([np.abs(motion(row)).max() for row in rows])
        assert (motion.reach(rows) >= largest).all() and (motion.reach(rows) < 30 * largest).all()
    rest = np.array([[1.0, -2, 0]], np.float32)
    motion = Blend(rest, np.array([[[0, 3, 0]]], np.float32), np.ones((1, 1)))
    row = _row([-2.0], np.concatenate([TURN, [[0.5], [0], [0]]], axis=1))
    np.testing.assert_allclose(motion.reach(row[None]), [2 + 2 * 3 + 0.5])
    assert np.isnan(motion.reach(row[None] * np.nan)).all()


def test_frames_rows_and_views_of_them() -> None:
    motion = _blend(2, 3)
    weights, matrices = (
        np.random.default_rng(0).random((5, 2)),
        np.tile(STILL, (5, 3, 1, 1)) + np.arange(5).reshape(5, 1, 1, 1),
    )
    animation = Animation(BALL, blend_rows(weights, matrices), tuple("abcde"), motion)
    np.testing.assert_allclose(animation.shape_weights, weights, rtol=1e-6)
    np.testing.assert_allclose(animation.transforms, matrices, rtol=1e-6)
    assert len(animation) == 5
    for number, points in enumerate(animation.frames()):
        assert points.dtype == np.float32
        np.testing.assert_array_equal(points, animation.frame(number))
    again = animation._replace(parameters=animation.parameters[3:4])
    np.testing.assert_array_equal(again.frame(0), animation.frame(3))
    with pytest.raises(ValueError, match="frame is 5: use a whole number from 0 to 4"):
        animation.frame(5)


def test_recorded_frames_are_made_one_by_one() -> None:
    frames = np.arange(18, dtype=np.float64).reshape(2, 3, 3)
    mesh = Mesh(frames[0].astype(np.float32), np.zeros((3, 3), np.float32), np.array([[0, 1, 2]], np.int32))
    animation = Animation(mesh, np.arange(2.0)[:, None], ("frame",), Recorded(frames))
    np.testing.assert_array_equal(animation.frame(1), frames[1])
    assert animation.shape_weights.shape == (2, 0) and animation.transforms.shape == (2, 0, 3, 4)
    turned = Recorded(frames, TURN)
    np.testing.assert_allclose(turned(np.array([1.0])), frames[1] @ TURN.T)


def test_weights_of_bones_are_made_to_sum_to_1() -> None:
    weights, notes = unit_weights(np.array([[0.25, 0.75], [1.0, 1.0], [0.999, 0.0]], np.float32))
    np.testing.assert_allclose(weights, [[0.25, 0.75], [0.5, 0.5], [1, 0]])
    assert notes == ("weights of bones of 1 vertices sum to something else than 1 (first: 1, 2): divided by their sum",)
    assert unit_weights(np.array([[1.0]]))[1] == ()


@pytest.mark.parametrize("bad", [[0.0, 0.0], [np.nan, 1.0], [-0.5, 1.5]])
def test_unusable_weights_are_refused(bad: list[float]) -> None:
    with pytest.raises(MeshError, match="1 vertices have no usable weights of bones \\(first: 1"):
        unit_weights(np.array([[1.0, 0.0], bad]))
