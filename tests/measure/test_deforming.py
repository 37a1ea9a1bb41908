"""Measures of sequences: by hand, and against those of one mesh."""

import numpy as np
import pytest

from gash_jax.measure import metrics
from gash_jax.measure.deforming import SequenceScores, coefficient_ranges
from gash_jax.shapes.primitives import bumpy_sphere

RNG = np.random.default_rng(0)
MESH = bumpy_sphere(3)
SHAPE = (5, len(MESH.vertices), 4)
TRUTH, NOISE = RNG.normal(size=SHAPE), 0.1 * RNG.normal(size=SHAPE)


def scored(estimates: np.ndarray, references: np.ndarray, ranges: np.ndarray, flicker: bool = False) -> dict:
    scores = SequenceScores(ranges)
    for estimate, reference in zip(estimates, references, strict=True):
        scores.add(estimate, reference, MESH.normals)
    return scores.scores(flicker)


def test_accuracy_and_l1_by_hand() -> None:
    # ranges 1 and 10: an error of 0.1 is right for the second coefficient alone
    scores = SequenceScores(np.array([1.0]))
    scores.add(np.array([[0.51], [0.6]]), np.array([[0.5], [0.5]]), np.array([[0.0, 1, 0], [0, 1, 0]], np.float32))
    found = scores.scores()
    assert found["accuracy"] == 0.5 and found["l1"] == pytest.approx(0.055)
    assert found["relrmse"] == pytest.approx(np.sqrt((0.01**2 + 0.1**2) / 0.5))


def test_radiance_has_no_skill() -> None:
    truth = RNG.normal(size=(2, len(MESH.vertices), 12))
    found = scored(truth + 0.1, truth, coefficient_ranges([truth]), flicker=True)
    assert set(found) == {"accuracy", "l1", "relrmse"} and found["l1"] == pytest.approx(0.1)
    assert "skill" in scored(TRUTH + 0.1, TRUTH, coefficient_ranges([TRUTH]))


def test_the_ranges_count_for_each_coefficient() -> None:
    ranges = coefficient_ranges([TRUTH[:2], TRUTH[2:]])
    np.testing.assert_allclose(ranges, np.ptp(TRUTH, axis=(0, 1)))
    wide = ranges * [1, 1, 1, 100]
    one, other = (scored(TRUTH + NOISE, TRUTH, r)["accuracy"] for r in (ranges, wide))
    errors = np.abs(NOISE)
    assert one == pytest.approx((errors <= 0.02 * ranges).mean()) and other > one


def test_it_is_what_the_measures_of_one_mesh_say() -> None:
    ranges = coefficient_ranges([TRUTH])
    found = scored(TRUTH[:1] + NOISE[:1], TRUTH[:1], ranges)
    assert found["relrmse"] == pytest.approx(metrics.relrmse(TRUTH[0] + NOISE[0], TRUTH[0]))
    assert found["skill"] == pytest.approx(metrics.skill(TRUTH[0] + NOISE[0], TRUTH[0], MESH.normals))
    every = scored(TRUTH + NOISE, TRUTH, ranges, flicker=True)
    assert every["flicker"] == pytest.approx(metrics.flicker((TRUTH + NOISE), TRUTH))


def test_a_perfect_estimate_and_one_that_is_not_of_this_mesh() -> None:
    found = scored(TRUTH, TRUTH, coefficient_ranges([TRUTH]), flicker=True)
    assert found == {"accuracy": 1.0, "l1": 0.0, "relrmse": 0.0, "skill": 1.0, "flicker": 0.0}
    with pytest.raises(ValueError, match="shapes differ"):
        scored(TRUTH[:, 1:], TRUTH, coefficient_ranges([TRUTH]))
