"""Light from code against its closed forms, quadrature and numbers by hand; what is no such light is refused."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gash_jax
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.light.sources import constant_light, directional_light, sphere_light, toward
from tests.helpers.gloss import half_sphere


def test_constant_light_by_hand() -> None:
    found = constant_light([0.5, 1.0, 2.0], 4)
    assert found.bands == 4 and found.metadata["source"] == "constant"
    np.testing.assert_allclose(found.coefficients[0], 2 * np.sqrt(np.pi) * np.array([0.5, 1, 2]), rtol=1e-6)
    assert not np.any(found.coefficients[1:])
    up = gash_jax.unshadowed_transfer(np.array([[0.0, 1, 0], [0.6, 0, 0.8]]), 4)
    np.testing.assert_allclose(
        gash_jax.shade(up, found), [[0.5, 1, 2]] * 2, rtol=1e-6
    )  # white is as bright as the light


@pytest.mark.parametrize("bands", [1, 3, 10])
def test_directional_light_is_the_basis_at_its_direction_times_the_irradiance(bands: int) -> None:
    direction = np.array([0.48, -0.6, 0.64])
    found = directional_light(7.0 * direction, [1.0, 2.0, 3.0], bands).coefficients
    expected = np.asarray(evaluate_sh(direction.astype(np.float32), bands))[:, None] * [1, 2, 3]
    np.testing.assert_allclose(found, expected, atol=2e-6)


def test_directional_light_by_hand() -> None:
    """Towards +z: Y_00, Y_10 and Y_20 at the pole, 1 / (2 sqrt(pi)) times 1, sqrt(3) and sqrt(5)."""
    found = np.asarray(directional_light([0, 0, 1], 1.0).coefficients)[:, 0]
    expected = np.zeros(9)
    expected[[0, 2, 6]] = np.sqrt([1, 3, 5]) / (2 * np.sqrt(np.pi))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_directional_light_of_pi_makes_a_facing_white_surface_nearly_one() -> None:
    """1/4 + 1/2 + 5/16 in 3 bands; the even bands then take turns about 1."""
    facing = gash_jax.unshadowed_transfer(np.array([[0.0, 0.6, 0.8]]), 10)
    light = directional_light([0, 3, 4], bands=10)
    assert float(gash_jax.shade(facing[:, :9], light)[0, 0]) == pytest.approx(1 / 4 + 1 / 2 + 5 / 16, abs=1e-6)
    assert float(gash_jax.shade(facing, light)[0, 0]) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("angle", [0.2, 5.0, 30.0, 75.0])
def test_sphere_light_is_the_integral_over_its_disk(angle: float) -> None:
    """Gauss nodes in the cosine, equal steps about the axis: exact for polynomials of so low a degree."""
    half, axis = np.radians(angle), np.array([2.0, 3, 6]) / 7
    nodes, weights = np.polynomial.legendre.leggauss(12)
    fall = (nodes + 1) / 2 * 2 * np.sin(half / 2) ** 2  # 1 - cos
    azimuth = np.arange(24) / 24 * 2 * np.pi
    sine = np.sqrt(fall * (2 - fall))
    local = np.stack(
        np.broadcast_arrays(sine * np.cos(azimuth[:, None]), sine * np.sin(azimuth[:, None]), 1 - fall), -1
    )
    turn = Rotation.align_vectors([axis], [[0, 0, 1]])[0]
    basis = np.asarray(evaluate_sh(turn.apply(local.reshape(-1, 3)), 8), np.float64).reshape(24, 12, -1)
    expected = np.einsum("anj,n->j", basis, weights * np.sin(half / 2) ** 2) * 2 * np.pi / 24
    found = sphere_light(10 * axis, 10 * np.sin(half), [1.0, 2.0, 0.0], 8).coefficients
    np.testing.assert_allclose(found[:, 0], expected, atol=3e-6 * expected[0] * 12)
    np.testing.assert_allclose(found[:, 1], 2 * found[:, 0], rtol=1e-6)


def test_sphere_light_by_hand() -> None:
    """Half-angle 30 degrees about +z: 2 pi (1 - u) / (2 sqrt(pi)) = sqrt(pi) (1 - u); sqrt(3 pi) / 2 (1 - u²)."""
    found = np.asarray(sphere_light([0, 0, 2.0], 1.0).coefficients)[:, 0]
    u = np.sqrt(3) / 2
    np.testing.assert_allclose(found[[0, 2]], [np.sqrt(np.pi) * (1 - u), np.sqrt(3 * np.pi) / 2 * 0.25], rtol=1e-5)


def test_a_small_sphere_is_a_directional_light_and_distance_is_size() -> None:
    near, far = (sphere_light([0, d, 0], 1e-3 * d, 1e6) for d in (1.0, 50.0))
    np.testing.assert_allclose(near.coefficients, far.coefficients, rtol=1e-4, atol=1e-5)
    sun = directional_light([0, 1, 0], np.pi)  # radiance times pi sin²
    np.testing.assert_allclose(near.coefficients, sun.coefficients, atol=2e-5)


def test_directions_turn_with_the_light() -> None:
    turn = Rotation.from_rotvec([0.4, -1.0, 0.7]).as_matrix()
    place = np.array([1.0, -2, 3])
    for make in (directional_light, sphere_light):
        turned = gash_jax.rotate_light(make(place), turn)
        np.testing.assert_allclose(turned.coefficients, make(turn @ place).coefficients, atol=3e-6)


def test_azimuth_and_elevation_are_those_of_cameras() -> None:
    np.testing.assert_allclose(toward(0, 0), [0, 0, 1], atol=1e-15)
    np.testing.assert_allclose(toward(90, 0), [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(toward(45, 90), [0, 1, 0], atol=1e-15)
    quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # about +y, as --rotate 90
    np.testing.assert_allclose(quarter @ toward(20, 30), toward(110, 30), atol=1e-15)


def test_transforms() -> None:
    place = jnp.array([1.0, 2.0, 2.0])
    np.testing.assert_allclose(
        jax.jit(lambda p, r: sphere_light(p, r, 2.0))(place, 0.5).coefficients,
        sphere_light(place, 0.5, 2.0).coefficients,
        atol=1e-6,
    )
    many = jax.vmap(lambda p: directional_light(p).coefficients)(jnp.stack([place, -place]))
    np.testing.assert_allclose(many[1], directional_light(-place).coefficients, atol=1e-6)
    target = directional_light([0.0, 1.0, 0.0]).coefficients
    slope = jax.grad(lambda p: jnp.sum((jnp.asarray(directional_light(p).coefficients) - target) ** 2))(place)
    assert np.isfinite(slope).all() and abs(float(slope @ place)) < 1e-4  # the length of a direction does not matter
    slope = jax.grad(lambda r: jnp.sum(jnp.asarray(sphere_light(place, r).coefficients)))(0.5)
    assert np.isfinite(slope) and slope > 0
    slope = jax.grad(lambda c: jnp.sum(jnp.asarray(constant_light(c).coefficients)))(1.0)
    assert float(slope) == pytest.approx(6 * np.sqrt(np.pi), rel=1e-6)


def test_the_helper_integrates_the_half_sphere() -> None:
    w, area = half_sphere(np.array([0.0, 0, 1]), 100)
    basis = np.einsum("nk,n->k", np.asarray(evaluate_sh(w, 4), np.float64), area)
    np.testing.assert_allclose(basis, sphere_light([0, 0, 1.0], 1 - 1e-7, bands=4).coefficients[:, 0], atol=5e-3)


ANY: Any = gash_jax


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: ANY.constant_light(-1.0), "0 or more"),
        (lambda: ANY.constant_light([1.0, np.nan, 0.0]), "finite"),
        (lambda: ANY.constant_light([1.0, 2.0]), "three for red, green and blue"),
        (lambda: ANY.constant_light("white"), "use a number"),
        (lambda: ANY.constant_light(1.0, 11), "bands is 11"),
        (lambda: ANY.directional_light([0.0, 0, 0]), "not all 0"),
        (lambda: ANY.directional_light([0.0, np.inf, 0]), "finite"),
        (lambda: ANY.directional_light([0.0, 1.0]), "x, y, z"),
        (lambda: ANY.directional_light(3.0), "x, y, z"),
        (lambda: ANY.sphere_light([0.0, 1, 0], 1.0), "holds the mesh"),
        (lambda: ANY.sphere_light([0.0, 1, 0], 0.0), "above 0"),
        (lambda: ANY.sphere_light([0.0, 1, 0], [0.1]), "above 0"),
    ],
)
def test_what_is_no_light_is_refused(make: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        make()
    assert "\n" not in str(caught.value)
