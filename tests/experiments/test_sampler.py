"""The sampler question: known figures of the published rule, its five coincident directions, the exact values."""

import numpy as np
import pytest

from experiments.sampler import sampler
from gash_jax.algebra.directions import spherical_fibonacci


def test_five_of_the_25_directions_coincide() -> None:
    directions = sampler.published_directions()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    assert np.sum(np.abs(directions - [0, 0, 1]).max(axis=1) < 1e-12) == 5
    assert len(np.unique(np.round(directions, 9), axis=0)) == 21


def test_the_published_error_is_what_is_known_of_it() -> None:
    published, fibonacci = sampler.errors("published"), sampler.errors("Fibonacci")
    # measured before as 0.0445 over another set of normals; over the whole sphere it is 0.0450
    assert published.mean() == pytest.approx(0.0445, rel=0.02)
    assert published.mean() == pytest.approx(0.04496, abs=1e-5)
    assert published[[0, 2, 6]].sum() / published.sum() == pytest.approx(0.98, abs=5e-3)
    assert fibonacci.mean() == pytest.approx(0.0004, abs=5e-5)


def test_the_estimate_converges_to_the_exact_values() -> None:
    normals = spherical_fibonacci(50)
    fine = sampler.estimate(spherical_fibonacci(40000), normals)
    np.testing.assert_allclose(fine, sampler.exact(normals), atol=2e-4)


def test_by_hand() -> None:
    """One direction straight up the normal sees all of it: 4 pi Y(n)."""
    up = np.array([[0.0, 0.0, 1.0]])
    value = sampler.estimate(up, up)[0]
    np.testing.assert_allclose(value[[0, 2]], [4 * np.pi * 0.2820948, 4 * np.pi * 0.4886025], rtol=1e-6)
    assert np.abs(value[[1, 3]]).max() == 0
