"""Gaunt coefficients: Racah's formula with exact integers, the product of functions, selection rules, by hand."""

from math import factorial, pi, sqrt

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.gaunt import gaunt_terms, multiplier, product_bands, product_matrices
from gash_jax.algebra.sh import band_index, sh_components


def _dense(bands: int) -> np.ndarray:
    terms = gaunt_terms(bands)
    dense = np.zeros((bands**2, bands**2, (2 * bands - 1) ** 2))
    dense[terms.i, terms.j, terms.k] = terms.value
    return dense


def _basis(directions: np.ndarray, bands: int) -> np.ndarray:
    x, y, z = directions.T
    return np.stack(sh_components(x, y, z, bands), axis=-1)


def _directions(count: int) -> np.ndarray:
    n = np.random.default_rng(3).normal(size=(count, 3))
    return n / np.linalg.norm(n, axis=1, keepdims=True)


def _wigner(a: int, b: int, c: int, m: int, n: int, o: int) -> float:
    """Wigner's 3j symbol by Racah's formula: a sum of integers, so that nothing cancels."""
    if m + n + o or not abs(a - b) <= c <= a + b or abs(m) > a or abs(n) > b or abs(o) > c:
        return 0.0
    total, scale = 0, factorial(a + b + c)
    for t in range(max(0, b - c - m, a - c + n), min(a + b - c, a - m, b + n) + 1):
        below = (t, a + b - c - t, a - m - t, b + n - t, c - b + t + m, c - a + t - n)
        total += (-1) ** t * scale**2 // int(np.prod([factorial(x) for x in below], dtype=object))
    triangle = factorial(a + b - c) * factorial(a - b + c) * factorial(b + c - a) / factorial(a + b + c + 1)
    tops = [factorial(x) for x in (a + m, a - m, b + n, b - n, c + o, c - o)]
    return (-1) ** (a - b - o) * sqrt(triangle * int(np.prod(tops, dtype=object))) * (total / scale**2)


def _complex(m: int) -> list[tuple[int, complex]]:
    """The real harmonic m as a sum of the complex ones, which have Condon and Shortley's sign: (m', factor)."""
    if m == 0:
        return [(0, 1.0)]
    sign = (-1) ** m
    return [(m, sign / sqrt(2)), (-m, 1 / sqrt(2))] if m > 0 else [(-m, -1j * sign / sqrt(2)), (m, 1j / sqrt(2))]


def _racah(lm: list[tuple[int, int]]) -> float:
    """Integral of three real harmonics."""
    (a, m), (b, n), (c, o) = lm
    scale = sqrt((2 * a + 1) * (2 * b + 1) * (2 * c + 1) / (4 * pi)) * _wigner(a, b, c, 0, 0, 0)
    parts = [(x * y * z, p, q, r) for p, x in _complex(m) for q, y in _complex(n) for r, z in _complex(o)]
    return float(np.real(sum(factor * scale * _wigner(a, b, c, p, q, r) for factor, p, q, r in parts)))


def test_against_wigners_symbols() -> None:
    """All of three bands, and 300 of ten; a third of those vanish."""
    place = [(band, m) for band in range(19) for m in range(-band, band + 1)]
    every = [(i, j, k) for i in range(9) for j in range(9) for k in range(25)]
    np.testing.assert_allclose(
        _dense(3)[*np.transpose(every)], [_racah([place[x] for x in t]) for t in every], atol=1e-14
    )
    dense, terms, rng = _dense(10), gaunt_terms(10), np.random.default_rng(0)
    chosen = rng.permutation(len(terms.i))[:200]
    some = np.stack(terms[:3], -1)[chosen].tolist() + rng.integers(0, [100, 100, 361], (100, 3)).tolist()
    expected = np.array([_racah([place[x] for x in t]) for t in some])
    np.testing.assert_allclose(dense[*np.transpose(some)], expected, atol=1e-13)
    assert 200 <= np.count_nonzero(np.abs(expected) > 1e-9) <= 230


def test_by_hand() -> None:
    """Y_0 times anything is Y_00 times it. z² = (1 + 2 P_2) / 3: Y_10² has 1/sqrt(4 pi) of Y_00, 1/sqrt(5 pi) of Y_20;
    Y_1x Y_1y has only xy."""
    dense = _dense(2)
    np.testing.assert_allclose(dense[0, :, :4], np.eye(4) / sqrt(4 * pi), atol=1e-15)
    np.testing.assert_allclose(dense[2, 2], [1 / sqrt(4 * pi), 0, 0, 0, 0, 0, 1 / sqrt(5 * pi), 0, 0], atol=1e-15)
    np.testing.assert_allclose(dense[3, 1], [0, 0, 0, 0, sqrt(3 / (20 * pi)), 0, 0, 0, 0], atol=1e-15)


@pytest.mark.parametrize("bands", [1, 4, 10])
def test_selection_rules_and_symmetry(bands: int) -> None:
    """Parity, triangle, |m|; any order of the indices; the rules leave nothing else that vanishes but a few."""
    i, j, k, value = gaunt_terms(bands)
    band = band_index(2 * bands - 1)
    m = np.abs(np.arange((2 * bands - 1) ** 2) - band * (band + 1))
    assert ((band[i] + band[j] + band[k]) % 2 == 0).all()
    assert (np.abs(band[i] - band[j]) <= band[k]).all() and (band[k] <= band[i] + band[j]).all()
    assert ((m[k] == m[i] + m[j]) | (m[k] == np.abs(m[i] - m[j]))).all()
    dense, low = _dense(bands), bands**2
    np.testing.assert_array_equal(dense != 0, dense.swapaxes(0, 1) != 0)
    np.testing.assert_allclose(dense, dense.swapaxes(0, 1), atol=1e-14)
    np.testing.assert_allclose(dense[..., :low], dense[..., :low].transpose(2, 1, 0), atol=1e-14)
    assert np.abs(value).min() > 1e-6


@pytest.mark.parametrize("bands", [1, 3, 10])
def test_products_are_their_expansion(bands: int) -> None:
    """Y_i Y_j = sum_k G_ijk Y_k at any direction."""
    directions = _directions(9)
    low = _basis(directions, bands)
    expanded = np.einsum("ijk,nk->nij", _dense(bands), _basis(directions, 2 * bands - 1))
    np.testing.assert_allclose(expanded, low[:, :, None] * low[:, None], atol=1e-12)


def test_matrices_multiply_and_the_multiplier_is_their_product() -> None:
    """M c of a function f in 2B-1 bands are the low coefficients of f times c: exactly those where f has few bands."""
    bands, rng = 4, np.random.default_rng(1)
    f, c = np.zeros((5, 49), np.float32), np.zeros((16, 3), np.float32)
    f[:, :4], c[:9] = rng.normal(size=(5, 4)), rng.normal(size=(9, 3))  # 2 bands times 3 bands are 4 bands
    matrices, directions = np.asarray(product_matrices(f)), _directions(40)
    np.testing.assert_allclose(matrices, matrices.swapaxes(1, 2), atol=1e-6)
    basis = _basis(directions, bands)
    product = np.einsum("vij,jc,ni->vnc", matrices, c, basis)
    values = (f @ _basis(directions, 7).T)[..., None] * (basis @ c)[None]
    np.testing.assert_allclose(product, values, atol=1e-5)
    f, c = (rng.normal(size=shape).astype(np.float32) for shape in ((5, 49), (16, 3)))
    expected = np.einsum("vij,jc->vic", product_matrices(f), c)
    np.testing.assert_allclose(np.einsum("vj,jic->vic", f, multiplier(c)), expected, atol=1e-5)


def test_transforms() -> None:
    f = np.random.default_rng(2).normal(size=(2, 3, 9)).astype(np.float32)
    plain = product_matrices(f)
    assert plain.shape == (2, 3, 4, 4)
    np.testing.assert_allclose(jax.vmap(product_matrices)(f), plain, atol=1e-6)
    gradient = jax.grad(lambda g: jnp.sum(product_matrices(g)[..., 0, 0]))(jnp.asarray(f))
    np.testing.assert_allclose(gradient, np.broadcast_to(_dense(2)[0, 0], f.shape), atol=1e-6)
    c = np.random.default_rng(3).normal(size=(5, 4, 3)).astype(np.float32)
    np.testing.assert_allclose(jax.vmap(multiplier)(c), [multiplier(one) for one in c], atol=1e-6)
    assert np.isfinite(jax.grad(lambda light: jnp.sum(multiplier(light) ** 3))(jnp.asarray(c[0]))).all()


@pytest.mark.parametrize(
    ("count", "words"), [(4, "2 bands: products need an odd"), (400, "no square"), (8, "no square")]
)
def test_numbers_of_coefficients_that_no_product_has(count: int, words: str) -> None:
    assert [product_bands((2 * bands - 1) ** 2) for bands in range(1, 11)] == list(range(1, 11))
    with pytest.raises(ValueError, match=words):
        product_bands(count)
    with pytest.raises(ValueError, match=words):
        product_matrices(np.zeros((2, count), np.float32))
    with pytest.raises(ValueError, match="from 1 to 10"):
        gaunt_terms(11)
