"""The gloss experiment on small meshes: its integrals against closed forms, its gate, what it reports."""

import numpy as np
import pytest

from experiments.gloss.components import pca_errors
from experiments.gloss.dense import Integral, choose_vertices, dense_rays, integrate, only
from experiments.gloss.run import facets, ggx_fit, reflected_share, relative, score, whole_lobe, whole_radiance
from gash_jax.light.brdf import phong
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere, icosphere
from tests.helpers.gloss import cut_lobe, harmonics, map_radiance, mirrored, viewers

BANDS = 3


def test_integrals_of_an_open_hemisphere_are_closed_forms() -> None:
    """Under light 1 a lobe about the normal reflects 1, microfacets of alpha 1 seen from above 1 - ln 2."""
    mesh, chosen = icosphere(1), np.arange(5)
    normals = mesh.normals[chosen].astype(np.float64)
    kernels = {"lobe": whole_lobe(normals, 3.0), "facets": facets(normals, normals, 1.0)}
    found = integrate(dense_rays(mesh, chosen, 4096, 0), np.ones_like, kernels)
    for name, exact in (("lobe", 1.0), ("facets", 1 - np.log(2))):
        assert found[name].value.shape == (5, 3)
        np.testing.assert_allclose(found[name].value, exact, atol=0.01)
        assert 0 < found[name].error.max() < 0.01
    assert reflected_share(0.0, 1.0) == pytest.approx(1 - np.log(2), abs=1e-4)


def test_a_map_is_read_where_its_harmonics_say() -> None:
    """The pixels that dense rays see, projected on two bands, are the light."""
    image = studio_light(64)
    rng = np.random.default_rng(0)
    w = rng.normal(size=(200_000, 3))
    w /= np.linalg.norm(w, axis=1, keepdims=True)
    found = harmonics(w, 2).T @ map_radiance(image, w) * 4 * np.pi / len(w)
    np.testing.assert_allclose(found, project_map(image, 2), atol=0.05)


def test_shading_is_the_band_limited_integral_within_its_error() -> None:
    """rms z-score of 20 vertices near 1; known bad: the same without shadows."""
    mesh, light = bumpy_sphere(8), project_map(studio_light(32), BANDS)
    chosen = choose_vertices(mesh, 20, 1)
    sparse, normals = only(mesh, chosen), mesh.normals[chosen].astype(np.float64)
    toward = viewers(normals, 45.0)
    view = np.zeros_like(mesh.normals)
    view[chosen] = toward
    factors = np.asarray(phong(30).factors)[:BANDS]
    kernel = {"": lambda index, w: cut_lobe(np.sum(mirrored(normals, toward)[index] * w, axis=-1), factors)}
    radiance = lambda w: harmonics(w, BANDS) @ light  # noqa: E731
    exact = integrate(dense_rays(mesh, chosen, 8192, 1), radiance, kernel)[""]
    seeds = [bake_transfer(sparse, BANDS, 256, glossy=True, seed=seed) for seed in range(6)]
    bakes = np.array([np.asarray(shade(one, light, view=view, lobe=phong(30)))[chosen] for one in seeds])
    assert 0.6 < score(bakes, exact) < 1.6
    every = (rays._replace(free=np.ones_like(rays.free)) for rays in dense_rays(mesh, chosen, 8192, 1))
    unshadowed = integrate(every, radiance, kernel)
    assert score(bakes, unshadowed[""]) > 5


def test_brute_force_gives_the_rays_and_the_radiance_of_embree() -> None:
    """All but rays that graze an edge, and the whole lobe's radiance with them; known bad: no shadows."""
    mesh, image = bumpy_sphere(8), studio_light(32)
    chosen = choose_vertices(mesh, 8, 2)
    normals = mesh.normals[chosen].astype(np.float64)
    embree, brute = (list(dense_rays(mesh, chosen, 1024, 1, backend)) for backend in ("embree", "jax"))
    free = [np.concatenate([rays.free for rays in blocks]) for blocks in (embree, brute)]
    assert np.mean(free[0] != free[1]) < 1e-3 < 0.05 < np.mean(~free[1])
    found = [whole_radiance(iter(blocks), image, normals, 45) for blocks in (embree, brute)]
    for name, integral in found[0].items():
        assert relative(integral.value, found[1][name].value) < 2e-3
    every = (rays._replace(free=np.ones_like(rays.free)) for rays in brute)
    assert relative(whole_radiance(every, image, normals, 45)["Phong 10"].value, found[1]["Phong 10"].value) > 0.02


def test_scores_by_hand() -> None:
    """Two bakes at 1 and 3, mean 2 with variance 1; the integral 0 with error 0: z = 2."""
    bakes = np.array([[[1.0]], [[3.0]]])
    assert score(bakes, Integral(np.zeros((1, 1)), np.zeros((1, 1)))) == pytest.approx(2.0)


def test_the_fit_of_ggx_is_exact_at_normal_view_alone() -> None:
    row = ggx_fit(0.7, nodes=80)
    assert row["0"] < 1e-9 and 0.2 < row["45"] < row["75"]


def test_components_by_hand() -> None:
    """Points on a line about their mean need one component; of two equal axes each holds half."""
    line = np.outer(np.arange(4.0), [3.0, 4.0])
    assert pca_errors(line, (1, 2)) == pytest.approx([0, 0], abs=1e-12)
    cross = np.array([[1.0, 0], [-1, 0], [0, 1], [0, -1]])
    assert pca_errors(cross, (1, 2)) == pytest.approx([np.sqrt(0.5), 0], abs=1e-12)
