"""Transfer bounce by bounce: the polynomial in the albedo, laws, a cavity by hand, and the spread against the truth."""

from typing import Any

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bake_job import make_job
from gash_jax.prt.bounce_series import bake_series, summed
from gash_jax.prt.bounces import Exchange
from gash_jax.prt.integrands import direct
from gash_jax.prt.scene import make_scene
from gash_jax.prt.visibility import ray_query
from gash_jax.shapes.primitives import icosphere, spherical_bowl
from tests.helpers.radiosity import cavity_gain, slanted_cavity
from tests.helpers.transfer_formulas import Y00

BOWL = spherical_bowl(np.radians(60), 8)


@pytest.mark.parametrize(("bounces", "albedo"), [(0, 0.5), (1, 1.0), (2, 0.3), (3, 0.8)])
def test_the_sum_is_the_bake_with_bounces(bounces: int, albedo: float) -> None:
    """Of one replicate, which a bake does not blend with the closed form either."""
    series = bake_series(BOWL, 4, 64, bounces, seed=3, replicates=1)
    baked = bake_transfer(BOWL, 4, 64, bounces=bounces, albedo=albedo, replicates=1, seed=3).coefficients
    assert series.terms.shape == (bounces + 1, *baked.shape) and series.spread is None
    np.testing.assert_allclose(summed(series.terms, albedo), baked, atol=1e-6)


def test_the_sum_of_several_replicates_is_the_mean_of_their_chains() -> None:
    """A bake of several blends the direct part; here are the same chains as plain means."""
    scene, vertices = make_scene(BOWL), len(BOWL.vertices)
    job = make_job(scene, ray_query(*scene.geometry[:2], "closest"), 32, 4, 5, part=(0, vertices), everywhere=True)
    plain = np.zeros(len(job.active), np.float32)
    exchange = Exchange(job.rows, direct(3), 8, job.query, active=job.active, surface=scene.surface, share=plain)
    expected = exchange.bounced(np.full((vertices, 1), 0.7, np.float32), 2).replicas.mean(1)
    series = bake_series(BOWL, 3, 32, 2, seed=5, replicates=4)
    np.testing.assert_allclose(summed(series.terms, 0.7)[job.active], expected, atol=1e-6)


def test_direct_terms_are_those_of_the_bake_without_bounces() -> None:
    """Whether rays ask for the nearest hit or for any; a few graze an edge."""
    alone, first = (bake_series(BOWL, 3, 64, bounces, seed=1).terms[0] for bounces in (0, 2))
    np.testing.assert_allclose(alone, first, atol=1e-6)


def test_nothing_bounces_off_a_convex_body_and_nothing_reaches_a_vertex_without_normal() -> None:
    terms = bake_series(icosphere(2), 3, 32, 2).terms
    assert terms[0].any() and not terms[1:].any()
    normals = BOWL.normals.copy()
    normals[5:9] = 0
    found = bake_series(BOWL._replace(normals=normals), 3, 16, 1)
    assert found.spread is not None and not found.terms[:, 5:9].any() and not found.spread[5:9].any()
    blind: Mesh = BOWL._replace(normals=0 * BOWL.normals)
    assert not bake_series(blind, 3, 16, 1).terms.any()


def test_a_cavity_by_hand() -> None:
    """Of a half ball half of the rays leave: direct .5, then .25 and .125 in the mean, as every bounce loses half."""
    means = bake_series(slanted_cavity(np.pi / 2), 1, 256, 2).terms[..., 0].mean(1) / Y00
    np.testing.assert_allclose(means, [0.5, 0.25, 0.125], atol=0.004)
    np.testing.assert_allclose(means[1], cavity_gain(np.pi / 2, 1.0, 1, 1)[0] / Y00, atol=0.004)


def test_the_spread_is_the_squared_error_on_the_average() -> None:
    """Over vertices and seeds, band by band; a bowl whose rays are neither all free nor all blocked."""
    truth = bake_series(BOWL, 3, 8192, 0, seed=99).terms[0]
    claimed, errors = np.zeros(3), np.zeros(3)
    for seed in range(6):
        series = bake_series(BOWL, 3, 64, 0, seed=seed)
        assert series.spread is not None and series.spread.shape == (len(BOWL.vertices), 3)
        claimed += series.spread.mean(0)
        squared = np.square(series.terms[0] - truth).mean(0)
        errors += [squared[0], squared[1:4].mean(), squared[4:].mean()]
    assert np.all(np.abs(np.log(claimed / errors)) < np.log(1.3))


def test_the_spread_by_hand() -> None:
    """Of two replicates the squared standard error is a quarter of their squared difference."""
    two = bake_series(BOWL, 2, 8, 0, seed=4)
    scene = make_scene(BOWL)
    job = make_job(scene, ray_query(*scene.geometry[:2], "closest"), 8, 2, 4, part=(0, 257), everywhere=True)
    plain = np.zeros(len(job.active), np.float32)
    first = Exchange(job.rows, direct(2), 4, job.query, active=job.active, surface=BOWL, share=plain).first[..., 0]
    squared = np.square(first[:, 0] - first[:, 1]) / 4
    expected = np.stack([squared[:, 0], squared[:, 1:].mean(1)], 1)
    assert two.spread is not None
    np.testing.assert_allclose(two.spread, expected, atol=1e-7)


def test_summed_by_hand() -> None:
    terms = np.array([[[1.0, 2.0]], [[0.5, 0.0]], [[0.25, 4.0]]], np.float32)
    np.testing.assert_allclose(summed(terms, 0.5), [[1.3125, 3.0]])
    np.testing.assert_allclose(summed(terms, 0.0), terms[0])


@pytest.mark.parametrize(
    ("options", "reason"),
    [({"bounces": -1}, "bounces is -1"), ({"rays": 9}, "multiple of replicates"), ({"bands": 0}, "bands")],
)
def test_options_out_of_range_are_refused(options: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        bake_series(BOWL, **{"bands": 3, "rays": 8, "bounces": 1, **options})
