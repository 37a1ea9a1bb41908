"""Lobes against quadrature of their definition, laws, numbers by hand, the exponents and roughnesses at the ends."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import roots_jacobi, roots_laguerre

from gash_jax.light.brdf import Lobe, ggx, phong
from tests.helpers.gloss import half_sphere, microfacets

LEGENDRE = [np.polynomial.legendre.Legendre.basis(band) for band in range(10)]


@pytest.mark.parametrize("exponent", [0, 0.5, 1, 2, 7.3, 30, 500, 1e4, 1e6])
def test_phong_is_its_integral(exponent: float) -> None:
    """Gauss and Jacobi's nodes on [0, 1] with the weight x^s, exact for P_l; those of Laguerre in -(s + 1) log x."""
    if exponent < 100:
        nodes, weights = roots_jacobi(20, 0, exponent)
        x, weights = (nodes + 1) / 2, weights / weights.sum()
    else:
        nodes, weights = roots_laguerre(60)
        x = np.exp(-nodes / (exponent + 1))
    expected = [np.sum(weights * basis(x)) for basis in LEGENDRE]
    np.testing.assert_allclose(phong(exponent).factors, expected, atol=1e-6)


def test_phong_by_hand() -> None:
    """s = 0 is the hemisphere 1, 1/2, 0, -1/8, 0; s = 1 the clamped cosine over pi; s large a mirror."""
    np.testing.assert_allclose(phong(0).factors[:5], [1, 0.5, 0, -0.125, 0], atol=1e-7)
    np.testing.assert_allclose(phong(1).factors[:6], [1, 2 / 3, 1 / 4, 0, -1 / 24, 0], atol=1e-7)
    np.testing.assert_array_equal(phong(1e30).factors, np.ones(10, np.float32))
    np.testing.assert_allclose(phong(1e4).factors[9], 1 - 9 * 10 / 2e4, atol=2e-5)  # 1 - l(l+1)/(2s) + ...


def _of_normal_view(alpha: float) -> np.ndarray:
    """2 pi integral of the microfacets' lobe P_l at normal view; nodes follow the peak of width alpha."""
    nodes, weights = np.polynomial.legendre.leggauss(300)
    growth = np.log1p(1 / alpha**2)
    fall = alpha**2 * np.expm1((nodes + 1) / 2 * growth)  # 1 - cos, from 0 to 1
    weights = weights / 2 * growth * (fall + alpha**2)
    w = np.stack([np.sqrt(np.maximum(1 - (1 - fall) ** 2, 0)), 0 * fall, 1 - fall], axis=-1)
    up = np.broadcast_to([0.0, 0, 1], w.shape)
    density = weights * microfacets(up, up, w, alpha)
    return np.array([np.sum(density * basis(1 - fall)) for basis in LEGENDRE]) / density.sum()


@pytest.mark.parametrize("roughness", [0.05, 0.2, 0.3, 0.5, 0.8, 1.0])
def test_ggx_is_the_lobe_of_microfacets_at_normal_view(roughness: float) -> None:
    np.testing.assert_allclose(ggx(roughness).factors, _of_normal_view(roughness**2), atol=3e-6)


def test_ggx_by_hand() -> None:
    """a = 1: f cos = (1/pi) / 4 * 2 x / (1 + x), so k_1 = integral of x²/(1+x) over that of x/(1+x)
    = (ln 2 - 1/2) / (1 - ln 2). Roughness 0 is a mirror."""
    assert float(ggx(1).factors[1]) == pytest.approx((np.log(2) - 0.5) / (1 - np.log(2)), abs=1e-6)
    np.testing.assert_allclose(ggx(0).factors, 1, atol=1e-6)


def test_microfacets_reflect_what_comes_and_no_more() -> None:
    """The oracle itself: reciprocal, at most 1 in all, 1 - ln 2 at a = 1 and normal view."""
    up, rng = np.array([0.0, 0, 1]), np.random.default_rng(0)
    w, area = half_sphere(up, 300)
    normals = np.broadcast_to(up, w.shape)
    for angle in (0.0, 45.0, 75.0):
        toward = np.broadcast_to([np.sin(np.radians(angle)), 0, np.cos(np.radians(angle))], w.shape)
        assert 0.3 < np.sum(area * microfacets(normals, toward, w, 0.3)) < 1
    assert np.sum(area * microfacets(normals, normals, w, 1.0)) == pytest.approx(1 - np.log(2), abs=1e-5)
    v, other = w[rng.permutation(len(w))[:50]], w[rng.permutation(len(w))[:50]]
    there, back = microfacets(normals[:50], v, other, 0.4), microfacets(normals[:50], other, v, 0.4)
    np.testing.assert_allclose(there / other[:, 2], back / v[:, 2], rtol=1e-9)


@pytest.mark.parametrize(("make", "sharper"), [(phong, [0.0, 1, 5, 30, 1e4]), (ggx, [1.0, 0.7, 0.4, 0.2, 0.05])])
def test_sharper_lobes_keep_more_and_none_more_than_all(make: Any, sharper: list[float]) -> None:
    found = np.array([make(value).factors for value in sharper])
    np.testing.assert_allclose(found[:, 0], 1, atol=1e-6)
    assert (np.diff(found[:, 1:3], axis=0) > 0).all() and np.abs(found).max() <= 1 + 1e-6


@pytest.mark.parametrize(("make", "values"), [(phong, [0.0, 1, 9, 30, 1e4]), (ggx, [0.0, 0.01, 0.3, 1])])
def test_transforms(make: Any, values: list[float]) -> None:
    values_array = jnp.asarray(values, jnp.float32)
    found = [make(value).factors for value in values]
    np.testing.assert_allclose(jax.vmap(make)(values_array).factors, found, atol=2e-6)
    np.testing.assert_allclose(jax.jit(make)(values_array[2]).factors, found[2], atol=2e-6)
    gradients = jax.vmap(jax.grad(lambda value: jnp.sum(make(value).factors)))(values_array)
    assert np.isfinite(gradients).all()
    step = 0.01
    slope = np.asarray(make(values[2] + step).factors - make(values[2] - step).factors).sum() / (2 * step)
    assert float(gradients[2]) == pytest.approx(float(slope), rel=0.02)


@pytest.mark.parametrize("value", [-1, float("nan"), float("inf"), "30", None, np.ones(2)])
def test_what_is_no_lobe_is_refused(value: Any) -> None:
    for make, words in ((phong, "use a number of 0 or more"), (ggx, "use a number from 0 to 1")):
        with pytest.raises(ValueError, match=words) as caught:
            make(value)
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="roughness is 1.5"):
        ggx(1.5)
    assert isinstance(phong(np.float32(3)), Lobe)
