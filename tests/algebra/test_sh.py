import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import sphericart
from numpy.polynomial.legendre import Legendre, leggauss
from scipy.special import lpmv, sph_harm_y

from gash_jax.algebra import sh

pytestmark = pytest.mark.optimised


def _directions(count=200, seed=0):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def _basis(directions, bands):
    x, y, z = np.moveaxis(directions, -1, 0)
    return np.stack(sh.sh_components(x, y, z, bands), axis=-1)


def _sphere_quadrature(order):
    """Gauss-Legendre in z times the trapezoid rule in azimuth: exact for polynomials below degree 2 order."""
    z, weight = leggauss(order)
    azimuth = np.arange(2 * order) * np.pi / order
    radius = np.sqrt(1 - z * z)
    x, y = radius[:, None] * np.cos(azimuth), radius[:, None] * np.sin(azimuth)
    directions = np.stack([x, y, np.broadcast_to(z[:, None], x.shape)], axis=-1).reshape(-1, 3)
    return directions, np.repeat(weight, 2 * order) * np.pi / order


def test_golden_order_and_signs():
    """Convention: k = l*l + l + m, no Condon-Shortley sign, band 1 is (y, z, x), polar axis z."""
    x, y, z = 0.6, 0.48, 0.64
    expected = [
        0.28209479177387814,
        0.4886025119029199 * y,
        0.4886025119029199 * z,
        0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        1.0925484305920792 * y * z,
        0.31539156525252005 * (3 * z * z - 1),
        1.0925484305920792 * x * z,
        0.5462742152960396 * (x * x - y * y),
        0.5900435899266435 * y * (3 * x * x - y * y),
        2.890611442640554 * x * y * z,
        0.4570457994644658 * y * (5 * z * z - 1),
        0.3731763325901154 * z * (5 * z * z - 3),
        0.4570457994644658 * x * (5 * z * z - 1),
        1.445305721320277 * z * (x * x - y * y),
        0.5900435899266435 * x * (x * x - 3 * y * y),
    ]
    np.testing.assert_allclose(_basis(np.array([[x, y, z]]), 4)[0], expected, rtol=1e-14)


def test_agrees_with_sphericart():
    directions = _directions()
    expected = np.asarray(sphericart.SphericalHarmonics(9).compute(directions))
    np.testing.assert_allclose(_basis(directions, 10), expected, atol=1e-13)


def test_agrees_with_scipy():
    directions = _directions()
    theta, phi = np.arccos(directions[:, 2]), np.arctan2(directions[:, 1], directions[:, 0])
    basis = _basis(directions, 10)
    for band in range(10):
        for m in range(band + 1):
            # scipy carries the Condon-Shortley sign
            value = sph_harm_y(band, m, theta, phi) * (-1) ** m * (math.sqrt(2) if m else 1)
            np.testing.assert_allclose(basis[:, band * band + band + m], value.real, atol=1e-13)
            if m:
                np.testing.assert_allclose(basis[:, band * band + band - m], value.imag, atol=1e-13)


def test_legendre_functions_by_hand():
    """P_0 .. P_2 and, without (1 - z^2)^(1/2), P_11 = 1, P_21 = 3 z: at z = 1/2."""
    half = np.array(0.5)
    np.testing.assert_allclose(sh.legendre_functions(half, 1.0, 3, 0), [1, 0.5, -0.125], rtol=1e-15)
    np.testing.assert_allclose(sh.legendre_functions(half, 1.0, 3, 1), [1, 1.5], rtol=1e-15)
    assert sh.legendre_functions(half, 1.0, 3, 2) == [1.0]


def test_legendre_functions_agree_with_scipy_in_both_normalisations():
    z = np.linspace(-1, 1, 41)
    for m in range(10):
        first = float(np.prod(np.arange(1, 2 * m, 2))) * np.sqrt(1 - z * z) ** m
        plain = sh.legendre_functions(z, first, 10, m)
        expected = [(-1) ** m * lpmv(m, band, z) for band in range(m, 10)]  # scipy carries the Condon-Shortley sign
        np.testing.assert_allclose(plain, expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
        norms = [
            math.sqrt((2 * band + 1) / 2 * math.factorial(band - m) / math.factorial(band + m)) for band in range(m, 10)
        ]
        normalised = sh.legendre_functions(z, norms[0] * first, 10, m, normalised=True)
        np.testing.assert_allclose(normalised, np.array(norms)[:, None] * expected, atol=1e-13)


def test_legendre_functions_transform():
    z = jnp.linspace(-1, 1, 9)
    for normalised in (False, True):

        def last(z: jax.Array, normalised: bool = normalised) -> jax.Array:
            return sh.legendre_functions(z, jnp.ones_like(z), 6, 1, normalised=normalised)[-1]

        np.testing.assert_allclose(jax.jit(last)(z), last(z), rtol=1e-5)
        np.testing.assert_allclose(jax.vmap(last)(z), last(z), rtol=1e-5)
        assert np.isfinite(jax.vmap(jax.grad(last))(z)).all()


def test_orthonormal():
    directions, weights = _sphere_quadrature(20)
    basis = _basis(directions, 19)
    np.testing.assert_allclose(basis.T @ (weights[:, None] * basis), np.eye(361), atol=1e-13)


@pytest.mark.parametrize("bands", [*range(1, 11), 19])
def test_addition_theorem_and_prefix(bands):
    directions = np.concatenate([_directions(20), np.eye(3), -np.eye(3)])
    basis = _basis(directions, bands)
    assert basis.shape == (26, bands * bands)
    np.testing.assert_array_equal(basis, _basis(directions, 19)[:, : bands * bands])
    last = np.sum(basis[:, (bands - 1) ** 2 :] ** 2, axis=1)
    np.testing.assert_allclose(last, (2 * bands - 1) / (4 * np.pi), rtol=1e-13)


def test_zonal_expansion():
    """A zonal function z_l about d has coefficients sqrt(4 pi/(2l+1)) z_l Y_lm(d)."""
    axis, w = directions = _directions(2, seed=5)
    basis = _basis(directions, 4)
    zonal = np.array([0.7, -0.3, 0.2, 0.5])
    bands = np.arange(4)
    cosine = axis @ w
    about_z = sum(
        z * math.sqrt((2 * band + 1) / (4 * np.pi)) * Legendre.basis(band)(cosine) for band, z in enumerate(zonal)
    )
    scale = np.repeat(np.sqrt(4 * np.pi / (2 * bands + 1)) * zonal, 2 * bands + 1)
    np.testing.assert_allclose((scale * basis[0]) @ basis[1], about_z, rtol=1e-13)


def test_parseval():
    coefficients = np.random.default_rng(1).normal(size=25)
    directions, weights = _sphere_quadrature(8)
    energy = weights @ (_basis(directions, 5) @ coefficients) ** 2
    np.testing.assert_allclose(energy, coefficients @ coefficients, rtol=1e-13)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_components_keep_kind_shape_and_dtype(dtype):
    x, y, z = np.moveaxis(_directions(63).reshape(7, 9, 3), -1, 0).astype(dtype)
    components = sh.sh_components(x, y, z, 4)
    assert len(components) == 16
    for component in components:
        assert isinstance(component, np.ndarray) and component.shape == (7, 9) and component.dtype == dtype


@pytest.mark.parametrize("lead", [(), (7, 9)])
def test_components_of_jax_arrays_are_jax_arrays(lead):
    axes = jnp.asarray(_directions(63)[:, 0].reshape(7, 9) if lead else 0.5, jnp.float32)
    for component in sh.sh_components(axes, axes, axes, 3):
        assert isinstance(component, jax.Array) and component.shape == lead and component.dtype == jnp.float32


def test_float32_error_in_the_highest_band():
    directions = _directions(2000).astype(np.float32)
    exact = _basis(directions.astype(np.float64), 10)
    basis = _basis(directions, 10)
    assert basis.dtype == np.float32 and np.abs(basis - exact).max() < 1e-5


def test_evaluate_transforms():
    directions = _directions(5).astype(np.float32)
    eager = _basis(directions, 4)
    np.testing.assert_allclose(sh.evaluate_sh(directions, 4), eager, atol=1e-6)
    np.testing.assert_allclose(jax.vmap(lambda d: sh.evaluate_sh(d, 4))(directions), eager, atol=1e-6)
    np.testing.assert_allclose(sh.evaluate_sh(directions.reshape(5, 1, 3), 4)[:, 0], eager, atol=1e-6)
    poles = jnp.asarray(np.concatenate([directions, np.eye(3), -np.eye(3)]), jnp.float32)
    jacobian = jax.vmap(jax.jacobian(lambda d: sh.evaluate_sh(d, 4)))(poles)
    np.testing.assert_allclose(jacobian[:, 1:4], 0.488602512 * np.tile(np.eye(3)[[1, 2, 0]], (11, 1, 1)), rtol=1e-6)
    assert np.isfinite(jacobian).all()


@pytest.mark.parametrize("bands", [0, -1, 11, 99, 2.0, True, "3"])
def test_bands_outside_the_range_are_refused(bands):
    with pytest.raises(ValueError, match="use a whole number from 1 to 10"):
        sh.validate_bands(bands)


def test_bands_of_products_end_at_nineteen():
    assert sh.PRODUCT_BANDS == 19 and sh.bands_of(361, sh.PRODUCT_BANDS) == 19
    for refused in (lambda: sh.bands_of(361), lambda: sh.bands_of(400, sh.PRODUCT_BANDS), lambda: sh.band_index(20)):
        with pytest.raises(ValueError, match="1 to 1"):
            refused()


def test_bands_inside_the_range_pass():
    for bands in range(1, sh.MAX_BANDS + 1):
        sh.validate_bands(bands)


def test_band_index_by_hand():
    np.testing.assert_array_equal(sh.band_index(3), [0, 1, 1, 1, 2, 2, 2, 2, 2])


def test_windows_by_hand():
    hann, lanczos = sh.hann_window(4, 3), sh.lanczos_window(4, 3)
    first = sh.band_index(4) ** 2 + sh.band_index(4)
    np.testing.assert_array_equal(hann, hann[first])
    np.testing.assert_array_equal(lanczos, lanczos[first])
    np.testing.assert_allclose(hann[[0, 2, 6, 12]], [1, 0.75, 0.25, 0], atol=1e-15)
    root = math.sqrt(3) / 2
    np.testing.assert_allclose(lanczos[[0, 2, 6, 12]], [1, root / (np.pi / 3), root / (2 * np.pi / 3), 0], atol=1e-15)


@pytest.mark.parametrize("window", [sh.hann_window, sh.lanczos_window])
def test_windows_fall_and_stay_zero_beyond_their_width(window):
    factors = window(10, 5.5)[np.arange(10) ** 2]
    assert (np.diff(factors[:7]) < 0).all() and (factors[6:] == 0).all()
    with pytest.raises(ValueError, match="above 0"):
        window(3, 0.0)
