import numpy as np
import pytest

from gash_jax.geometry.mesh import MeshError
from gash_jax.geometry.texture_coordinates import checked_coordinates, corner_areas
from tests.helpers.textured import SQUARE_UV


def test_what_is_good_stays_and_a_tile_of_a_set_is_moved() -> None:
    np.testing.assert_array_equal(checked_coordinates(SQUARE_UV, 2), SQUARE_UV)
    np.testing.assert_allclose(checked_coordinates(SQUARE_UV * 0.5 + [3.0, -2.0], 2), SQUARE_UV * 0.5)
    np.testing.assert_array_equal(checked_coordinates(SQUARE_UV.astype(np.float64) - 1, 2), SQUARE_UV)
    np.testing.assert_allclose(corner_areas(SQUARE_UV), [-0.5, -0.5])  # v downwards turns the way round
    np.testing.assert_allclose(checked_coordinates(SQUARE_UV * 1.00005, 2), SQUARE_UV, atol=1e-4)


@pytest.mark.parametrize(
    ("uv", "words"),
    [
        (SQUARE_UV[:1], "shape"),
        (SQUARE_UV.astype(complex), "shape"),
        (np.where(SQUARE_UV == 0, np.nan, SQUARE_UV), "no texture coordinates"),
        (SQUARE_UV * 2, "several tiles"),
        (SQUARE_UV + [0.5, 0.0], "several tiles"),
        (SQUARE_UV * [1, 0], "no face has an area"),
    ],
)
def test_what_is_refused(uv: np.ndarray, words: str) -> None:
    with pytest.raises(MeshError, match=words) as refusal:
        checked_coordinates(uv, 2)
    assert "\n" not in str(refusal.value)
