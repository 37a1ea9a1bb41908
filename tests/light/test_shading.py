"""Relighting: the constant light, numbers by hand, windows, albedo, transforms."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.sh import hann_window, sh_components
from gash_jax.light.environment import Light, light_metadata, project_map
from gash_jax.light.shading import shade
from gash_jax.prt.transfer import Transfer


def normals(count: int) -> np.ndarray:
    n = np.random.default_rng(0).normal(size=(count, 3))
    return (n / np.linalg.norm(n, axis=1, keepdims=True)).astype(np.float32)


def basis(directions: np.ndarray, bands: int) -> np.ndarray:
    x, y, z = np.moveaxis(directions.astype(np.float64), -1, 0)
    return np.stack(sh_components(x, y, z, bands), axis=-1)


def unshadowed_transfer(n: np.ndarray, bands: int) -> np.ndarray:
    """The closed form A_l Y_k(n) / pi."""
    return (basis(n, bands) * clamped_cosine_coefficients(bands) / np.pi).astype(np.float32)


def delta_light(w: tuple[float, float, float], bands: int) -> np.ndarray:
    return np.repeat(basis(np.array([w]), bands).T, 3, axis=1).astype(np.float32)


def random_light(k: int) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(k, 3)).astype(np.float32)


@pytest.mark.parametrize("bands", [1, 3, 10])
def test_constant_light_shades_an_open_vertex_to_one(bands: int) -> None:
    light = np.zeros((bands * bands, 3), np.float32)
    light[0] = 2 * np.sqrt(np.pi)
    np.testing.assert_allclose(shade(unshadowed_transfer(normals(50), bands), light), 1.0, rtol=3e-7)


def test_the_map_of_a_constant_light_shades_to_one() -> None:
    light = project_map(np.ones((128, 256, 3)), 3)
    np.testing.assert_allclose(shade(unshadowed_transfer(normals(50), 3), light), 1.0, atol=2e-4)


def test_by_hand() -> None:
    transfer = np.array([[1.0, 0, 0, 2], [0, 1, 0, 0]], np.float32)
    light = np.array([[1, 2, 3], [10, 20, 30], [100, 200, 300], [0.5, 0.25, 0]], np.float32)
    np.testing.assert_array_equal(shade(transfer, light), [[2, 2.5, 3], [10, 20, 30]])
    np.testing.assert_array_equal(shade(transfer, light, albedo=np.array([1.0, 0.5, 0])), [[2, 1.25, 0], [10, 10, 0]])
    per_vertex = np.array([[1.0, 1, 1], [0.1, 0.1, 0.1]])
    np.testing.assert_allclose(shade(transfer, light, albedo=per_vertex), [[2, 2.5, 3], [1, 2, 3]], rtol=1e-6)
    window = np.array([1, 0.5, 0.5, 0.5])
    np.testing.assert_array_equal(shade(transfer, light, window=window), [[1.5, 2.25, 3], [5, 10, 15]])


def test_distant_light_gives_the_cosine_in_ten_bands() -> None:
    """A delta light of unit flux: max(n.w, 0) / pi but for the missing bands (A_l decays as l^-5/2)."""
    n, w = normals(400), (0.36, 0.48, 0.8)
    found = np.asarray(shade(unshadowed_transfer(n, 10), delta_light(w, 10)))[:, 0]
    assert np.abs(found - np.maximum(n @ np.array(w), 0) / np.pi).max() < 0.0107  # the bands from 10 on, at the kink


def test_more_light_bands_are_cut_and_fewer_refused() -> None:
    transfer, light = unshadowed_transfer(normals(5), 3), random_light(16)
    np.testing.assert_array_equal(shade(transfer, light), shade(transfer, light[:9]))
    with pytest.raises(ValueError, match="project the light again with 3 bands"):
        shade(transfer, light[:4])


def _transfer_of(coefficients: np.ndarray) -> Transfer:
    n = normals(len(coefficients))
    return Transfer(coefficients, None, n, n, np.zeros((0, 3), np.int32), {})


def test_a_light_object_and_a_transfer_object_are_their_coefficients() -> None:
    transfer, light = unshadowed_transfer(normals(5), 3), random_light(9)
    expected, held = shade(transfer, light), Light(light, light_metadata(3))
    np.testing.assert_array_equal(shade(transfer, held), expected)
    np.testing.assert_array_equal(shade(_transfer_of(transfer), held), expected)
    np.testing.assert_allclose(jax.jit(shade)(_transfer_of(transfer), held), expected, atol=1e-6)
    window = hann_window(3, 3)
    both = shade(_transfer_of(transfer), held, albedo=np.array([1, 0.5, 0], np.float32), window=window)
    plain = shade(transfer, light, albedo=np.array([1, 0.5, 0], np.float32), window=window)
    np.testing.assert_array_equal(both, plain)


def test_a_response_to_each_colour_by_hand() -> None:
    """Red light by the red coefficients, green by the green ones, blue by the blue ones."""
    transfer = np.zeros((1, 4, 3), np.float32)
    transfer[0, :, 0], transfer[0, 0, 1], transfer[0, 3, 2] = 1, 2, 3
    light = np.array([[1, 2, 3], [10, 20, 30], [100, 200, 300], [1000, 2000, 4000]], np.float32)
    np.testing.assert_array_equal(shade(transfer, light), [[1111, 4, 12000]])
    np.testing.assert_array_equal(shade(_transfer_of(transfer), light), [[1111, 4, 12000]])
    albedo, window = np.array([1, 0.5, 0.25], np.float32), np.array([1, 1, 1, 0.5], np.float32)
    np.testing.assert_array_equal(shade(transfer, light, albedo, window), [[611, 2, 1500]])


def test_three_equal_responses_are_one() -> None:
    """And: jit, vmap over transfers, and a gradient with respect to the coloured transfer."""
    transfer, light = unshadowed_transfer(normals(7), 4), random_light(16)
    coloured = np.repeat(transfer[..., None], 3, axis=-1)
    np.testing.assert_allclose(shade(coloured, light), shade(transfer, light), atol=1e-6)
    np.testing.assert_allclose(jax.jit(shade)(coloured, light), shade(transfer, light), atol=1e-6)
    many = jax.vmap(lambda t: shade(t, light))(np.stack([coloured, 2 * coloured]))
    np.testing.assert_allclose(many, [shade(transfer, light), 2 * shade(transfer, light)], atol=2e-6)
    gradient = jax.grad(lambda t: shade(t, light).sum())(jnp.asarray(coloured))
    np.testing.assert_allclose(gradient, np.broadcast_to(light, coloured.shape), atol=1e-6)
    with pytest.raises(ValueError, match="project the light again with 4 bands"):
        shade(coloured, light[:9])


def test_hann_window_softens_a_small_light() -> None:
    light = delta_light((0.0, 0.0, 1.0), 4)
    transfer = unshadowed_transfer(normals(300), 4)
    plain, windowed = shade(transfer, light), shade(transfer, light, window=hann_window(4, 4))
    assert float(plain.min()) < -0.012 and float(windowed.min()) > 0.6 * float(plain.min())
    assert float(windowed.max()) < float(plain.max())


def test_jit_vmap_and_gradients() -> None:
    transfer, light, albedo = (
        unshadowed_transfer(normals(7), 3),
        jnp.asarray(random_light(9)),
        jnp.array([0.5, 0.6, 0.7]),
    )
    np.testing.assert_allclose(jax.jit(shade)(transfer, light, albedo), shade(transfer, light, albedo), rtol=1e-6)
    lights = jnp.stack([light, 2 * light, -light])
    many = jax.vmap(lambda one: shade(transfer, one, albedo))(lights)
    np.testing.assert_allclose(many, [shade(transfer, one, albedo) for one in lights], atol=1e-6)
    gradient = jax.grad(lambda t: shade(t, light, albedo).sum())(transfer)
    np.testing.assert_allclose(gradient, np.broadcast_to(light @ albedo, (7, 9)), rtol=1e-5)


@pytest.mark.parametrize(
    ("transfer", "light", "options", "words"),
    [
        (np.zeros(9), np.zeros((9, 3)), {}, r"transfer has shape \(9,\) float64, not \(vertices, bands"),
        (np.zeros((5, 8)), np.zeros((9, 3)), {}, "8 coefficients are no square"),
        (np.zeros((5, 9, 2)), np.zeros((9, 3)), {}, r"transfer has shape \(5, 9, 2\)"),
        (np.full((5, 9), "a"), np.zeros((9, 3)), {}, "real numbers"),
        (np.zeros((5, 9)), np.zeros(9), {}, r"light has shape \(9,\) float64, not \(bands\^2, 3\)"),
        (np.zeros((5, 9)), np.zeros((3, 9)), {}, "a column for each of red, green and blue"),
        (np.zeros((5, 9)), np.zeros((10, 3)), {}, "10 coefficients are no square"),
        (
            np.zeros((5, 9)),
            np.zeros((9, 3)),
            {"albedo": np.ones(2)},
            r"albedo has shape \(2,\): give \(3,\) or \(5, 3\)",
        ),
        (np.zeros((5, 9)), np.zeros((9, 3)), {"albedo": 0.5}, r"albedo has shape \(\)"),
        (np.zeros((5, 9)), np.zeros((9, 3)), {"window": np.ones(4)}, r"window has shape \(4,\): give \(9,\)"),
    ],
)
def test_wrong_shapes_are_told_what_to_do(transfer: Any, light: Any, options: dict, words: str) -> None:
    with pytest.raises(ValueError, match=words) as caught:
        shade(transfer, light, **options)
    assert "\n" not in str(caught.value)


def test_lists_and_integers_will_do() -> None:
    np.testing.assert_allclose(shade([[1, 0, 0, 0]], [[2, 3, 4]] + [[0, 0, 0]] * 3), [[2, 3, 4]])
