"""Low-rank kernel regression, against solving for every output and against leaving poses out one by one."""

import numpy as np

from gash_jax.models.kernel_regression import RIDGES, fit_low_rank, leave_one_out

RNG = np.random.default_rng(5)
INPUTS, OTHERS = RNG.normal(size=(30, 4)), RNG.normal(size=(7, 4))
OUTPUTS = (np.sin(INPUTS @ RNG.normal(size=(4, 50))) + 2).astype(np.float32)


def kernel(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.exp(-0.2 * ((first[:, None] - second) ** 2).sum(axis=2))


def direct(inputs: np.ndarray, outputs: np.ndarray, others: np.ndarray, ridge: float) -> np.ndarray:
    dual = np.linalg.solve(kernel(inputs, inputs) + ridge * np.eye(len(inputs)), outputs - OUTPUTS.mean(axis=0))
    return kernel(others, inputs) @ dual + OUTPUTS.mean(axis=0)


def test_with_all_directions_it_is_the_regression_of_every_output() -> None:
    found = fit_low_rank(kernel(INPUTS, INPUTS), OUTPUTS, 30, 0.01)
    expected = direct(INPUTS, OUTPUTS, OTHERS, 0.01)
    np.testing.assert_allclose(found.mean + kernel(OTHERS, INPUTS) @ found.dual @ found.basis, expected, atol=2e-3)


def test_fewer_directions_are_the_best_fit_of_its_predictions() -> None:
    smooth = direct(INPUTS, OUTPUTS, INPUTS, 0.01) - OUTPUTS.mean(axis=0)
    left, sizes, right = np.linalg.svd(smooth, full_matrices=False)
    found = fit_low_rank(kernel(INPUTS, INPUTS), OUTPUTS, 3, 0.01)
    kept = kernel(INPUTS, INPUTS) @ found.dual @ found.basis
    np.testing.assert_allclose(kept, (left[:, :3] * sizes[:3]) @ right[:3], atol=1e-3)


def test_the_error_of_leaving_one_out_is_that_of_doing_so() -> None:
    apart = OUTPUTS - OUTPUTS.mean(axis=0)
    gram, ridge = (apart @ apart.T).astype(float), 0.03
    errors = []
    for number in range(len(INPUTS)):
        kept = np.delete(np.arange(len(INPUTS)), number)
        told = direct(INPUTS[kept], OUTPUTS[kept], INPUTS[[number]], ridge)
        errors.append(np.sum((told[0] - OUTPUTS[number]) ** 2))
    found = leave_one_out(kernel(INPUTS, INPUTS), gram, [ridge])
    np.testing.assert_allclose(found, [np.mean(errors)], rtol=1e-4)


def test_the_ridge_follows_the_noise_and_more_directions_than_poses_are_zeros() -> None:
    noisy = OUTPUTS + RNG.normal(size=OUTPUTS.shape).astype(np.float32)
    clean, rough = (fit_low_rank(kernel(INPUTS, INPUTS), outputs, 40).ridge for outputs in (OUTPUTS, noisy))
    assert clean in RIDGES and rough > clean
    found = fit_low_rank(kernel(INPUTS, INPUTS), OUTPUTS, 40)
    assert found.basis.shape == (40, 50) and not found.basis[30:].any()
