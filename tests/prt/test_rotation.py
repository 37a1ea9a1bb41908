"""A turned transfer is the transfer of the turned mesh; errors keep what can be kept of them."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gash_jax
from gash_jax.algebra import motors
from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.geometry.mesh import transform
from gash_jax.light.environment import Light
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rotation import rotate_transfer
from gash_jax.prt.transfer import Transfer, load_transfer, save_transfer
from gash_jax.shapes.primitives import bumpy_sphere

TURN = Rotation.random(rng=np.random.default_rng(5))
MATRIX = TURN.as_matrix()
MESH = bumpy_sphere(4)
COUNT = len(MESH.vertices)
QUARTER = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # about +y


def _lights(bands: int) -> np.ndarray:
    """SH of one direction per vertex: what `visibility` would be if only that direction were free."""
    directions = np.random.default_rng(bands).normal(size=(COUNT, 3)).astype(np.float32)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _transfer(bands: int = 3, **arrays: np.ndarray) -> Transfer:
    coefficients = np.asarray(gash_jax.unshadowed_transfer(MESH.normals, bands))
    error = np.random.default_rng(0).random((COUNT, bands**2)).astype(np.float32)
    return Transfer(coefficients, error, *MESH, {"method": "closed form"}, **arrays)


@pytest.mark.parametrize("bands", [1, 10])
def test_the_closed_form_of_the_turned_mesh(bands: int) -> None:
    turned = rotate_transfer(_transfer(bands), MATRIX)
    np.testing.assert_allclose(turned.normals, MESH.normals @ MATRIX.T, atol=5e-7)
    np.testing.assert_allclose(turned.vertices, MESH.vertices @ MATRIX.T, atol=1e-6)
    np.testing.assert_array_equal(turned.faces, MESH.faces)
    expected = gash_jax.unshadowed_transfer(np.asarray(turned.normals), bands)
    np.testing.assert_allclose(turned.coefficients, expected, atol=1e-5)


def test_a_bake_of_the_turned_mesh_by_the_same_rays() -> None:
    rotation = MATRIX.astype(np.float32)
    frames = np.asarray(orthonormal_frame(MESH.normals))
    before = bake_transfer(MESH, rays=64, replicates=1, frames=frames)
    moved = transform(MESH, rotation, np.zeros(3), 1.0)
    after = bake_transfer(moved, rays=64, replicates=1, frames=rotation @ frames)
    turned = rotate_transfer(before, MATRIX)
    same = np.abs(after.coefficients - turned.coefficients).max(axis=1) < 1e-5
    assert same.mean() > 0.99  # a ray that grazes may fall either way
    assert np.abs(after.coefficients - before.coefficients).max() > 0.1
    np.testing.assert_allclose(turned.normals, after.normals, atol=1e-6)


def test_a_quarter_turn_by_hand() -> None:
    """About +y: z goes to x and x to -z. Band 1 is (y, z, x), band 2 (xy, yz, zz, xz, xx - yy)."""
    one = Transfer(np.tile(np.arange(1.0, 5), (COUNT, 1)).astype(np.float32), None, *MESH, {})
    one = one._replace(vertices=np.tile(np.array([1.0, 2, 3], np.float32), (COUNT, 1)))
    turned = rotate_transfer(one, np.array([0.5**0.5, 0, 0.5**0.5, 0]))
    np.testing.assert_allclose(turned.coefficients, np.tile([1.0, 2, -4, 3], (COUNT, 1)), atol=1e-6)
    np.testing.assert_allclose(turned.vertices, np.tile([3.0, 2, -1], (COUNT, 1)), atol=1e-6)
    np.testing.assert_allclose(turned.metadata["rotation"], QUARTER, atol=1e-12)
    assert turned.standard_error is turned.visibility is turned.matrices is None


@pytest.mark.parametrize("bands", [1, 3])
@pytest.mark.parametrize("kind", [np.float32, np.float16])
def test_visibility_and_matrices_turn_with_the_mesh(bands: int, kind: type) -> None:
    """Where one direction w is free, visibility is Y(w) in 2B-1 bands and M = Y(w) Y(w)^T."""
    free = _lights(bands)

    def glossy(directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        narrow = np.asarray(evaluate_sh(directions, bands))
        wide = np.asarray(evaluate_sh(directions, 2 * bands - 1))
        return wide.astype(kind), (narrow[:, :, None] * narrow[:, None, :]).astype(kind)

    before = glossy(free)
    turned = rotate_transfer(
        _transfer(bands, visibility=before[0], matrices=before[1]), TURN.as_quat(scalar_first=True)
    )
    for found, expected in zip((turned.visibility, turned.matrices), glossy(free @ MATRIX.T), strict=True):
        found = np.asarray(found)
        assert found.dtype == kind
        atol = 2e-5 if kind is np.float32 else 4 * 2.0**-11 * np.abs(expected).max()
        np.testing.assert_allclose(found.astype(np.float64), expected, atol=atol)


@pytest.mark.parametrize("bands", [1, 3, 10])
def test_errors_of_the_visibility_turn_as_uncorrelated(bands: int) -> None:
    """Each band keeps its sum of squares; half a turn about +y leaves all as they are. In half precision."""
    width = 2 * bands - 1
    error = np.random.default_rng(1).random((COUNT, width**2)).astype(np.float16)
    before = _transfer(bands, visibility=np.zeros_like(error), visibility_error=error)
    turned, half = rotate_transfer(before, MATRIX), rotate_transfer(before, np.diag([-1.0, 1, -1]))
    assert turned.visibility_error is not None and turned.visibility_error.dtype == np.float16
    for band in range(width):
        part = slice(band**2, (band + 1) ** 2)
        power = [np.sum(np.asarray(e, np.float64)[:, part] ** 2, axis=1) for e in (error, turned.visibility_error)]
        np.testing.assert_allclose(power[1], power[0], rtol=2e-3)
    assert bands == 1 or np.abs(np.asarray(turned.visibility_error, np.float32) - error).max() > 0.1
    np.testing.assert_allclose(np.asarray(half.visibility_error, np.float32), error.astype(np.float32), atol=1e-3)


def test_matrices_that_are_not_symmetric() -> None:
    """M' = D M D^T: rows and columns each turn, M' D c = D M c."""
    rng = np.random.default_rng(3)
    matrices, light = (rng.normal(size=shape).astype(np.float32) for shape in ((COUNT, 9, 9), (9, 3)))
    turned = rotate_transfer(_transfer(3, matrices=matrices), MATRIX)
    arriving = rotate_transfer(matrices @ light, MATRIX)
    found = np.asarray(turned.matrices) @ np.asarray(gash_jax.rotate_light(light, MATRIX))
    np.testing.assert_allclose(found, arriving, atol=1e-4)


@pytest.mark.parametrize("colours", [(), (3,)])
def test_light_and_transfer_turned_alike_shade_alike(colours: tuple[int, ...]) -> None:
    rng = np.random.default_rng(4)
    coefficients, light = rng.normal(size=(COUNT, 16, *colours)), rng.normal(size=(16, 3))
    turned = rotate_transfer(coefficients, MATRIX)
    assert isinstance(turned, jax.Array) and turned.shape == coefficients.shape
    found = gash_jax.shade(turned, gash_jax.rotate_light(light, MATRIX))
    np.testing.assert_allclose(found, gash_jax.shade(coefficients, light), atol=2e-5)


def test_errors_keep_their_sum_in_every_band() -> None:
    transfer = _transfer(4, predicted_error=np.ones((COUNT, 16), np.float32))
    assert transfer.standard_error is not None
    turned = rotate_transfer(transfer, MATRIX)
    for band in range(4):
        part = slice(band**2, (band + 1) ** 2)
        sums = [
            (np.asarray(error)[:, part] ** 2).sum(axis=1) for error in (transfer.standard_error, turned.standard_error)
        ]
        np.testing.assert_allclose(*sums, rtol=1e-5)
    np.testing.assert_allclose(np.asarray(turned.predicted_error), 1.0, atol=1e-5)  # equal errors stay
    # turns that map axes to axes carry errors with their coefficients
    for name, turn in (("none", np.eye(3)), ("half", np.diag([-1.0, 1, -1]))):
        same = rotate_transfer(transfer, turn).standard_error
        np.testing.assert_allclose(np.asarray(same), transfer.standard_error, atol=2e-6, err_msg=name)
    quarter = rotate_transfer(transfer, QUARTER).standard_error
    np.testing.assert_allclose(np.asarray(quarter)[:, 1:4], transfer.standard_error[:, [1, 3, 2]], atol=1e-6)


def test_every_form_of_one_rotation() -> None:
    transfer = _transfer()
    rotor = motors.matrix_to_rotor(MATRIX.astype(np.float32))
    motor = motors.compose(motors.translator(np.array([1.0, 2.0, 3.0])), rotor)
    expected = rotate_transfer(transfer, MATRIX)
    for form in (TURN.as_quat(scalar_first=True), -TURN.as_quat(scalar_first=True), rotor, motor, -motor):
        turned = rotate_transfer(transfer, form)
        np.testing.assert_allclose(turned.coefficients, expected.coefficients, atol=2e-6)
        np.testing.assert_allclose(turned.vertices, expected.vertices, atol=2e-6)


def test_tiny_turns_and_black_lights() -> None:
    light = np.random.default_rng(6).normal(size=(9, 3)).astype(np.float32)
    tiny = np.array([1.0, 0, 0.5e-8, 0])
    np.testing.assert_allclose(gash_jax.rotate_light(light, tiny), light, atol=3e-6)
    assert not np.asarray(gash_jax.rotate_light(np.zeros((9, 3)), MATRIX)).any()


def test_a_turned_transfer_is_saved_drawn_and_turned_back(tmp_path: Path) -> None:
    transfer = _transfer()
    turned = rotate_transfer(transfer, MATRIX)
    save_transfer(tmp_path / "t.npz", turned)
    again = load_transfer(tmp_path / "t.npz")
    np.testing.assert_array_equal(again.coefficients, turned.coefficients)
    assert again.metadata["rotation"] == turned.metadata["rotation"] and json.dumps(turned.metadata)
    light = Light(np.random.default_rng(7).random((9, 3)))
    assert gash_jax.render(turned, light, size=16).shape == (16, 16, 3)
    back = rotate_transfer(again, MATRIX.T)
    np.testing.assert_allclose(back.coefficients, transfer.coefficients, atol=2e-6)
    np.testing.assert_allclose(back.metadata["rotation"], np.eye(3), atol=1e-12)


@pytest.mark.parametrize("rotation", [np.eye(4), np.diag([1.0, 1, -1]), np.array([1.0, 1, 0, 0]), 2 * np.eye(32)[0]])
def test_what_is_no_rotation_is_refused(rotation: np.ndarray) -> None:
    with pytest.raises(ValueError, match="rotation"):
        rotate_transfer(_transfer(), rotation)


def test_transforms() -> None:
    transfer = _transfer()
    quaternion = jnp.asarray(TURN.as_quat(scalar_first=True), jnp.float32)
    expected = rotate_transfer(transfer, MATRIX)
    compiled = jax.jit(rotate_transfer)(transfer, quaternion)
    np.testing.assert_allclose(compiled.coefficients, expected.coefficients, atol=2e-6)
    np.testing.assert_allclose(np.asarray(compiled.standard_error), np.asarray(expected.standard_error), atol=2e-6)
    many = jax.vmap(lambda q: rotate_transfer(transfer, q))(jnp.stack([quaternion, -quaternion]))
    np.testing.assert_allclose(many.coefficients[1], expected.coefficients, atol=2e-6)
    gradient = jax.grad(lambda q: jnp.sum(rotate_transfer(transfer, q).coefficients[:, 4:] ** 3))(quaternion)
    assert np.isfinite(gradient).all() and np.abs(gradient).max() > 0
