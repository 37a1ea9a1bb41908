"""Bands by the radiance that shadowed transfer makes of a light, against bakes of all bands."""

import numpy as np
import pytest

from gash_jax.algebra.sh import band_index
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.environment import project_map
from gash_jax.light.layouts import pixel_directions
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.light_bands import LEFT_OUT, bands_for, radiance_left_out
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.tracing import active_rows
from gash_jax.prt.visibility import visibility
from gash_jax.shapes.primitives import bumpy_sphere, icosphere
from gash_jax.shapes.procedural import make_shape

BAND = band_index(10)
SHADOWED = {"bumps": bumpy_sphere(12), **{f"shape {i}": make_shape(11, i, (700, 900))[1] for i in (0, 4)}}


def sun_and_sky() -> np.ndarray:
    """Coefficients of a blue sky over a dark ground with a sun of 4 degrees."""
    directions = pixel_directions(64, 128)
    sun = np.array([0.5, 0.6, 0.62]) / np.linalg.norm([0.5, 0.6, 0.62])
    sky = np.where(directions[..., 1:2] > 0, [0.3, 0.4, 0.6], [0.1, 0.1, 0.08])
    disc = (directions @ sun > np.cos(np.radians(4)))[..., None] * np.array([200.0, 180.0, 150.0])
    return np.asarray(project_map((sky + disc).astype(np.float32), 10))


def in_band(band: int) -> np.ndarray:
    light = np.zeros((100, 3), np.float32)
    light[BAND == band] = np.random.default_rng(band).normal(size=(2 * band + 1, 3))
    return light


LIGHTS = {"sun and sky": sun_and_sky(), "l = 3": in_band(3), "l = 0 and 3": in_band(3) + 2 * in_band(0)}


def sampled(mesh: Mesh, light: np.ndarray, seed: int = 0, find=bands_for):
    geometry = trace_geometry(mesh)
    rng = np.random.default_rng(seed)
    _, rows = active_rows(mesh, geometry, None, rng.random((len(mesh.vertices), 1, 2), np.float32))
    return find(light, rows, visibility(geometry.vertices, geometry.faces), rng)


def measured(mesh: Mesh, lights: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """What 0, 1, ... 10 bands leave out by a bake of 10 bands; two replicates, so that its noise does not count."""
    pair = [bake_transfer(mesh, 10, 512, replicates=1, seed=seed).coefficients.astype(np.float64) for seed in (1, 2)]
    found = {}
    for name, light in lights.items():
        bands = [np.stack([t[:, BAND == band] @ light[BAND == band] for band in range(10)], 1) for t in pair]
        first, second = (np.cumsum(radiance[:, ::-1], axis=1)[:, ::-1] for radiance in bands)
        energy = np.sum(first * second, axis=(0, 2))
        found[name] = np.append(np.sqrt(np.maximum(energy / energy[0], 0)), 0)
    return found


@pytest.mark.parametrize("name", SHADOWED)
def test_what_is_left_out_is_at_most_what_is_stated(name: str) -> None:
    truth = measured(SHADOWED[name], LIGHTS)
    for kind, light in LIGHTS.items():
        for seed in range(2):
            bands, stated = sampled(SHADOWED[name], light, seed)
            assert truth[kind][bands] <= stated <= LEFT_OUT, (kind, seed)
        estimates = sampled(SHADOWED[name], light, 2, radiance_left_out)
        np.testing.assert_allclose(estimates, truth[kind], atol=0.01, rtol=0.15)


def test_odd_bands_count_where_there_are_shadows() -> None:
    """Irradiance without shadows holds nothing of l = 3: one band would then do."""
    mesh = SHADOWED["bumps"]
    assert sampled(mesh, in_band(3)) == (4, 0.0)
    assert sampled(mesh, in_band(0)) == (1, 0.0)
    assert sampled(mesh, LIGHTS["l = 0 and 3"])[0] == 4


def test_convex_bodies_need_what_irradiance_needs() -> None:
    """No ray is blocked, so every vertex is its closed form: odd bands from 3 on are left out, and cost nothing."""
    mesh = icosphere(2)
    assert sampled(mesh, in_band(3)) == (1, 0.0)
    assert sampled(mesh, np.zeros((9, 3), np.float32)) == (1, 0.0)
    bands, stated = sampled(mesh, sun_and_sky())
    assert bands in (3, 5) and stated <= LEFT_OUT


def test_noise_is_not_counted_as_radiance() -> None:
    """Squares of one estimate with few rays would find a multiple of what the high bands hold."""
    mesh, light = SHADOWED["bumps"], sun_and_sky()
    truth = measured(mesh, {"sun": light})["sun"]
    assert truth[3] > 0.06  # what the three bands of unshadowed irradiance leave out
    one = bake_transfer(mesh, 10, 64, replicates=1).coefficients
    left = [one[:, chosen] @ light[chosen] for chosen in (BAND >= 7, BAND >= 0)]
    assert np.linalg.norm(left[0]) / np.linalg.norm(left[1]) > 1.5 * truth[7]
    assert sampled(mesh, light, 0, radiance_left_out)[7] < 1.2 * truth[7]
