"""Low-rank kernel regression, against solving for every output and against leaving poses out one by one."""

import numpy as np

from gash_jax.models.kernel_regression import (
    RIDGES,
    LowRank,
    fit_low_rank,
    known_machine,
    leave_one_out,
    products_of,
    ridge_machine,
    spread_poses,
)

RNG = np.random.default_rng(5)
INPUTS, OTHERS = RNG.normal(size=(30, 4)), RNG.normal(size=(7, 4))
OUTPUTS = (np.sin(INPUTS @ RNG.normal(size=(4, 50))) + 2).astype(np.float32)


def kernel(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.exp(-0.2 * ((first[:, None] - second) ** 2).sum(axis=2))


def direct(inputs: np.ndarray, outputs: np.ndarray, others: np.ndarray, ridge: float) -> np.ndarray:
    dual = np.linalg.solve(kernel(inputs, inputs) + ridge * np.eye(len(inputs)), outputs - OUTPUTS.mean(axis=0))
    return kernel(others, inputs) @ dual + OUTPUTS.mean(axis=0)


def low_rank(outputs: np.ndarray, rank: int, ridge: float) -> LowRank:
    gram, square = products_of(outputs), kernel(INPUTS, INPUTS)
    return fit_low_rank(ridge_machine(square, gram, ridge / float(np.mean(np.diag(square)))), outputs, gram, rank)


def test_with_all_directions_it_is_the_regression_of_every_output() -> None:
    found = low_rank(OUTPUTS, 30, 0.01)
    expected = direct(INPUTS, OUTPUTS, OTHERS, 0.01)
    np.testing.assert_allclose(found.mean + kernel(OTHERS, INPUTS) @ found.dual @ found.basis, expected, atol=2e-3)


def test_fewer_directions_are_the_best_fit_of_its_predictions() -> None:
    smooth = direct(INPUTS, OUTPUTS, INPUTS, 0.01) - OUTPUTS.mean(axis=0)
    left, sizes, right = np.linalg.svd(smooth, full_matrices=False)
    found = low_rank(OUTPUTS, 3, 0.01)
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
    square, found = kernel(INPUTS, INPUTS), []
    for outputs in (OUTPUTS, noisy):
        gram = products_of(outputs)
        machine = ridge_machine(square, gram)
        best = RIDGES[int(np.argmin(leave_one_out(square, gram, RIDGES)))]
        np.testing.assert_allclose(machine.inverse, ridge_machine(square, gram, best).inverse)
        found.append(best)
    assert found[0] < found[1]
    assert not low_rank(OUTPUTS, 40, 0.01).basis[30:].any()


def test_a_regression_that_knows_some_poses_is_the_best_of_them_for_all() -> None:
    """Against the normal equations, solved for every output; and it tends to the whole one."""
    ridge, known = 0.02, INPUTS[spread_poses(kernel(INPUTS, INPUTS), 12)]
    columns, own, apart = kernel(INPUTS, known), kernel(known, known), OUTPUTS - OUTPUTS.mean(axis=0)
    machine = known_machine(columns, own, ridge)
    weights = np.linalg.solve(columns.T @ columns + ridge * own, columns.T @ apart)
    np.testing.assert_allclose(machine.inverse @ apart, weights, rtol=1e-4, atol=1e-4)
    found = fit_low_rank(machine, OUTPUTS, products_of(OUTPUTS), 30)
    told = found.mean + kernel(OTHERS, known) @ found.dual @ found.basis
    np.testing.assert_allclose(told, kernel(OTHERS, known) @ weights + OUTPUTS.mean(axis=0), atol=2e-3)

    def loss(weights: np.ndarray) -> float:
        return np.sum((columns @ weights - apart) ** 2) + ridge * np.sum(weights * (own @ weights))

    for _ in range(5):
        assert loss(weights) < loss(weights + 0.01 * RNG.normal(size=weights.shape))
    whole = direct(INPUTS, OUTPUTS, OTHERS, ridge)
    few, all_of_them = (np.abs(predicted(count, ridge) - whole).max() for count in (5, 30))
    assert all_of_them < 1e-5 < 0.1 * few


def predicted(count: int, ridge: float) -> np.ndarray:
    known = INPUTS[spread_poses(kernel(INPUTS, INPUTS), count)]
    machine = known_machine(kernel(INPUTS, known), kernel(known, known), ridge)
    return kernel(OTHERS, known) @ machine.inverse @ (OUTPUTS - OUTPUTS.mean(axis=0)) + OUTPUTS.mean(axis=0)


def test_small_ridges_keep_their_digits() -> None:
    """The smallest singular value that counts is 1e-6 of the largest, whose square a normal equation would lose."""
    wide = np.exp(-0.002 * ((INPUTS[:, None] - INPUTS) ** 2).sum(axis=2))
    found = known_machine(wide, wide, 1e-7).inverse @ OUTPUTS
    values, vectors = np.linalg.eigh(wide)
    exact = vectors @ ((vectors.T @ OUTPUTS) / (np.maximum(values, 0) + 1e-7)[:, None])
    np.testing.assert_allclose(wide @ found, wide @ exact, atol=1e-2 * np.abs(wide @ exact).max())


def test_poses_are_chosen_that_the_others_do_not_tell() -> None:
    """By hand: of two heaps the second pose is from the other heap; and no pose twice where all are the same."""
    heaps = np.concatenate([0.01 * RNG.normal(size=(10, 4)), 5 + 0.01 * RNG.normal(size=(10, 4))])
    first, second = spread_poses(kernel(heaps, heaps), 2)
    assert (first < 10) != (second < 10)
    assert spread_poses(kernel(INPUTS, INPUTS), 30).tolist() == list(range(30))
    for same in (np.ones((6, 6)), np.zeros((6, 6))):
        assert len(set(spread_poses(same, 4))) == 4
        for ridge in (0.0, 1e20):
            assert np.isfinite(known_machine(same[:, :4], same[:4, :4], ridge).inverse).all()
