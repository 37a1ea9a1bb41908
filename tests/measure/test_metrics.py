"""The measures on numbers worked by hand."""

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.measure import metrics
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere, icosphere

REFERENCE = np.array([[3.0, 0.0], [0.0, 4.0]], np.float32)
ESTIMATE = np.array([[3.0, 1.0], [0.0, 2.0]], np.float32)


def test_mse_and_relrmse_by_hand() -> None:
    assert metrics.mse(ESTIMATE, REFERENCE) == pytest.approx((1 + 4) / 4)
    assert metrics.relrmse(ESTIMATE, REFERENCE) == pytest.approx(np.sqrt(5 / 25))
    assert metrics.relrmse(ESTIMATE, REFERENCE * 0) is None


def test_per_coefficient_errors_by_hand() -> None:
    error, deviation = metrics.coefficient_errors(ESTIMATE, REFERENCE)
    np.testing.assert_allclose(error, [0.0, 2.5])
    np.testing.assert_allclose(deviation, [0.0, 1.5])


def test_shapes_never_broadcast() -> None:
    with pytest.raises(ValueError, match="shapes differ"):
        metrics.mse(ESTIMATE, REFERENCE[:1])


def test_skill_is_zero_for_the_formula_one_for_the_truth_and_named_where_undefined() -> None:
    mesh = bumpy_sphere(12)
    truth = bake_transfer(mesh, rays=1024).coefficients
    formula = np.asarray(unshadowed_transfer(mesh.normals, 3))
    assert metrics.skill(truth, truth, mesh.normals) == 1.0
    assert metrics.skill(formula, truth, mesh.normals) == pytest.approx(0.0, abs=1e-6)
    worse = metrics.skill(formula - (truth - formula), truth, mesh.normals)
    assert worse == pytest.approx(-3.0, abs=1e-4)  # twice the error, four times the square
    ball = icosphere(1)
    exact = np.asarray(unshadowed_transfer(ball.normals, 3))
    assert metrics.skill(exact, exact, ball.normals) == "no occlusion"
    assert metrics.skill(exact, exact * 0, ball.normals) == "no transfer"


def test_shadow_mse_looks_at_the_darkest_quartile() -> None:
    reference = np.array([[0.0], [1], [2], [3]], np.float32)
    assert metrics.shadow_mse(reference + np.array([[2.0], [0], [0], [9]], np.float32), reference) == 4.0


def test_flicker_by_hand() -> None:
    truth = np.zeros((4, 1, 1), np.float32)
    steady = truth + np.arange(4, dtype=np.float32)[:, None, None]  # an error that grows evenly does not flicker
    assert metrics.flicker(steady, truth) == 0.0
    alternating = truth + np.array([0, 1, 0, 1], np.float32)[:, None, None]
    assert metrics.flicker(alternating, truth) == pytest.approx(2.0)
    with pytest.raises(ValueError, match="3 frames"):
        metrics.flicker(truth[:2], truth[:2])


def test_equivalent_rays_interpolates_in_log_log() -> None:
    curve = {4: 1e-2, 16: 1e-3, 64: 1e-4}
    assert metrics.equivalent_rays(1e-3, curve) == pytest.approx(16.0)
    assert metrics.equivalent_rays(10**-2.5, curve) == pytest.approx(8.0)
    assert metrics.equivalent_rays(2e-2, curve) == "< 4"
    assert metrics.equivalent_rays(1e-5, curve) == ">= 64"
    assert metrics.equivalent_rays(1e-4, curve) == pytest.approx(64.0)
    assert metrics.equivalent_rays(1e-2, curve) == pytest.approx(4.0)


def test_equivalent_rays_where_more_rays_do_not_help() -> None:
    """Ties, and points that are worse than the one before: the fewest rays with that MSE."""
    curve = {4: 1e-2, 8: 1e-3, 16: 1e-3, 32: 2e-3, 64: 1e-5}
    assert metrics.equivalent_rays(1e-3, curve) == 8.0
    assert metrics.equivalent_rays(0.9e-3, curve) == pytest.approx(32.0, rel=0.03)  # just below the plateau
    assert metrics.equivalent_rays(1e-4, curve) == pytest.approx(32 * 2**0.5)
    flat = {4: 1e-3, 8: 1e-3, 16: 1e-3}
    assert metrics.equivalent_rays(1e-3, flat) == 4.0
    assert metrics.equivalent_rays(1e-4, flat) == ">= 16"


def test_equivalent_rays_where_the_bake_is_exact() -> None:
    """A convex body in one band: every ray is free."""
    exact = {4: 0.0, 8: 0.0, 16: 0.0}
    assert metrics.equivalent_rays(0.0, exact) == 4.0
    assert metrics.equivalent_rays(1e-9, exact) == "< 4"
    late = {4: 1e-2, 8: 1e-3, 16: 0.0, 32: 0.0}
    assert metrics.equivalent_rays(0.0, late) == 16.0
    assert metrics.equivalent_rays(1e-6, late) == 8.0
    assert metrics.equivalent_rays(0.0, {4: 1e-2, 8: 1e-3}) == ">= 8"


def test_plain_bake_is_worth_its_own_rays() -> None:
    mesh = bumpy_sphere(16)
    reference = bake_transfer(mesh, rays=4096, seed=7).coefficients
    curve = metrics.plain_bake_curve(mesh, reference, 4096)
    assert list(curve) == [4, 8, 16, 32, 64, 128, 256, 512]
    other = bake_transfer(mesh, rays=64, replicates=1, seed=3).coefficients
    assert metrics.equivalent_rays(metrics.mse(other, reference), curve) == pytest.approx(64, rel=0.2)


def test_visibility_scores_by_hand() -> None:
    truth = np.array([[True, True, True, False]])
    called = np.array([[True, False, True, True]])
    scores = metrics.visibility_scores(called, truth)
    assert scores["accuracy"] == 0.5 and scores["majority_accuracy"] == 0.75
    assert scores["balanced_accuracy"] == pytest.approx((2 / 3 + 0) / 2)
    one_class = metrics.visibility_scores(np.array([[True, False]]), np.array([[True, True]]))
    assert one_class["balanced_accuracy"] == 0.5 and one_class["majority_accuracy"] == 1.0


def test_image_scores_by_hand() -> None:
    rng = np.random.default_rng(0)
    reference = rng.random((32, 32, 3))
    reference[0, 0] = 1.0
    same = metrics.image_scores(reference, reference)
    assert same["ssim"] == pytest.approx(1.0) and same["psnr"] > 300
    lifted = metrics.image_scores(reference + 0.1, reference)
    assert lifted["psnr"] == pytest.approx(20.0, abs=1e-6) and lifted["ssim"] < 1
    noisy = metrics.image_scores(rng.random((32, 32, 3)), reference)
    assert noisy["ssim"] < 0.2
    scaled = metrics.image_scores(5 * (reference + 0.1), 5 * reference)
    assert scaled["psnr"] == pytest.approx(lifted["psnr"]) and scaled["ssim"] == pytest.approx(lifted["ssim"])
    with pytest.raises(ValueError, match="black"):
        metrics.image_scores(reference, 0 * reference)


def test_colours_are_three_estimates() -> None:
    """Measures of (v, k, 3) are those of its colours side by side; of three equal colours, those of one."""
    mesh, rng = icosphere(1), np.random.default_rng(0)
    truth = rng.random((42, 9, 3)).astype(np.float32)
    estimate = truth + rng.normal(0, 0.1, truth.shape).astype(np.float32)
    side_by_side = [array.transpose(0, 2, 1).reshape(-1, 9) for array in (estimate, truth)]
    assert metrics.relrmse(estimate, truth) == pytest.approx(metrics.relrmse(*side_by_side))
    each = metrics.skill(side_by_side[0], side_by_side[1], np.repeat(mesh.normals, 3, axis=0))
    assert metrics.skill(estimate, truth, mesh.normals) == pytest.approx(each)
    for ours, theirs in zip(
        metrics.coefficient_errors(estimate, truth), metrics.coefficient_errors(*side_by_side), strict=True
    ):
        np.testing.assert_allclose(ours, theirs)
    grey = [np.repeat(array[..., :1], 3, axis=2) for array in (estimate, truth)]
    assert metrics.shadow_mse(*grey) == pytest.approx(metrics.shadow_mse(estimate[..., 0], truth[..., 0]))
