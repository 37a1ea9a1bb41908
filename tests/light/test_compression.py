"""Transfer and light in fewer numbers and bits: sizes, bounds, colours, whole bakes, what is refused."""

from typing import Any

import jax
import numpy as np
import pytest

import gash_jax
from gash_jax.algebra.zonal import from_zonal, light_curve, to_zonal, transfer_curve
from gash_jax.light.compression import (
    Compressed,
    compress_light,
    compress_transfer,
    expand_light,
    expand_transfer,
)
from gash_jax.shapes.primitives import bumpy_sphere

RNG = np.random.default_rng(0)
ROWS = RNG.normal(size=(40, 9)).astype(np.float32)
LIGHT = RNG.normal(size=(9, 3)).astype(np.float32)


def test_by_hand() -> None:
    """The largest magnitude, 2, becomes 127; 1 is 63.5 and goes to the even 64; 0.01 is 0.635 and goes to 1."""
    small = compress_transfer(np.array([[-2.0, 1, 0.01, 0, 0, 0, 0, 0, 0]]))
    assert small.values.tolist() == [[-127, 64, 1, 0, 0, 0, 0, 0, 0]] and float(small.scale) == 2
    np.testing.assert_allclose(expand_transfer(small)[0, :3], [-2, 128 / 127, 2 / 127], rtol=1e-6)
    wide = compress_light(np.eye(9)[:, :3] * 0.5, bits=16)
    assert np.asarray(wide.values).max() == 32767 and float(wide.scale) == 0.5


@pytest.mark.parametrize(("bits", "bytes_each"), [(8, 1), (16, 2), (32, 4)])
@pytest.mark.parametrize("numbers", [None, 5, 4])
def test_sizes_and_bounds(numbers: int | None, bits: int, bytes_each: int) -> None:
    count = numbers or 9
    small = compress_transfer(ROWS, numbers, bits)
    assert small.values.shape == (40, count) and small.values.nbytes == 40 * count * bytes_each
    kept = np.asarray(to_zonal(ROWS))[:, :count] if numbers else ROWS
    step = 0.0 if bits == 32 else np.abs(kept).max() / (2 ** (bits - 1) - 1)
    read = np.asarray(small.values, np.float64) * (step or 1.0)
    assert np.abs(read - kept).max() <= step / 2 * (1 + 1e-5) + 1e-6
    lit = compress_light(LIGHT, numbers, bits)
    assert lit.values.shape == (count, 3) and lit.values.nbytes == 3 * count * bytes_each
    assert expand_transfer(small).shape == (40, 9) and expand_light(lit).shape == (9, 3)


def test_floats_are_the_zonal_forms() -> None:
    for numbers in (4, 5):
        found = expand_transfer(compress_transfer(ROWS, numbers, 32))
        np.testing.assert_array_equal(found, from_zonal(to_zonal(ROWS)[:, :numbers], transfer_curve))
        lit = expand_light(compress_light(LIGHT, numbers, 32))
        np.testing.assert_array_equal(lit, from_zonal(to_zonal(LIGHT.T)[:, :numbers], light_curve).T)
    np.testing.assert_array_equal(expand_light(compress_light(LIGHT, bits=32)), LIGHT)


def test_colours_are_compressed_each_for_itself() -> None:
    coloured = RNG.normal(size=(20, 9, 3)).astype(np.float32)
    small = compress_transfer(coloured, 5, 32)
    assert small.values.shape == (20, 5, 3)
    for c in range(3):
        alone = expand_transfer(compress_transfer(coloured[..., c], 5, 32))
        np.testing.assert_allclose(expand_transfer(small)[..., c], alone, atol=1e-6)


def test_more_bands_are_cut_for_fewer_numbers_and_kept_without() -> None:
    more = RNG.normal(size=(10, 16)).astype(np.float32)
    np.testing.assert_array_equal(compress_transfer(more, 5).values, compress_transfer(more[:, :9], 5).values)
    assert expand_transfer(compress_transfer(more, bits=16)).shape == (10, 16)


def test_a_bake_survives_in_four_bytes_a_vertex() -> None:
    """The closed form to the step of 8 bits; a shadowed mesh within a tenth, and better than without band 2."""
    mesh = bumpy_sphere(8)
    light = gash_jax.load_light("sun-sky:elevation=30")
    free = np.asarray(gash_jax.unshadowed_transfer(mesh.normals, 3))
    step = np.abs(free[:, :4]).max() / 127
    assert np.abs(np.asarray(expand_transfer(compress_transfer(free, 4))) - free).max() < 2 * step
    transfer = gash_jax.bake_transfer(mesh, rays=64)
    small = compress_transfer(transfer, 4)
    assert small.values.nbytes == 4 * len(mesh.vertices)
    exact = np.asarray(gash_jax.shade(transfer, light))

    def error(coefficients: Any) -> float:
        found = np.asarray(gash_jax.shade(coefficients, light))
        return float(np.sqrt(np.sum((found - exact) ** 2) / np.sum(exact**2)))

    assert error(expand_transfer(small)) < 0.1
    cut = np.pad(np.asarray(transfer.coefficients)[:, :4], ((0, 0), (0, 5)))
    assert error(expand_transfer(small)) < error(cut) / 2


def test_transforms_and_black() -> None:
    both = lambda t: expand_transfer(compress_transfer(t, 5, 16))  # noqa: E731
    np.testing.assert_allclose(jax.jit(both)(ROWS), both(ROWS), atol=1e-4)
    assert isinstance(jax.jit(lambda t: compress_transfer(t, 4))(ROWS), Compressed)
    many = jax.vmap(lambda c: expand_light(compress_light(c, 4)))(np.stack([LIGHT, 2 * LIGHT]))
    np.testing.assert_allclose(many[1], expand_light(compress_light(2 * LIGHT, 4)), atol=1e-5)
    for bits in (8, 16, 32):
        np.testing.assert_array_equal(expand_light(compress_light(np.zeros((9, 3)), 4, bits)), 0)
    assert expand_transfer(compress_transfer(np.zeros((0, 9)), 4)).shape == (0, 9)


ANY: Any = gash_jax


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ANY.compress_transfer(ROWS, 6), "numbers is 6: use a whole number from 4 to 5"),
        (lambda: ANY.compress_transfer(ROWS, bits=12), "bits is 12: use 8, 16 or 32"),
        (lambda: ANY.compress_transfer(ROWS, bits="8"), "bits is '8'"),
        (lambda: ANY.compress_transfer(ROWS[:, :4], 4), "less than three bands"),
        (lambda: ANY.compress_light(LIGHT[:4]), "two bands are four numbers already"),
        (lambda: ANY.compress_light(ROWS), "red, green and blue"),
        (lambda: ANY.compress_transfer(LIGHT), "no square"),
    ],
)
def test_what_cannot_be_meant_is_refused(call: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)
