import numpy as np
import pytest

from gash_jax.geometry.bilinear import lookup, taps


def test_centres_are_where_graphics_has_them() -> None:
    image = np.arange(16.0).reshape(4, 4, 1)
    places = np.array([[0.125, 0.125], [0.875, 0.125], [0.125, 0.875], [0.25, 0.125], [0.125, 0.25]])
    # u to the right, v downwards, centres at (j + 1/2) / 4; between two of them their mean
    np.testing.assert_allclose(lookup(image, places)[:, 0], [0, 3, 12, 0.5, 2])


def test_what_is_linear_is_looked_up_exactly_and_beyond_the_last_centre_it_stays() -> None:
    size = 7
    row, column = np.mgrid[:size, :size] + 0.5
    image = np.stack([2 * column - row + 3, row], axis=-1) / size
    uv = np.random.default_rng(0).uniform(0.5 / size, 1 - 0.5 / size, (50, 2))
    expected = np.stack([2 * uv[:, 0] - uv[:, 1] + 3 / size, uv[:, 1]], axis=1)
    np.testing.assert_allclose(lookup(image, uv), expected, atol=1e-12)
    np.testing.assert_array_equal(lookup(image, np.array([[-1.0, 2.0]]))[0], image[-1, 0])


@pytest.mark.parametrize("size", [1, 2, 5])
def test_weights_sum_to_one_and_name_texels_that_exist(size: int) -> None:
    index, weights = taps(np.random.default_rng(1).uniform(-0.2, 1.2, (100, 2)), size)
    np.testing.assert_allclose(weights.sum(axis=1), 1)
    assert weights.min() >= 0 and index.min() >= 0 and index.max() < size**2
    assert lookup(np.full((size, size, 1), 7.0), np.array([[0.3, 0.9]]))[0, 0] == pytest.approx(7)
