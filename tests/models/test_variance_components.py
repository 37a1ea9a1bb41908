"""Variance components: a fixed point of the likelihood, what is found of what was put in, what explains nothing."""

import numpy as np
import pytest

from gash_jax.models.variance_components import variance_components

RNG = np.random.default_rng(11)
COUNT, OUTPUTS = 60, 400


def kernels(count: int) -> np.ndarray:
    found = []
    for _ in range(count):
        x = RNG.normal(size=(COUNT, 2))
        found.append(np.exp(-((x[:, None] - x) ** 2).sum(axis=2)))
    return np.stack(found)


def drawn(amounts: list[float], noise: float, given: np.ndarray) -> np.ndarray:
    """Products of outputs that are drawn with these components."""
    covariance = np.tensordot(amounts, given, axes=1) + noise * np.eye(COUNT)
    outputs = np.linalg.cholesky(covariance) @ RNG.normal(size=(COUNT, OUTPUTS))
    return outputs @ outputs.T


def likelihood(amounts: np.ndarray, noise: float, given: np.ndarray, gram: np.ndarray) -> float:
    covariance = np.tensordot(amounts, given, axes=1) + noise * np.eye(COUNT)
    return -float(np.linalg.slogdet(covariance)[1]) - float(np.sum(np.linalg.inv(covariance) * gram)) / OUTPUTS


def test_it_finds_what_was_put_in() -> None:
    given = kernels(4)
    found = variance_components(given, drawn([2.0, 0.0, 0.5, 0.0], 0.1, given), OUTPUTS, 4)
    np.testing.assert_allclose(found.amounts[[0, 2]], [2.0, 0.5], rtol=0.15)
    assert found.noise == pytest.approx(0.1, rel=0.2) and found.amounts[[1, 3]].max() < 0.05


def test_no_other_components_are_more_likely() -> None:
    given = kernels(3)
    gram = drawn([1.0, 0.3, 0.1], 0.2, given)
    found = variance_components(given, gram, OUTPUTS, 3)
    best = likelihood(found.amounts, found.noise, given, gram)
    for part in range(3):
        for factor in (0.7, 1.4):
            other = found.amounts * np.where(np.arange(3) == part, factor, 1)
            assert likelihood(other, found.noise, given, gram) < best
    assert likelihood(found.amounts, 1.3 * found.noise, given, gram) < best


def test_by_hand_one_kernel_without_noise() -> None:
    """Outputs of covariance 3 I and the kernel I, of which nothing tells kernel and noise apart: they share the 3."""
    found = variance_components(np.eye(5)[None], 3.0 * 7 * np.eye(5), 7, 1)
    assert found.amounts[0] + found.noise == pytest.approx(3.0)
    scaled = variance_components(np.eye(5)[None], 300.0 * 7 * np.eye(5), 7, 1)
    np.testing.assert_allclose(scaled.amounts, 100 * found.amounts)


def test_the_largest_are_kept_and_nothing_is_something() -> None:
    given = kernels(5)
    gram = drawn([1.0, 0.0, 2.0, 0.0, 0.2], 0.05, given)
    found = variance_components(given, gram, OUTPUTS, 2)
    assert np.flatnonzero(found.amounts).tolist() == [0, 2]
    nothing = variance_components(given, np.zeros((COUNT, COUNT)), OUTPUTS, 2)
    assert np.isfinite(nothing.amounts).all() and 0 < nothing.noise < 1e-20 and nothing.amounts.max() < 1e-20
