import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import qmc

from gash_jax.algebra.directions import (
    fibonacci_hemisphere,
    hammersley,
    orthonormal_frame,
    radical_inverse_2,
    spherical_fibonacci,
    turn_about_normal,
)


def test_radical_inverse_by_hand():
    np.testing.assert_array_equal(
        radical_inverse_2(np.array([0, 1, 2, 3, 4, 6, 2**31, 2**32 - 1])),
        [0, 0.5, 0.25, 0.75, 0.125, 0.375, 2.0**-32, 1 - 2.0**-32],
    )


def test_radical_inverse_is_the_van_der_corput_sequence():
    expected = qmc.Halton(d=1, scramble=False).random(1000)[:, 0]
    np.testing.assert_array_equal(radical_inverse_2(np.arange(1000)), expected)


def test_hammersley_by_hand():
    np.testing.assert_array_equal(hammersley(4), [[0, 0], [0.25, 0.5], [0.5, 0.25], [0.75, 0.75]])


def test_hammersley_fills_every_elementary_interval():
    points = hammersley(64)
    for rows in (1, 2, 4, 8, 16, 32, 64):
        cells = (points * [rows, 64 // rows]).astype(int)
        assert len(np.unique(cells, axis=0)) == 64


@pytest.mark.parametrize("make", [hammersley, spherical_fibonacci, fibonacci_hemisphere])
@pytest.mark.parametrize("count", [0, -3])
def test_empty_sets_are_refused(make, count):
    with pytest.raises(ValueError, match="use 1 or more"):
        make(count)


@pytest.mark.parametrize("make", [spherical_fibonacci, fibonacci_hemisphere])
def test_fibonacci_sets_are_unit_and_equal_in_area(make):
    low = -1.0 if make is spherical_fibonacci else 0.0
    directions = make(101)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-15)
    edges = np.linspace(1.0, low, 102)
    assert ((directions[:, 2] < edges[:-1]) & (directions[:, 2] > edges[1:])).all()
    azimuth = np.unwrap(np.arctan2(directions[:, 1], directions[:, 0]))
    golden = (3 - np.sqrt(5)) * np.pi
    steps = np.diff(azimuth) % (2 * np.pi)
    np.testing.assert_allclose(np.minimum(steps, 2 * np.pi - steps), golden, atol=1e-10)


def test_fibonacci_integrates_low_polynomials():
    x, y, z = spherical_fibonacci(1000).T
    for value, exact in ((x, 0), (y, 0), (z, 0), (x * x, 1 / 3), (z * z, 1 / 3), (x * y, 0), (z**4, 1 / 5)):
        np.testing.assert_allclose(np.mean(value), exact, atol=2e-4)
    x, y, z = fibonacci_hemisphere(1000).T
    # Cut at the equator, the spiral does not close: the horizontal mean is of the order of one cell.
    for value, exact in ((x, 0), (y, 0), (z, 1 / 2), (z * z, 1 / 3), (x * x, 1 / 3)):
        np.testing.assert_allclose(np.mean(value), exact, atol=1e-3)


def _normals(count, seed=3):
    normals = np.random.default_rng(seed).normal(size=(count, 3))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _near_pole():
    """Normals at angles from 1e-40 to 1e-2 from -z, all around."""
    angle = np.repeat(10.0 ** np.array([-40.0, -30, -20, -10, -8, -6, -4, -3.5, -3, -2]), 16)
    azimuth = np.tile(np.arange(16) / 16 * 2 * np.pi + 0.1, 10)
    return np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), -np.cos(angle)], axis=-1)


@pytest.mark.parametrize("convert", [np.asarray, np.float32, jnp.asarray], ids=["float64", "float32", "jax"])
@pytest.mark.parametrize("normals", [_normals(500), _near_pole(), np.eye(3), -np.eye(3)])
def test_frames_are_right_handed_and_orthonormal(normals, convert):
    given = convert(normals)
    frames = orthonormal_frame(given)
    assert isinstance(frames, type(given)) and frames.dtype == given.dtype
    np.testing.assert_array_equal(frames[..., 2], given)
    tolerance = 4e-15 if given.dtype == np.float64 else 1e-6
    frames = np.asarray(frames, np.float64)
    np.testing.assert_allclose(
        np.swapaxes(frames, -1, -2) @ frames, np.broadcast_to(np.eye(3), frames.shape), atol=tolerance
    )
    np.testing.assert_allclose(np.linalg.det(frames), 1.0, atol=tolerance)


def test_frames_by_hand():
    np.testing.assert_array_equal(orthonormal_frame(np.array([0.0, 0.0, 1.0])), np.eye(3))
    np.testing.assert_array_equal(orthonormal_frame(np.array([0.0, 0.0, -1.0])), np.diag([-1.0, 1.0, -1.0]))
    np.testing.assert_array_equal(
        orthonormal_frame(np.array([1.0, 0.0, 0.0])), np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    )
    np.testing.assert_array_equal(orthonormal_frame(np.zeros(3)), np.diag([1.0, 1.0, 0.0]))


def test_frames_turn_z_to_the_normal_along_the_shortest_arc():
    for normal, frame in zip(_normals(50), orthonormal_frame(_normals(50)), strict=True):
        axis = np.cross([0, 0, 1], normal)
        np.testing.assert_allclose(frame @ axis, axis, atol=1e-14)


def test_frames_are_continuous_across_the_equator():
    azimuth = np.arange(100) / 100 * 2 * np.pi
    above, below = (np.stack([np.cos(azimuth), np.sin(azimuth), np.full(100, z)], axis=-1) for z in (1e-9, -1e-9))
    np.testing.assert_allclose(orthonormal_frame(above), orthonormal_frame(below), atol=1e-8)


def test_frames_transform():
    normals = np.concatenate([_normals(6), [[0, 0, 1], [0, 0, -1], [0, 0, 0]]]).astype(np.float32)
    eager = orthonormal_frame(jnp.asarray(normals))
    np.testing.assert_allclose(jax.jit(orthonormal_frame)(normals), eager, atol=1e-6)
    np.testing.assert_allclose(jax.jit(jax.vmap(orthonormal_frame))(normals), eager, atol=1e-6)
    np.testing.assert_allclose(orthonormal_frame(normals), eager, atol=1e-6)
    poles = jnp.asarray(np.concatenate([normals, _near_pole().astype(np.float32)]))
    gradient = jax.jit(jax.grad(lambda n: jnp.sum(orthonormal_frame(n))))(poles)
    assert np.isfinite(gradient).all()


def test_turn_about_normal_by_hand():
    """A quarter turn takes the tangent to the bitangent and that to minus the tangent; the normal stays."""
    for frame, angle in ((np.eye(3), np.array(np.pi / 2)), (jnp.eye(3), jnp.asarray(np.pi / 2))):
        turned = turn_about_normal(frame, angle)
        assert isinstance(turned, type(frame))
        np.testing.assert_allclose(turned, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-7)


def test_turns_about_the_normal_add_up_and_keep_frames():
    """(7, 1) frames under (7, 4) angles; turned by a and then by b is turned by a + b."""
    frames, angles = orthonormal_frame(_normals(7))[:, None], np.random.default_rng(0).normal(size=(2, 7, 4))
    turned = turn_about_normal(frames, angles[0])
    assert turned.shape == (7, 4, 3, 3)
    np.testing.assert_allclose(
        np.swapaxes(turned, -1, -2) @ turned, np.broadcast_to(np.eye(3), turned.shape), atol=1e-14
    )
    np.testing.assert_allclose(
        turn_about_normal(turned, angles[1]), turn_about_normal(frames, angles.sum(0)), atol=1e-14
    )


def test_turn_about_normal_transforms():
    frames = jnp.asarray(orthonormal_frame(_normals(5)), jnp.float32)
    angles = jnp.linspace(-4.0, 4.0, 5)
    eager = turn_about_normal(frames, angles)
    np.testing.assert_allclose(jax.jit(turn_about_normal)(frames, angles), eager, atol=1e-6)
    np.testing.assert_allclose(jax.vmap(turn_about_normal)(frames, angles), eager, atol=1e-6)
    assert np.isfinite(jax.grad(lambda a: jnp.sum(turn_about_normal(frames, a)))(angles)).all()
