"""Light in the numbers of e3nn and Dr.Jit (Mitsuba 3), evaluated by these libraries. Needs the extra `peers`."""

from typing import Any

import numpy as np
import pytest

import gash_jax
from gash_jax.algebra.sh import evaluate_sh

RNG = np.random.default_rng(11)
DIRECTIONS = RNG.normal(size=(50, 3))
DIRECTIONS = (DIRECTIONS / np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)).astype(np.float32)


def _light(bands: int) -> np.ndarray:
    return RNG.normal(size=(bands * bands, 3)).astype(np.float32)


@pytest.mark.parametrize("bands", range(1, 10))  # from l = 9 on e3nn itself mixes ranks, which these tests forbid
def test_e3nn_evaluates_our_light(bands: int) -> None:
    e3nn: Any = pytest.importorskip("e3nn_jax", reason="needs e3nn-jax: make peers")
    light = _light(bands)
    directions = e3nn.IrrepsArray("1o", DIRECTIONS)
    basis = e3nn.spherical_harmonics(list(range(bands)), directions, True, normalization="integral").array
    shown = np.asarray(basis) @ gash_jax.to_convention(light, "e3nn")
    np.testing.assert_allclose(shown, evaluate_sh(DIRECTIONS, bands) @ light, atol=1e-4)


@pytest.mark.parametrize("bands", range(1, 11))
def test_drjit_evaluates_our_light(bands: int) -> None:
    dr: Any = pytest.importorskip("drjit", reason="needs drjit, which comes with mitsuba: the extra `peers`")
    scalar: Any = pytest.importorskip("drjit.scalar")
    light = _light(bands)
    basis = np.array([[float(y) for y in dr.sh_eval(scalar.Array3f(*map(float, d)), bands - 1)] for d in DIRECTIONS])
    shown = basis @ gash_jax.to_convention(light, "mitsuba")
    np.testing.assert_allclose(shown, evaluate_sh(DIRECTIONS, bands) @ light, atol=1e-4)
