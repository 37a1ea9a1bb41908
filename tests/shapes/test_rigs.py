import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.geometry.animation import Animation, Blend
from gash_jax.geometry.mesh import face_components
from gash_jax.geometry.topology import build_edges
from gash_jax.shapes.rigs import Bone, figure_animation, figure_bones, posed_transforms, skin_weights

CHAIN = [
    Bone("upper", -1, np.array([0.0, 0, 0]), np.array([1.0, 0, 0]), 0.1),
    Bone("lower", 0, np.array([1.0, 0, 0]), np.array([2.0, 0, 0]), 0.1),
]


@pytest.fixture(scope="module")
def figure() -> Animation:
    return figure_animation(0, 8, 1200)


def test_a_chain_bent_by_hand() -> None:
    """The upper bone up by 90 degrees, the lower one back by 90: an elbow."""
    turns = np.array([[[0, 0, np.pi / 2], [0, 0, -np.pi / 2]]])
    upper, lower = posed_transforms(CHAIN, turns)[0]
    points = np.array([[1.0, 0, 0, 1], [2.0, 0, 0, 1]])
    np.testing.assert_allclose(points @ upper.T, [[0, 1, 0], [0, 2, 0]], atol=1e-12)
    np.testing.assert_allclose(points @ lower.T, [[0, 1, 0], [1, 1, 0]], atol=1e-12)


def test_no_turn_is_the_rest_and_joints_stay_joined() -> None:
    bones = figure_bones(np.random.default_rng(0))
    still = posed_transforms(bones, np.zeros((2, len(bones), 3)))
    np.testing.assert_allclose(still, np.tile(np.eye(3, 4), (2, len(bones), 1, 1)), atol=1e-12)
    moved = posed_transforms(bones, np.random.default_rng(1).normal(size=(3, len(bones), 3)))
    rotations = moved[..., :3]
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 1, 3, 2), np.broadcast_to(np.eye(3), rotations.shape), atol=1e-12
    )
    for number, bone in enumerate(bones):
        assert bone.above < number
        if bone.above >= 0:
            start = np.append(bone.start, 1)
            np.testing.assert_allclose(moved[:, number] @ start, moved[:, bone.above] @ start, atol=1e-12)


def test_weights_sum_to_1_and_follow_the_nearest_bone() -> None:
    points = np.array([[0.3, 0.1, 0], [1.0, 0.1, 0], [1.7, 0, 0.1]])
    weights = skin_weights(points, CHAIN)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    np.testing.assert_allclose(weights[1], [0.5, 0.5])  # at the joint
    assert weights[0, 0] > 0.99 and weights[2, 1] > 0.99


def test_the_figure(figure: Animation) -> None:
    mesh = figure.mesh
    assert 800 < len(mesh.vertices) < 1700 and len(figure.names) == 16 and len(figure) == 8
    np.testing.assert_allclose(figure.frame(0), mesh.vertices, atol=1e-6)
    again, other = figure_animation(0, 8, 1200), figure_animation(1, 8, 1200)
    np.testing.assert_array_equal(again.frame(7), figure.frame(7))
    assert len(other.mesh.vertices) != len(mesh.vertices) or not np.array_equal(other.mesh.vertices, mesh.vertices)
    edges = mesh.faces[:, :2]
    long = [np.linalg.norm(np.diff(points[edges], axis=1)[:, 0], axis=1) for points in figure.frames()]
    assert np.median(np.abs(long[5] / long[0] - 1)) < 0.05  # most of the body moves nearly rigidly
    assert all(np.isfinite(points).all() for points in figure.frames())


@pytest.mark.parametrize("seed", range(6))
def test_every_figure_is_one_closed_surface(seed: int) -> None:
    mesh = figure_animation(seed, 1, 1500).mesh
    assert face_components(mesh.faces).max() == 0
    assert (build_edges(mesh.faces, len(mesh.vertices)).faces_at == 2).all()


def test_what_hangs_on_one_bone_moves_rigidly(figure: Animation) -> None:
    assert isinstance(figure.motion, Blend)
    head = figure.names.index("head")
    sure = figure.motion.weights[:, head] > 0.999
    assert sure.sum() > 10
    matrix = figure.transforms[4, head]
    moved = figure.mesh.vertices[sure] @ matrix[:, :3].T + matrix[:, 3]
    np.testing.assert_allclose(figure.frame(4)[sure], moved, atol=3e-3)
    assert abs(Rotation.from_matrix(matrix[:, :3]).magnitude()) > 0.05


def test_arguments_are_checked() -> None:
    with pytest.raises(ValueError, match="vertices is 10: use a whole number of 200 or more"):
        figure_animation(0, 2, 10)
