import numpy as np
import pytest
from scipy.special import comb

from gash_jax.geometry.animation import Animation
from gash_jax.shapes.deformations import blendshape_animation, lattice_animation, sparse_weights
from gash_jax.shapes.primitives import bumpy_sphere

MESH = bumpy_sphere(6)
MAKERS = (blendshape_animation, lattice_animation)


@pytest.mark.parametrize("make", MAKERS)
def test_seeds_reproduce_and_frame_0_is_the_mesh(make) -> None:
    one, again, other = make(MESH, 3, 6), make(MESH, 3, 6), make(MESH, 4, 6)
    np.testing.assert_array_equal(one.frame(5), again.frame(5))
    assert not np.array_equal(one.frame(5), other.frame(5))
    np.testing.assert_allclose(one.frame(0), MESH.vertices, atol=1e-6)
    assert len(one) == 6 and one.frame(5).shape == MESH.vertices.shape and np.isfinite(one.parameters).all()
    moved = np.abs(one.frame(5) - MESH.vertices).max()
    assert 0.005 < moved < 1.5


def test_weights_are_sparse_and_in_range() -> None:
    weights = sparse_weights(np.random.default_rng(0), 400, 30)
    used = (weights > 0).sum(axis=1)
    assert not weights[0].any() and weights.min() >= 0 and weights.max() < 1
    assert set(used[1:]) == set(range(1, 9))
    positive = weights[weights > 0]  # mean of U(0, 1) within 4 standard errors
    assert abs(positive.mean() - 0.5) < 4 * np.sqrt(1 / 12 / len(positive))
    assert sparse_weights(np.random.default_rng(0), 50, 2).astype(bool).sum(axis=1).max() == 2


def test_a_bump_is_largest_at_its_centre_and_falls_off() -> None:
    animation = blendshape_animation(MESH, 0, 2, shapes=5)
    for delta in animation.motion._asdict()["deltas"]:
        size = np.linalg.norm(delta, axis=1)
        center = int(size.argmax())
        away = np.linalg.norm(MESH.vertices - MESH.vertices[center], axis=1)
        order = np.argsort(away)
        assert (np.diff(size[order]) <= 1e-6).all()
        direction = delta / np.maximum(size[:, None], 1e-12)
        np.testing.assert_allclose(
            direction[size > 1e-3], np.tile(direction[center], ((size > 1e-3).sum(), 1)), atol=1e-3
        )


def _points(animation: Animation, displacement: np.ndarray) -> np.ndarray:
    return animation.motion(displacement.ravel().astype(np.float32))


def test_moving_all_points_of_a_lattice_alike_moves_the_mesh_affinely() -> None:
    """Bernstein polynomials reproduce constants and linear functions."""
    animation = lattice_animation(MESH, 0, 2)
    shift = np.tile([0.5, -1, 2], (64, 1))
    np.testing.assert_allclose(_points(animation, shift), MESH.vertices + [0.5, -1, 2], atol=1e-5)
    low, high = MESH.vertices.min(axis=0), MESH.vertices.max(axis=0)
    places = low + (high - low) * np.stack(np.meshgrid(*[np.arange(4) / 3] * 3, indexing="ij"), -1).reshape(-1, 3)
    matrix = np.random.default_rng(0).normal(size=(3, 3))
    np.testing.assert_allclose(_points(animation, places @ matrix.T), MESH.vertices @ (np.eye(3) + matrix).T, atol=1e-4)


def test_one_point_of_a_lattice_by_hand() -> None:
    animation = lattice_animation(MESH, 0, 2, points=3)
    number = animation.names.index("point 1 2 0 y")
    row = np.zeros(81, np.float32)
    row[number] = 1
    u, v, w = ((MESH.vertices - MESH.vertices.min(axis=0)) / np.ptp(MESH.vertices, axis=0)).T
    expected = comb(2, 1) * u * (1 - u) * v**2 * (1 - w) ** 2
    np.testing.assert_allclose(animation.motion(row)[:, 1] - MESH.vertices[:, 1], expected, atol=1e-5)


@pytest.mark.parametrize("make", MAKERS)
def test_arguments_are_checked(make) -> None:
    with pytest.raises(ValueError, match="frames is 0: use a whole number of 1 or more"):
        make(MESH, 0, 0)
    with pytest.raises(ValueError, match="seed is -1"):
        make(MESH, -1, 5)
