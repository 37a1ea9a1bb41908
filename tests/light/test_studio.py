"""The studio lights from where it says, reads as a picture and has no dark ringing."""

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.light.environment import project_map
from gash_jax.light.layouts import pixel_directions
from gash_jax.light.shading import shade
from gash_jax.light.studio import KEY, RIM, studio_light


def unit(vector: tuple[float, float, float]) -> np.ndarray:
    return np.asarray(vector) / np.linalg.norm(vector)


def test_shape_range_and_lights() -> None:
    image = studio_light(64)
    assert image.shape == (64, 128, 3) and image.dtype == np.float32
    assert image.min() > 0
    directions = pixel_directions(64, 128)
    brightest = directions[np.unravel_index(image.sum(axis=-1).argmax(), (64, 128))]
    assert brightest @ unit(KEY[0]) > np.cos(np.radians(KEY[1]))
    key, rim = (image[np.unravel_index((directions @ unit(light[0])).argmax(), (64, 128))] for light in (KEY, RIM))
    assert key[0] > key[2] and rim[2] > rim[0]  # warm, cool
    brightness = image[:32].sum(axis=-1)  # above the horizon
    left_third, right_of_centre = brightness[:, :42].max(), brightness[:, 64:96].max()
    assert left_third == brightness.max() and 0.5 * brightness.max() < right_of_centre < brightness.max()
    assert image[:20].mean() > 3 * image[-20:].mean()


def test_shadows_read_and_nothing_rings_below_zero() -> None:
    light = project_map(studio_light(), 3)
    n = np.random.default_rng(0).normal(size=(2000, 3))
    n = (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)
    n[0] = unit(KEY[0])
    radiance = np.asarray(shade(unshadowed_transfer(n, 3), light))
    assert radiance.min() > 0
    assert 0.7 < radiance[0].mean() < 1.3
    assert radiance.max() > 5 * radiance.mean(axis=-1).min()


def test_resolution_changes_the_light_little() -> None:
    coarse, fine = (project_map(studio_light(height), 3) for height in (64, 256))
    assert np.linalg.norm(coarse - fine) < 0.01 * np.linalg.norm(fine)
    with pytest.raises(ValueError, match="height is 3: use a whole number from 4"):
        studio_light(3)
