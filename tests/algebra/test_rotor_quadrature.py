"""Rotation by rotors and a quadrature: laws of its own, and the matrices' numbers."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments.rotation.exact import exact_matrix
from gash_jax.algebra import cga, motors
from gash_jax.algebra.rotor_quadrature import rotate_by_rotor, sphere_quadrature
from gash_jax.algebra.sh import evaluate_sh, sh_components
from gash_jax.algebra.sh_rotation import sh_rotation_blocks

pytestmark = pytest.mark.optimised


def _rotors(count: int, seed: int = 0) -> tuple[Rotation, jax.Array]:
    """Random rotations, half turns about the axes, turns by 1e-8 and 1e-4, and their rotors in float32."""
    vectors = np.concatenate([np.pi * np.eye(3), np.array([[1e-8], [1e-4]]) * [0.36, 0.48, 0.8]])
    random = Rotation.random(count, rng=np.random.default_rng(seed))
    rotations = Rotation.concatenate([random, Rotation.from_rotvec(vectors)])
    rotors = np.zeros((len(rotations), 32), np.float32)
    signed = rotations.as_quat(scalar_first=True) * [1, -1, 1, -1]
    rotors[:, [cga.SCALAR, cga.E23, cga.E13, cga.E12]] = signed
    return rotations, jnp.asarray(rotors)


def _matrices(rotors: jax.Array, bands: int) -> np.ndarray:
    """The whole D of each rotor by quadrature, (n, k, k): the unit vectors turned."""
    units = np.eye(bands * bands, dtype=np.float32)
    return np.swapaxes(np.asarray(rotate_by_rotor(units, rotors[:, None, :]), np.float64), 1, 2)


def test_sandwich_written_out_is_the_sandwich() -> None:
    rng = np.random.default_rng(1)
    rotors = _rotors(20)[1]
    vectors = rng.normal(size=(len(rotors), 3)).astype(np.float32)
    blades = np.zeros((len(rotors), 32), np.float32)
    blades[:, [cga.E1, cga.E2, cga.E3]] = vectors
    whole = cga.sandwich(rotors, blades)[:, jnp.array([cga.E1, cga.E2, cga.E3])]
    turned = motors.turn_vectors(rotors, vectors)
    np.testing.assert_allclose(turned, whole, atol=2e-6)
    np.testing.assert_allclose(turned, motors.apply_motor(rotors, vectors), atol=2e-6)
    np.testing.assert_allclose(motors.turn_vectors(-rotors, vectors), turned, atol=0)
    moved = motors.compose(motors.translator(vectors), rotors)  # directions do not move
    np.testing.assert_allclose(motors.turn_vectors(moved, vectors), turned, atol=1e-6)
    assert motors.turn_vectors(rotors[:, None], vectors).shape == (len(rotors), len(rotors), 3)


@pytest.mark.parametrize("bands", range(1, 11))
def test_quadrature_is_exact_for_products_of_the_basis(bands: int) -> None:
    """The Gram matrix of the basis is the identity in float64."""
    nodes, weights = sphere_quadrature(bands)
    assert len(nodes) == bands * (2 * bands - 1) and (weights > 0).all()
    x, y, z = nodes.T
    basis = np.stack(sh_components(x, y, z, bands), axis=-1)
    np.testing.assert_allclose((basis * weights[:, None]).T @ basis, np.eye(bands**2), atol=1e-13)
    np.testing.assert_allclose(weights.sum(), 4 * np.pi, rtol=1e-14)


def test_quarter_turn_by_hand() -> None:
    """R = cos 45 - e12 sin 45 turns x to y and y to -x."""
    rotor = np.zeros(32, np.float32)
    rotor[[cga.SCALAR, cga.E12]] = math.sqrt(0.5), -math.sqrt(0.5)
    np.testing.assert_allclose(motors.turn_vectors(rotor, np.array([1.0, 0, 0])), [0, 1, 0], atol=1e-7)
    turned = rotate_by_rotor(np.array([7.0, 1, 2, 3, 4, 5, 6, 8, 9], np.float32), rotor)
    # y -> -x, z -> z, x -> y; xy -> -xy, yz -> -xz, 3 zz - 1 -> itself, xz -> yz, xx - yy -> -(xx - yy)
    np.testing.assert_allclose(turned, [7, 3, 2, -1, -4, 8, 6, -5, -9], atol=4e-6)


@pytest.mark.parametrize("bands", range(1, 10))
def test_matrices_by_quadrature_are_those_of_the_exponential(bands: int) -> None:
    """Oracle: D = exp(a . G) for the rotation vector a, by SciPy in float64; ten bands below."""
    rotations, rotors = _rotors(4, seed=bands)
    exact = np.stack([exact_matrix(vector, bands) for vector in rotations.as_rotvec()])
    np.testing.assert_allclose(_matrices(rotors, bands), exact, atol=1e-5)


@pytest.fixture(scope="module")
def ten_bands() -> tuple[Rotation, jax.Array, np.ndarray]:
    rotations, rotors = _rotors(8)
    return rotations, rotors, _matrices(rotors, 10)


def test_ten_bands_are_those_of_the_exponential_and_of_the_matrices(ten_bands: tuple) -> None:
    rotations, rotors, d = ten_bands
    exact = np.stack([exact_matrix(vector, 10) for vector in rotations.as_rotvec()])
    np.testing.assert_allclose(d, exact, atol=1e-5)
    for band, block in enumerate(sh_rotation_blocks(motors.rotor_to_matrix(rotors), 10)):
        part = slice(band * band, (band + 1) ** 2)
        np.testing.assert_allclose(d[:, part, part], block, atol=1e-5)


def test_laws_of_ten_bands(ten_bands: tuple) -> None:
    """Y(R n) = D(R) Y(n), orthogonality, trace, D(R1 R2) = D(R1) D(R2), -R; a turn by 1e-8 is the identity."""
    rotations, rotors, d = ten_bands
    normals = np.random.default_rng(2).normal(size=(11, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    turned = evaluate_sh(motors.turn_vectors(rotors[:, None], normals), 10)
    np.testing.assert_allclose(evaluate_sh(normals, 10) @ np.swapaxes(d, 1, 2), turned, atol=2e-5)
    np.testing.assert_allclose(d @ np.swapaxes(d, 1, 2), np.broadcast_to(np.eye(100), d.shape), atol=2e-5)
    angle = rotations.magnitude()
    for band in range(10):
        part = slice(band * band, (band + 1) ** 2)
        trace = np.trace(d[:, part, part], axis1=1, axis2=2)
        np.testing.assert_allclose(trace, np.sin((band + 0.5) * angle) / np.sin(angle / 2), atol=2e-5)
    products = _matrices(motors.compose(rotors, jnp.roll(rotors, 1, axis=0)), 10)
    np.testing.assert_allclose(d @ np.roll(d, 1, axis=0), products, atol=3e-5)
    np.testing.assert_array_equal(_matrices(-rotors, 10), d.astype(np.float32))
    np.testing.assert_allclose(d[-2], np.eye(100), atol=2e-6)


@pytest.mark.parametrize("count", [0, 3, 121])
def test_wrong_numbers_of_coefficients_are_refused(count: int) -> None:
    with pytest.raises(ValueError, match="no square of bands"):
        rotate_by_rotor(np.zeros((2, count)), np.eye(32)[0])


def test_transforms() -> None:
    rotors = _rotors(2)[1]
    c = np.random.default_rng(3).normal(size=(7, 16)).astype(np.float32)
    eager = rotate_by_rotor(c, rotors)
    loop = np.stack([rotate_by_rotor(one, rotor) for one, rotor in zip(c, rotors, strict=True)])
    np.testing.assert_allclose(eager, loop, atol=2e-6)
    np.testing.assert_allclose(jax.vmap(rotate_by_rotor)(c, rotors), loop, atol=2e-6)
    assert rotate_by_rotor(c, rotors[:, None]).shape == (7, 7, 16)
    gradient = jax.jit(jax.grad(lambda r: jnp.sum(rotate_by_rotor(c, r) ** 3)))(rotors)
    assert np.isfinite(gradient).all() and (np.abs(gradient).max(axis=1) > 0).all()
