"""Many settings timed in turn: order, errors, set-up, repeated calls, fronts, medians over meshes."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.measure import frontier
from gash_jax.measure.frontier import Outcome, Setting, first_calls, measure_in_turn, median_rays, pareto_front, pooled
from gash_jax.measure.reference import Reference

TRUTH = np.array([[3.0, 0.0], [0.0, 4.0]], np.float32)
REFERENCE = Reference(TRUTH, np.full((2, 2), 0.5, np.float32), {4: 1.0, 8: 0.25}, 64)


@pytest.mark.parametrize("seed", range(5))
def test_the_front_is_what_no_other_point_beats(seed: int) -> None:
    costs = np.random.default_rng(seed).integers(0, 5, (12, 2)).astype(float)  # ties and doubles
    front = pareto_front(costs)
    beaten = [any(np.all(b <= a) and np.any(b < a) for b in costs) for a in costs]
    assert {tuple(costs[i]) for i in front} == {tuple(c) for c, b in zip(costs, beaten, strict=True) if not b}
    assert np.all(np.diff(costs[front, 0]) > 0) and np.all(np.diff(costs[front, 1]) < 0)


def test_a_front_of_nothing_is_empty_and_ties_go_to_the_first() -> None:
    assert len(pareto_front(np.zeros((0, 2)))) == 0
    assert pareto_front(np.array([[1.0, 1.0], [1.0, 1.0], [1.0, 2.0]])).tolist() == [0]


def recorded(name: str, log: list[tuple[str, int]], off: float = 0.0) -> Setting:
    """A setting whose error is `off` plus the seed, at one of four coefficients."""

    def run(seed: int) -> Outcome:
        log.append((name, seed))
        found = TRUTH.copy()
        found[0, 1] = off + seed
        return Outcome(found, 0.25, 10.0 + seed)

    return Setting("method", name, run)


def test_every_round_calls_every_setting_once_with_its_own_seed() -> None:
    log: list[tuple[str, int]] = []
    told: list[tuple[int, int]] = []
    settings = [recorded("a", log), recorded("b", log)]
    first = first_calls(settings, lambda *at: told.append(at))
    assert set(first) == {("method", "a"), ("method", "b")} and told == [(1, 2), (2, 2)]
    measure_in_turn(settings, REFERENCE, first, 3, progress=lambda *at: told.append(at))
    assert log == [("a", 0), ("b", 0), *[(name, seed) for seed in range(3) for name in "ab"]]
    assert told[2:] == [(count, 6) for count in range(1, 7)]


def test_errors_are_root_means_of_squares_over_the_seeds() -> None:
    (row,) = measure_in_turn([recorded("a", [])], REFERENCE, {}, 3)
    # squared errors 0, 1, 4 over four coefficients; energy 9 + 16
    assert row["mse"] == pytest.approx(5 / 3 / 4) and row["relrmse"] == pytest.approx((5 / 3 / 25) ** 0.5)
    assert row["rays"] == 11 and row["equivalent_rays"] == pytest.approx(4 * 2 ** (np.log(12 / 5) / np.log(4)))
    assert row["compile_seconds"] is None
    dark = REFERENCE._replace(coefficients=0 * TRUTH)
    (row,) = measure_in_turn([recorded("a", [])], dark, {}, 1)
    assert row["relrmse"] is None and row["equivalent_rays"] == "no transfer"


def test_set_up_is_taken_out_and_first_calls_are_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(np.cumsum([0.0, 1.0, 0.0, 3.0, 0.0, 2.0]).tolist())  # calls of 1, 3 and 2 seconds
    monkeypatch.setattr(frontier.time, "perf_counter", lambda: next(clock))
    monkeypatch.setattr(frontier.time, "process_time", lambda: 0.0)
    (row,) = measure_in_turn([recorded("a", [])], REFERENCE, {("method", "a"): 7.0}, 3)
    assert row["seconds"] == {"lower_quartile": 1.5, "median": 2.0, "upper_quartile": 2.5}
    assert row["seconds_without_set_up"]["median"] == 1.75 and row["compile_seconds"] == 5.0


def test_a_call_that_compiled_is_made_again_but_not_for_ever() -> None:
    sizes = {0: 3, 1: 3, 2: 5}
    log: list[tuple[str, int]] = []

    def compiling(seed: int) -> Outcome:
        log.append(("once", seed))
        compiled(jnp.zeros(sizes[seed])).block_until_ready()
        return Outcome(TRUTH, 0.0)

    def always(seed: int) -> Outcome:
        log.append(("always", seed))
        jax.jit(lambda x: x * len(log))(jnp.zeros(2)).block_until_ready()
        return Outcome(TRUTH, 0.0)

    compiled: Any = jax.jit(lambda x: jnp.sin(x) + 11.5)
    settings = [Setting("m", "once", compiling), Setting("m", "always", always)]
    first_calls(settings)
    log.clear()
    measure_in_turn(settings, REFERENCE, {}, 3)
    assert [seed for name, seed in log if name == "once"] == [0, 1, 2, 2]
    assert [seed for name, seed in log if name == "always"] == [0, 0, 0, 1, 1, 1, 2, 2, 2]


def test_the_picture_score_is_that_of_the_last_round() -> None:
    settings = [recorded("a", []), recorded("b", [], 10.0)]
    rows = measure_in_turn(settings, REFERENCE, {}, 2, lambda found: float(found[0, 1]))
    assert [row["psnr"] for row in rows] == [1.0, 11.0]


def test_errors_that_differ_by_rounding_share_no_front(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter(np.cumsum([0.0, 1.0, 0.0, 2.0, 0.0, 3.0]).tolist())
    monkeypatch.setattr(frontier.time, "perf_counter", lambda: next(clock))
    offs = (1.0, 1.0 - 1e-5, 0.5)
    rows = measure_in_turn([recorded(str(off), [], off) for off in offs], REFERENCE, {}, 1)
    assert [row["on_front"] for row in rows] == [True, False, True]


@pytest.mark.parametrize(("count", "rounds"), [(0, 3), (1, 0)])
def test_nothing_to_measure_is_refused(count: int, rounds: int) -> None:
    with pytest.raises(ValueError, match="nothing would be measured"):
        measure_in_turn([recorded("a", [])] * count, REFERENCE, {}, rounds)


def _row(mesh: str, setting: str, seconds: float, error: float | None, rays: float | str = 8.0) -> dict[str, Any]:
    times = {name: {"median": seconds} for name in ("seconds", "seconds_without_set_up")}
    return {"mesh": mesh, "method": "m", "setting": setting, "relrmse": error, "equivalent_rays": rays, **times}


def test_pooled_rows_are_medians_of_what_all_meshes_have() -> None:
    rows = [
        *(_row("a", "x", 1.0, 0.1), _row("a", "y", 2.0, 0.2), _row("a", "only here", 1.0, 0.1)),
        *(_row("b", "x", 1.0, 0.3, "< 4"), _row("b", "y", 2.0, 0.4)),
    ]
    found = pooled(rows, [100, 100, 100, 500, 500])
    assert [row["setting"] for row in found] == ["x", "y"]
    # 1 second of 100 and of 500 vertices: 10 and 2 seconds a thousand
    assert found[0]["seconds"] == 6.0 and found[0]["relrmse"] == pytest.approx(0.2)
    assert found[0]["equivalent_rays"] == "< 4" and "psnr" not in found[0]
    assert [row["on_front"] for row in found] == [True, False]
    assert pooled([_row("a", "x", 1.0, None)], [100]) == []


def test_bounds_of_rays_have_a_place_in_the_median() -> None:
    assert median_rays([">= 512", 8.0, "< 4"]) == 8.0
    assert median_rays(["< 4", 8.0]) == "< 4" and median_rays([">= 512"]) == ">= 512"


def test_the_noise_of_a_reference_by_hand() -> None:
    assert frontier.relative_noise(REFERENCE) == pytest.approx((4 * 0.25 / 25) ** 0.5)
    assert frontier.relative_noise(REFERENCE._replace(coefficients=0 * TRUTH)) is None


def test_programs_are_compiled_anew_inside_and_kept_outside() -> None:
    config: Any = jax.config
    before = config.jax_enable_compilation_cache
    with pytest.raises(RuntimeError), frontier.compiled_anew():
        assert config.jax_enable_compilation_cache is False
        raise RuntimeError
    assert config.jax_enable_compilation_cache == before
