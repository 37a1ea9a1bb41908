"""The fewest rays that reach an error, and what a bake to an error takes beside them."""

from typing import Any

import numpy as np
import pytest

from gash_jax.measure import metrics
from gash_jax.measure.best_count import COUNTS, compare_targets, fewest_rays, plain_error, pooled_targets
from gash_jax.measure.reference import make_reference
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere

TARGETS = (0.1, 0.05, 0.02, 0.01)


@pytest.mark.parametrize("power", [0.5, 0.75, 1.0])
def test_the_fewest_rays_of_a_falling_curve_are_the_formulas(power: float) -> None:
    found = fewest_rays(lambda rays: rays**-power, TARGETS)
    for target, count in found.items():
        exact = target ** (-1 / power)
        assert count == next((n for n in COUNTS if n >= exact * (1 - 1e-12)), None)


def test_a_curve_that_rises_again_gives_the_first_count_that_is_good_enough() -> None:
    curve = {8: 0.2, 12: 0.04, 16: 0.08, 24: 0.03, 32: 0.001}
    assert fewest_rays(curve.__getitem__, TARGETS, tuple(curve)) == {0.1: 12, 0.05: 12, 0.02: 32, 0.01: 32}


def test_no_count_is_tried_twice_nor_beyond_the_last_target() -> None:
    tried: list[int] = []
    told: list[tuple[int, int]] = []

    def error(rays: int) -> float:
        tried.append(rays)
        return 1 / rays

    assert fewest_rays(error, (0.1, 0.05), progress=lambda *at: told.append(at)) == {0.1: 12, 0.05: 24}
    assert tried == [8, 12, 16, 24] and told[-1] == (60, sum(COUNTS))
    assert fewest_rays(error, (1e-9,), (4, 8)) == {1e-9: None}


def test_the_error_of_the_plain_bake_is_that_of_its_bakes() -> None:
    mesh = bumpy_sphere(4)
    reference = make_reference(mesh, 2, 256)
    bakes = [bake_transfer(mesh, 2, 8, replicates=1, seed=seed).coefficients for seed in range(3)]
    errors = [metrics.relrmse(found, reference.coefficients) for found in bakes]
    squares = [error**2 for error in errors if error is not None]
    assert len(squares) == 3 and plain_error(mesh, reference, 8, 3) == pytest.approx(np.sqrt(np.mean(squares)))
    assert plain_error(mesh, reference._replace(coefficients=0 * reference.coefficients), 8, 1) == float("inf")


def _row(method: str, setting: str, seconds: float, error: float) -> dict[str, Any]:
    times = {"seconds": seconds, "seconds_without_set_up": seconds - 1, "cpu_seconds": 2 * seconds}
    held = {name: {"median": value} for name, value in times.items()}
    return {"method": method, "setting": setting, "relrmse": error, "rays": 10.0, **held}


def test_a_comparison_by_hand() -> None:
    rows = [
        *(_row("error", "0.05", 3.0, 0.04), _row("error", "0.01", 9.0, 0.009)),
        *(_row("plain", "24", 5.0, 0.045), _row("plain", "16", 4.0, 0.06)),
    ]
    near, far = compare_targets(rows, {0.05: 24, 0.01: None})
    assert near["ratio_of_seconds"] == 0.6 and near["ratio_of_seconds_without_set_up"] == 0.5
    assert near["best_relrmse"] == 0.045 and near["relrmse"] == 0.04
    assert far == {"target": 0.01, "relrmse": 0.009, "rays": 10.0, "best_count": None}
    (pool, other) = pooled_targets([[near, far], [{**near, "ratio_of_seconds": 1.0, "relrmse": 0.06}]])
    assert pool["ratio_of_seconds"] == {"median": 0.8, "largest": 1.0} and pool["meshes"] == pool["compared"] == 2
    assert pool["error_over_target"]["largest"] == pytest.approx(1.2)
    assert other["compared"] == 0 and other["ratio_of_seconds"] is None and other["meshes"] == 1
