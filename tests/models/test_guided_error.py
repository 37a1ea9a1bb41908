"""The error that a guided bake expects, corrected by the halves of its rays."""

import json
from pathlib import Path

import numpy as np
import pytest

from gash_jax.models.guided import GuidedBake
from gash_jax.models.guided_error import FEWEST, LARGEST_RATIO, LEVELS, corrected, noise_ratio
from gash_jax.models.reconstruction import reconstruct, shipped_network
from gash_jax.nn.reconstruction import rough_variance
from gash_jax.prt.allocation import PILOT
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.few_rays import HALVES, FewRays
from gash_jax.shapes.procedural import make_shape


def _few(ratio: float, count: int = 1000, seed: int = 0) -> FewRays:
    """Rays whose squared error is `ratio` times the law's, seen by halves of which each says little."""
    rng = np.random.default_rng(seed)
    level = rng.integers(0, 4, count)
    rays, share = PILOT << level, rng.uniform(0.1, 0.9, count).astype(np.float32)
    worth = np.array([entry.worth for entry in LEVELS])[level]
    halves = ratio * HALVES * rough_variance(rays.astype(float), share) / worth * rng.chisquare(4, count) / 4
    return FewRays(rays, share, np.zeros((count, 9), np.float32), halves.astype(np.float32))


@pytest.mark.parametrize("ratio", [0.5, 1.0, 3.0])
def test_the_ratio_is_that_of_the_rays(ratio: float) -> None:
    found = [noise_ratio(_few(ratio, seed=seed)) for seed in range(20)]
    assert np.mean([value or 0 for value in found]) == pytest.approx(ratio, rel=0.05)


def test_a_worked_example() -> None:
    """Of 16 rays half of which are free the law says 0.06 (0.25 + 0.05 / 18) / 64; halves of twice that over worth."""
    law = 9 * 0.06 * (0.25 + 0.05 / 18) / 64
    count = FEWEST
    halves = np.full(count, 2 * law / LEVELS[1].worth, np.float32)
    few = FewRays(np.full(count, 16), np.full(count, 0.5, np.float32), np.zeros((count, 9), np.float32), halves)
    assert noise_ratio(few) == pytest.approx(2, rel=1e-5)
    variance = np.ones((count, 9), np.float32)
    variance[: count // 2] = 0.25
    found, factor = corrected(variance, few), np.exp(LEVELS[1].level) * 2 ** LEVELS[1].power
    assert found.sum() == pytest.approx(factor * variance.sum(), rel=1e-4)
    np.testing.assert_allclose(found[0] / found[-1], 0.25 ** (1 + LEVELS[1].slope), rtol=1e-4)


def test_it_is_left_alone_where_little_is_known_and_never_far_off() -> None:
    few = _few(2.0, FEWEST - 1)
    assert noise_ratio(few) is None
    variance = np.random.default_rng(0).random((len(few.rays), 9)).astype(np.float32)
    np.testing.assert_array_equal(corrected(variance, few), variance)
    assert np.isfinite(corrected(np.zeros_like(variance), few._replace(rays=np.full(len(few.rays), 8)))).all()
    assert noise_ratio(_few(100.0)) == LARGEST_RATIO
    assert noise_ratio(_few(1e-4)) == 1 / LARGEST_RATIO


def test_the_constants_are_those_of_the_experiment() -> None:
    path = Path(__file__).parents[2] / "experiments" / "guided" / "calibration.json"
    levels = json.loads(path.read_text(encoding="utf-8"))["levels"]
    assert [level["rays"] for level in levels] == [PILOT << step for step in range(len(LEVELS))]
    for name in LEVELS[0]._fields:
        np.testing.assert_allclose(
            [getattr(level, name) for level in LEVELS], [level[name] for level in levels], atol=0.006
        )
    assert all(level["spread_after"] < level["spread_before"] for level in levels)


def test_error_over_expected_error_is_nearer_to_1_on_shapes_of_another_seed() -> None:
    """Of whole meshes, as logarithms: about 0 in the mean, and less far apart than without the correction."""
    with_it, without = [], []
    for index in range(6):
        mesh = make_shape(71, index, (3000, 4000))[1]
        reference = bake_transfer(mesh, rays=4096, seed=9)
        assert reference.standard_error is not None
        bake = GuidedBake(mesh, 3, 64, 64, 1, "embree", [])
        few, surface = bake.first()
        rebuilt = reconstruct(shipped_network(), surface, few)
        off = np.sum((rebuilt.coefficients - reference.coefficients[bake.active]) ** 2)
        off -= np.sum(reference.standard_error**2)
        for found, variance in ((with_it, corrected(rebuilt.variance, few)), (without, rebuilt.variance)):
            found.append(np.log(off / np.sum(variance)) / 2)
    assert abs(np.mean(with_it)) < 0.15 and np.std(with_it) < 0.9 * np.std(without)
    assert abs(np.mean(with_it) - np.log(1.5)) > 0.15  # what says errors half as large again would be found out


def test_halves_are_of_the_rays_and_not_of_their_order() -> None:
    """A bake that doubles its rays has as far apart halves, on average, as one that has them at once."""
    mesh = make_shape(71, 0, (3000, 4000))[1]
    bake = GuidedBake(mesh, 3, 16, 32, 0, "embree", [])
    doubled = bake.add(bake.first()[0], np.full(len(bake.active), 32))
    at_once = GuidedBake(mesh, 3, 32, 32, 1, "embree", []).first()[0]
    assert np.sum(doubled.halves) == pytest.approx(np.sum(at_once.halves), rel=0.15)
