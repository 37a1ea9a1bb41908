import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.algebra import motors, sh, sh_rotation
from gash_jax.algebra.sh_rotation import rotate_coefficients, sh_rotation_blocks

pytestmark = pytest.mark.optimised

ORDER = [1, 2, 0]  # band 1 is (y, z, x)


def _rotations(count, seed=0):
    """Rotation matrices in float64: random ones and the half turns about the axes."""
    random = Rotation.random(count, rng=np.random.default_rng(seed)).as_matrix()
    return np.concatenate([random, [np.diag(d) for d in ([1.0, -1, -1], [-1.0, 1, -1], [-1.0, -1, 1])]])


def _directions(count, seed=1):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def _basis(directions, bands):
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack(sh.sh_components(x, y, z, bands), axis=-1)


@pytest.fixture(scope="module")
def ten_bands():
    """Rotations and their blocks for all ten bands."""
    rotations = _rotations(30)
    return rotations, [np.asarray(block, np.float64) for block in sh_rotation_blocks(rotations, 10)]


def test_golden_band_one_is_the_matrix_permuted():
    """Convention: D_1 = R with its axes in the order (y, z, x), exactly."""
    rotation = _rotations(1)[0].astype(np.float32)
    zero, one = sh_rotation_blocks(rotation, 2)
    np.testing.assert_array_equal(zero, [[1.0]])
    np.testing.assert_array_equal(one, rotation[ORDER][:, ORDER])


def test_quarter_turn_by_hand():
    """A quarter turn about z takes x to y and y to -x; band 2 is (xy, yz, zz, xz, xx - yy)."""
    rotation = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    two = sh_rotation_blocks(rotation, 3)[2]
    expected = np.zeros((5, 5))
    # (x, y) -> (-y, x): xy -> -xy, yz -> xz, xz -> -yz, xx - yy -> -(xx - yy)
    expected[0, 0], expected[1, 3], expected[2, 2], expected[3, 1], expected[4, 4] = -1, 1, 1, -1, -1
    np.testing.assert_allclose(two, expected, atol=1e-6)


def test_definition(ten_bands):
    """Y(R n) = D(R) Y(n)."""
    rotations, blocks = ten_bands
    directions = _directions(40)
    turned = _basis(np.einsum("rij,nj->rni", rotations, directions), 10)
    basis = _basis(directions, 10)
    for band, block in enumerate(blocks):
        part = slice(band * band, (band + 1) ** 2)
        expected = np.einsum("rij,nj->rni", block, basis[:, part])
        np.testing.assert_allclose(turned[..., part], expected, atol=2e-5)


def test_orthogonal_with_determinant_one_and_the_trace_law(ten_bands):
    rotations, blocks = ten_bands
    angle = np.array([Rotation.from_matrix(rotation).magnitude() for rotation in rotations])
    for band, block in enumerate(blocks):
        identity = np.broadcast_to(np.eye(2 * band + 1), block.shape)
        np.testing.assert_allclose(block @ np.swapaxes(block, -1, -2), identity, atol=2e-5)
        np.testing.assert_allclose(np.linalg.det(block), 1.0, atol=4e-5)
        trace = np.trace(block, axis1=-2, axis2=-1)
        np.testing.assert_allclose(trace, np.sin((band + 0.5) * angle) / np.sin(angle / 2), atol=2e-5)


def test_composition(ten_bands):
    rotations, blocks = ten_bands
    products = sh_rotation_blocks(rotations @ np.roll(rotations, 1, axis=0), 10)
    for block, product in zip(blocks, products, strict=True):
        np.testing.assert_allclose(block @ np.roll(block, 1, axis=0), product, atol=3e-5)


def test_identity_and_half_turns(ten_bands):
    for band, block in enumerate(ten_bands[1]):
        identity = np.eye(2 * band + 1)
        for half_turn in block[-3:]:
            np.testing.assert_allclose(np.abs(half_turn), identity, atol=2e-5)
            np.testing.assert_allclose(half_turn @ half_turn, identity, atol=2e-5)
    m = np.arange(-3, 4)
    # about z: (-1)^m; about x: y and z change sign
    about_x, _, about_z = ten_bands[1][3][-3:]
    np.testing.assert_allclose(np.diag(about_z), (-1.0) ** m, atol=1e-6)
    sample = _basis(_directions(1) * [1, -1, -1], 4)[0, 9:] / _basis(_directions(1), 4)[0, 9:]
    np.testing.assert_allclose(np.diag(about_x), np.sign(sample), atol=1e-6)
    for band, block in enumerate(sh_rotation_blocks(np.eye(3), 4)):
        np.testing.assert_allclose(block, np.eye(2 * band + 1), atol=1e-6)


def test_zonal_function_turns_to_its_axis(ten_bands):
    """The zonal function z_l about z, turned by R, is sqrt(4 pi/(2l+1)) z_l Y_lm(R e_z)."""
    rotations, blocks = ten_bands
    axis = _basis(rotations[:, :, 2], 10)
    for band, block in enumerate(blocks):
        expected = math.sqrt(4 * np.pi / (2 * band + 1)) * axis[:, band * band : (band + 1) ** 2]
        np.testing.assert_allclose(block[:, :, band], expected, atol=2e-5)


@pytest.mark.parametrize("bands", [1, 3, 6])
def test_coefficients_describe_the_turned_function(bands):
    """c' = D(R) c evaluates at R w to what c evaluates at w."""
    rotation = _rotations(1, seed=bands)[0]
    coefficients = np.random.default_rng(bands).normal(size=bands * bands)
    rotated = np.asarray(rotate_coefficients(coefficients, rotation), np.float64)
    directions = _directions(20)
    before, after = _basis(directions, bands) @ coefficients, _basis(directions @ rotation.T, bands) @ rotated
    np.testing.assert_allclose(after, before, atol=3e-5)
    np.testing.assert_allclose(np.sum(rotated**2), np.sum(coefficients**2), rtol=1e-5)


def test_rotation_by_a_rotor():
    normal = _directions(4).astype(np.float32)
    rotation = motors.rotor_to_matrix(motors.rotor_from_normal(normal))
    up = _basis(np.array([[0.0, 1.0, 0.0]]), 4)[0]
    np.testing.assert_allclose(rotate_coefficients(up, rotation), _basis(normal, 4), atol=2e-6)


@pytest.mark.parametrize("left,right", [((), ()), ((7, 9), ()), ((), (7, 9)), ((7, 1), (9,)), ((9,), (7, 1))])
def test_leading_shapes_broadcast(left, right):
    coefficients = np.random.default_rng(0).normal(size=(*left, 9))
    rotation = Rotation.random(math.prod(right), rng=np.random.default_rng(1)).as_matrix().reshape(*right, 3, 3)
    shape = np.broadcast_shapes(left, right)
    result = np.asarray(rotate_coefficients(coefficients, rotation))
    assert result.shape == (*shape, 9) and result.dtype == np.float32
    all_coefficients = np.broadcast_to(coefficients, (*shape, 9)).reshape(-1, 9)
    all_rotations = np.broadcast_to(rotation, (*shape, 3, 3)).reshape(-1, 3, 3)
    blocks = [np.asarray(block) for block in sh_rotation_blocks(all_rotations, 3)]
    for index in (0, -1):
        whole = np.zeros((9, 9))
        for band, block in enumerate(blocks):
            whole[band**2 : (band + 1) ** 2, band**2 : (band + 1) ** 2] = block[index]
        np.testing.assert_allclose(result.reshape(-1, 9)[index], whole @ all_coefficients[index], atol=2e-6)


@pytest.mark.parametrize("band", [12, 18])
def test_bands_of_products_keep_the_definition(band):
    """The basis has 19 bands, for products of functions of ten."""
    rotation = _rotations(1).astype(np.float32)
    with jax.disable_jit():
        block = np.asarray(sh_rotation._block(jnp.asarray(rotation), band), np.float64)
    n = _directions(20)
    there, here = (_basis(d, band + 1)[..., band * band :] for d in (n @ rotation.astype(np.float64).mT, n))
    np.testing.assert_allclose(there, here @ block.mT, atol=5 * 2.0**-24 * band)  # the condition is 8
    np.testing.assert_allclose(block @ block.mT, np.broadcast_to(np.eye(2 * band + 1), block.shape), atol=1e-5)


@pytest.mark.parametrize("count", [0, 3, 8, 27, 400])
def test_wrong_numbers_of_coefficients_are_refused(count):
    with pytest.raises(ValueError, match="the last axis must hold bands"):
        rotate_coefficients(np.zeros((2, count)), np.eye(3))


@pytest.mark.parametrize("bands", [0, 20])
def test_wrong_bands_are_refused(bands):
    with pytest.raises(ValueError, match="use a whole number from 1 to 19"):
        sh_rotation_blocks(np.eye(3), bands)


def test_transforms():
    rotations = _rotations(3).astype(np.float32)
    coefficients = np.random.default_rng(2).normal(size=(6, 9)).astype(np.float32)
    eager = rotate_coefficients(coefficients, rotations)
    loop = np.stack([rotate_coefficients(c, r) for c, r in zip(coefficients, rotations, strict=True)])
    np.testing.assert_allclose(eager, loop, atol=2e-6)
    np.testing.assert_allclose(jax.vmap(rotate_coefficients)(coefficients, rotations), loop, atol=2e-6)
    gradient = jax.jit(jax.grad(lambda r: jnp.sum(rotate_coefficients(coefficients, r) ** 3)))(jnp.asarray(rotations))
    assert np.isfinite(gradient).all() and (np.abs(gradient).max(axis=(1, 2)) > 0).all()
