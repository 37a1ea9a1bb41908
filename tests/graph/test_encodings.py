"""Frames and edge features: by hand, under motions of the mesh, at the degenerate ends, through jax transforms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.cga import geometric_product, reverse
from gash_jax.algebra.motors import apply_motor, motor
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph.encodings import (
    EDGE_BLOCK,
    MOTOR_8,
    edge_features,
    frame_motors,
    motor_nodes,
    relative_edges,
    relative_motors,
    vertex_frames,
)
from gash_jax.graph.neighbours import rings


def _edges(points: np.ndarray, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    table = rings(points, seed)
    return table.ravel(), np.repeat(np.arange(len(points), dtype=np.int32), table.shape[1])


def _random_edges(count: int, seed: int = 0) -> tuple[jax.Array, jax.Array, jax.Array]:
    rng = np.random.default_rng(seed)
    frames, _ = np.linalg.qr(rng.normal(size=(count, 3, 3)))
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    arrays = rng.normal(size=(count, 3)), normals, frames
    return tuple(jnp.asarray(a, jnp.float32) for a in arrays)  # type: ignore[return-value]


def test_motor_nodes_are_the_motors(bumpy: Mesh) -> None:
    encoded = motor_nodes(bumpy.vertices, bumpy.normals)
    assert encoded.dtype == np.float32
    np.testing.assert_allclose(encoded, motor(jnp.asarray(bumpy.vertices), jnp.asarray(bumpy.normals)), atol=1e-7)


def test_frames_are_rotations_with_the_normal_last(bumpy: Mesh) -> None:
    frames = vertex_frames(bumpy.vertices, bumpy.normals, *_edges(bumpy.vertices))
    np.testing.assert_allclose(frames.transpose(0, 2, 1) @ frames, np.broadcast_to(np.eye(3), frames.shape), atol=2e-6)
    np.testing.assert_allclose(np.linalg.det(frames), 1, atol=2e-6)
    np.testing.assert_array_equal(frames[:, :, 2], bumpy.normals)


def test_tangent_by_hand_is_the_mean_unit_offset_in_the_plane() -> None:
    positions = np.array([[0, 0, 0], [2, 0, 0], [0, 1, 5]], np.float32)
    normals = np.array([[0, 0, 1]] * 3, np.float32)
    frames = vertex_frames(positions, normals, np.array([1, 2], np.int32), np.array([0, 0], np.int32))
    tangent = np.array([1, 1 / np.sqrt(26), 0])
    tangent /= np.linalg.norm(tangent)
    expected = np.stack([tangent, [-tangent[1], tangent[0], 0], [0, 0, 1]], axis=-1)
    np.testing.assert_allclose(frames[0], expected, atol=1e-6)


def test_frames_without_direction_or_normal_are_still_frames() -> None:
    positions = np.array([[0, 0, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 0]], np.float32)
    normals = np.array([[0, 0, 1], [1, 0, 0], [0, 0, 0], [0, 1, 0]], np.float32)
    # offsets that cancel, offsets along the normal, no normal, coincident neighbour
    senders, receivers = np.array([1, 2, 0, 0, 0], np.int32), np.array([0, 0, 1, 2, 3], np.int32)
    frames = vertex_frames(positions, normals, senders, receivers)
    np.testing.assert_allclose(frames.transpose(0, 2, 1) @ frames, np.broadcast_to(np.eye(3), (4, 3, 3)), atol=1e-6)
    np.testing.assert_array_equal(frames[[0, 1, 3], :, 2], normals[[0, 1, 3]])
    np.testing.assert_array_equal(frames[2], np.eye(3))


def test_features_by_hand() -> None:
    # frame: t = y, b = z, n = x; the sender lies at 3 along y and 4 along x, its normal looks down -x
    frame = jnp.asarray([[[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    features = edge_features(jnp.asarray([[0.4, 0.3, 0.0]]), jnp.asarray([[-1.0, 0.0, 0.0]]), frame)[0]
    x, z, d = 0.6, 0.8, 0.5
    expected = [x, 0, z, 0, 0, 1.5 * z * z - 0.5, x * z, x * x / 2, 1 - np.log(d + 1e-4) / np.log(1e-4)]
    expected += [0.02 / 0.52, 0.1 / 0.6, 0.5, 0, 0, -1, -0.8]
    np.testing.assert_allclose(features, expected, atol=1e-6)


def test_features_do_not_change_when_the_mesh_is_moved(bumpy: Mesh, rotation: np.ndarray) -> None:
    edges = _edges(bumpy.vertices)
    units = (bumpy.vertices[edges[0]] - bumpy.vertices[edges[1]]).astype(np.float64)
    units /= np.linalg.norm(units, axis=1, keepdims=True)
    mean = units.reshape(len(bumpy.vertices), -1, 3).mean(1)
    along = np.einsum("vi,vi->v", mean, bumpy.normals)[:, None] * bumpy.normals
    clear = np.linalg.norm(mean - along, axis=1) > 0.01
    assert clear.mean() > 0.9
    turned = transform(bumpy, rotation)
    frames = vertex_frames(bumpy.vertices, bumpy.normals, *edges)
    turned_frames = vertex_frames(turned.vertices, turned.normals, *edges)
    np.testing.assert_allclose(turned_frames[clear], (rotation @ frames)[clear], atol=1e-4)
    features = relative_edges(bumpy.vertices, bumpy.normals, frames, *edges)
    moved = relative_edges(turned.vertices, turned.normals, turned_frames, *edges)
    np.testing.assert_allclose(moved[clear[edges[1]]], features[clear[edges[1]]], atol=1e-4)


def test_blocks_change_nothing(bumpy: Mesh) -> None:
    senders, receivers = _edges(np.tile(bumpy.vertices, (5, 1)))
    assert len(senders) > EDGE_BLOCK and len(senders) % EDGE_BLOCK
    vertices, normals = np.tile(bumpy.vertices, (5, 1)), np.tile(bumpy.normals, (5, 1))
    frames = vertex_frames(vertices, normals, senders, receivers)
    whole = edge_features(
        jnp.asarray(vertices[senders] - vertices[receivers]),
        jnp.asarray(normals[senders]),
        jnp.asarray(frames[receivers]),
    )
    np.testing.assert_allclose(relative_edges(vertices, normals, frames, senders, receivers), whole, atol=1e-6)


_jitted = jax.jit(edge_features)
_gradient = jax.jit(jax.grad(lambda *edges: jnp.sum(edge_features(*edges) ** 2)))


@pytest.mark.parametrize("length", [0.0, 1e-30, 1e-12, 1e-6, 1.0, 2.0])
def test_features_and_gradients_are_of_order_one_or_finite_at_any_length(length: float) -> None:
    offsets, normals, frames = _random_edges(50)
    offsets = length * offsets / jnp.linalg.norm(offsets, axis=1, keepdims=True)
    features = _jitted(offsets, normals, frames)
    assert features.shape == (50, 16) and float(jnp.abs(features).max()) < 1.2
    if length == 0:
        zero = np.r_[0:9, 15]
        np.testing.assert_allclose(np.asarray(features)[:, zero], 0, atol=1e-7)
    assert np.isfinite(_gradient(offsets, normals, frames)).all()


def test_features_under_jit_and_vmap() -> None:
    arrays = _random_edges(12)
    plain = edge_features(*arrays)
    np.testing.assert_allclose(jax.jit(edge_features)(*arrays), plain, atol=1e-6)
    batched = jax.vmap(edge_features)(*(a.reshape(3, 4, *a.shape[1:]) for a in arrays))
    np.testing.assert_allclose(batched.reshape(12, 16), plain, atol=1e-6)


def test_motors_of_frames_take_origin_and_axes_to_the_vertex(bumpy: Mesh) -> None:
    frames = vertex_frames(bumpy.vertices, bumpy.normals, *_edges(bumpy.vertices))
    motors = jnp.asarray(frame_motors(bumpy.vertices, frames))
    np.testing.assert_allclose(apply_motor(motors, jnp.zeros(3)), bumpy.vertices, atol=1e-6)
    for axis in range(3):
        expected = bumpy.vertices + frames[:, :, axis]
        np.testing.assert_allclose(apply_motor(motors, jnp.eye(3)[axis]), expected, atol=2e-6)


def test_relative_motors_are_the_geometric_product_with_the_inverse(bumpy: Mesh) -> None:
    senders, receivers = _edges(bumpy.vertices)
    motors = motor_nodes(bumpy.vertices, bumpy.normals)
    found = relative_motors(motors, senders, receivers)
    assert found.shape == (len(senders), 8) and found.dtype == np.float32 and (found[:, 0] >= 0).all()
    product = np.asarray(geometric_product(reverse(jnp.asarray(motors[receivers])), jnp.asarray(motors[senders])))
    product = np.where(product[:, :1] < 0, -product, product)
    # half turns have both signs
    clear = product[:, 0] > 1e-4
    np.testing.assert_allclose(found[clear], product[clear][:, MOTOR_8], atol=1e-5)
    # nothing is lost: e- parts repeat e+ parts, everything else is 0
    rest = np.setdiff1d(np.arange(32), [*MOTOR_8, *(MOTOR_8[4:] + 8)])
    np.testing.assert_allclose(product[:, rest], 0, atol=1e-5)
    np.testing.assert_allclose(product[:, MOTOR_8[4:] + 8], product[:, MOTOR_8[4:]], atol=1e-5)


def test_relative_motor_by_hand() -> None:
    # a shift by 2 along the receiver's own normal and no turn: 1 - t e_inf / 2, with e_inf = e+ + e-
    positions = np.array([[1, 0, 0], [3, 0, 0]], np.float32)
    normals = np.array([[1, 0, 0], [1, 0, 0]], np.float32)
    motors = motor_nodes(positions, normals)
    found = relative_motors(motors, np.array([1, 0], np.int32), np.array([0, 0], np.int32))
    # in the receiver's axes the normal is e_y
    np.testing.assert_allclose(found, [[1, 0, 0, 0, 0, -1, 0, 0], [1, 0, 0, 0, 0, 0, 0, 0]], atol=1e-6)


def test_relative_motors_of_normals_know_the_world_those_of_frames_do_not(bumpy: Mesh, rotation: np.ndarray) -> None:
    senders, receivers = _edges(bumpy.vertices)
    shifted, turned = transform(bumpy, None, np.array([0.5, -0.25, 1.0])), transform(bumpy, rotation)

    def between_normals(mesh: Mesh) -> np.ndarray:
        return relative_motors(motor_nodes(mesh.vertices, mesh.normals), senders, receivers)

    def between_frames(mesh: Mesh) -> np.ndarray:
        frames = vertex_frames(mesh.vertices, mesh.normals, senders, receivers)
        return relative_motors(frame_motors(mesh.vertices, frames), senders, receivers)

    base = between_normals(bumpy)
    near = lambda a, b: np.minimum(np.abs(a - b).max(1), np.abs(a + b).max(1))  # noqa: E731 - either sign
    np.testing.assert_allclose(near(between_normals(shifted), base), 0, atol=1e-5)
    assert np.median(near(between_normals(turned), base)) > 0.05
    change = near(between_frames(turned), between_frames(bumpy))
    # where a mean offset all but vanishes its direction is rounding
    assert np.quantile(change, 0.9) < 1e-4
