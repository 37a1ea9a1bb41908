"""Speed against error of many settings of many methods on one mesh, and the front of those that nothing beats.

A *setting* is one way to get the coefficients of a mesh, such as the plain bake with 64 rays. All settings are first
called once, so that everything is compiled; then come rounds, in each of which every setting is called once, in turn:
what else the machine does falls on all of them alike, and medians over the rounds leave single disturbances out. Where
a program was compiled during a timed call after all (a bake to an error takes other rounds with another seed), that
call is made again.

Round i has seed i. The error of a setting is that of the very calls that were timed, the mean of their squares over
the seeds. Times are those of the whole call; what of it made the scene or the graph, as the call itself tells, is
stated apart: seconds with it and without.

A point (time, error) is on the *Pareto front* of others where none of them is as good in both and better in one.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from gash_jax.measure import metrics
from gash_jax.measure.reference import Reference
from gash_jax.prt.tracing import ProgressFn

COMPILING = "/jax/core/compile/backend_compile_duration"  # JAX's name of the event
# fronts by the entry that says whether a row is on them, and the times that they are of
FRONTS = {"on_front": "seconds", "on_front_without_set_up": "seconds_without_set_up"}
MOST_REPEATS = 3  # of a timed call in which something was compiled


class Outcome(NamedTuple):
    """What a call gave: coefficients, the seconds of it that made the scene or the graph, and rays per vertex."""

    coefficients: Float[np.ndarray, "v k"]
    set_up: float
    rays: float | None = None


class Setting(NamedTuple):
    """One way to get the coefficients of a mesh: the method, how it is set, and what calls it with a seed."""

    method: str
    setting: str
    run: Callable[[int], Outcome]


class Call(NamedTuple):
    """A timed call: seconds on the wall and of all cores together, seconds of set-up in it, squared error, rays."""

    wall: float
    cpu: float
    set_up: float
    mse: float
    rays: float | None


def pareto_front(costs: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "front"]:
    """Indices of the rows that no other row beats in both columns, by rising first column.

    Of equal rows the first is on the front.

    >>> pareto_front(np.array([[1.0, 5.0], [2.0, 6.0], [3.0, 1.0]])).tolist()
    [0, 2]
    """
    order = np.lexsort((costs[:, 1], costs[:, 0]))
    lowest = np.minimum.accumulate(np.concatenate([[np.inf], costs[order, 1][:-1]]))
    return order[costs[order, 1] < lowest]


@contextmanager
def compiled_anew() -> Iterator[None]:
    """Within the block JAX reads no compiled program from disk, so that the first call of a setting shows its cost."""
    from jax.experimental.compilation_cache.compilation_cache import reset_cache

    before = jax.config.jax_enable_compilation_cache  # pyright: ignore[reportAttributeAccessIssue]
    jax.config.update("jax_enable_compilation_cache", False)
    reset_cache()  # JAX asks once whether there is a cache and remembers the answer
    try:
        yield
    finally:
        jax.config.update("jax_enable_compilation_cache", before)
        reset_cache()


@contextmanager
def _count_compilations() -> Iterator[list[float]]:
    """Yield the list of what was compiled within the block, which grows: the seconds of each program."""
    found: list[float] = []

    def listen(event: str, duration_secs: float, **kwargs: str | int) -> None:
        if event == COMPILING:
            found.append(duration_secs)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        yield found
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


def first_calls(settings: Sequence[Setting], progress: ProgressFn | None = None) -> dict[tuple[str, str], float]:
    """Seconds of the first call of every setting, by method and setting: what it compiles is then there.

    What several settings share is compiled by the first of them. `progress(done, total)` counts calls.
    """
    found = {}
    for step, setting in enumerate(settings):
        started = time.perf_counter()
        setting.run(0)
        found[setting.method, setting.setting] = time.perf_counter() - started
        if progress:
            progress(step + 1, len(settings))
    return found


def measure_in_turn(
    settings: Sequence[Setting],
    reference: Reference,
    first: Mapping[tuple[str, str], float],
    rounds: int = 5,
    picture_score: Callable[[np.ndarray], float] | None = None,
    progress: ProgressFn | None = None,
) -> list[dict[str, Any]]:
    """A row for each setting: times, errors against the reference, and whether it is on the front of this mesh.

    `first` is what `first_calls` found, of some of the settings; `compile_seconds` is what the first call took beyond
    the median, None of the others. `picture_score` of coefficients, the PSNR of relit pictures, is entered as `psnr`,
    for the last round. `progress(done, total)` counts calls. Raises ValueError for no setting or fewer than one round.
    """
    if not settings or rounds < 1:
        raise ValueError(f"{len(settings)} settings in {rounds} rounds: nothing would be measured")
    total, scores = rounds * len(settings), []
    calls: list[list[Call]] = [[] for _ in settings]
    with _count_compilations() as compiled:
        for seed in range(rounds):
            for index, setting in enumerate(settings):
                call, coefficients = _warm(setting, seed, reference, compiled)
                calls[index].append(call)
                if picture_score and seed == rounds - 1:
                    scores.append(picture_score(coefficients))
                if progress:
                    progress(seed * len(settings) + index + 1, total)
    taken = [first.get((setting.method, setting.setting)) for setting in settings]
    rows = [_row(s, c, f, reference) for s, c, f in zip(settings, calls, taken, strict=True)]
    for row, score in zip(rows, scores, strict=False):
        row["psnr"] = score
    for name, key in FRONTS.items():
        _mark_front(rows, name, [row[key]["median"] for row in rows])
    return rows


def _mark_front(rows: list[dict[str, Any]], name: str, times: list[float]) -> None:
    """Say of every row whether it is on the front; errors that differ by rounding alone, as those of one network in two
    runtimes do, are equal. A row without an error is on none."""
    errors = [np.inf if row["relrmse"] is None else float(f"{row['relrmse']:.3g}") for row in rows]
    front = pareto_front(np.array([times, errors]).T.reshape(-1, 2))
    for index, row in enumerate(rows):
        row[name] = index in front


def _timed(setting: Setting, seed: int, reference: Reference) -> tuple[Call, np.ndarray]:
    started = time.perf_counter(), time.process_time()
    found = setting.run(seed)
    wall, cpu = time.perf_counter() - started[0], time.process_time() - started[1]
    return Call(wall, cpu, found.set_up, metrics.mse(found.coefficients, reference.coefficients), found.rays), (
        found.coefficients
    )


def _warm(setting: Setting, seed: int, reference: Reference, compiled: list[float]) -> tuple[Call, np.ndarray]:
    """A call during which nothing was compiled, if there is one among the first few."""
    repeats = 0
    while True:
        before, repeats = len(compiled), repeats + 1
        found = _timed(setting, seed, reference)
        if len(compiled) == before or repeats == MOST_REPEATS:
            return found


def _row(setting: Setting, calls: list[Call], first: float | None, reference: Reference) -> dict[str, Any]:
    truth = reference.coefficients
    error = float(np.mean([call.mse for call in calls]))
    energy = float(np.mean(truth.astype(np.float64) ** 2))
    wall = np.array([call.wall for call in calls])
    rays = [call.rays for call in calls if call.rays is not None]
    return {
        "method": setting.method,
        "setting": setting.setting,
        "rays": float(np.mean(rays)) if rays else None,
        "relrmse": float(np.sqrt(error / energy)) if energy > 0 else None,
        "mse": error,
        "equivalent_rays": metrics.equivalent_rays(error, reference.curve) if energy > 0 else "no transfer",
        "seconds": spread(wall),
        "seconds_without_set_up": spread(wall - [call.set_up for call in calls]),
        "cpu_seconds": spread(np.array([call.cpu for call in calls])),
        "compile_seconds": None if first is None else max(first - float(np.median(wall)), 0.0),
    }


def spread(values: Float[np.ndarray, "n"]) -> dict[str, float]:
    """Median and quartiles by name."""
    quarters = np.quantile(values, [0.25, 0.5, 0.75])
    return dict(zip(("lower_quartile", "median", "upper_quartile"), quarters.tolist(), strict=True))


def relative_noise(reference: Reference) -> float | None:
    """The relative RMS error that the reference itself is estimated to have; None where it has no energy."""
    energy = float(np.sum(reference.coefficients.astype(np.float64) ** 2))
    noise = float(np.sum(reference.standard_error.astype(np.float64) ** 2))
    return float(np.sqrt(noise / energy)) if energy > 0 else None


def pooled(rows: Sequence[dict[str, Any]], of: Sequence[int]) -> list[dict[str, Any]]:
    """Settings that all meshes have, each a row of medians over the meshes; those on the front of medians are marked.

    `rows` are those of all meshes one after another, each with its `mesh`; `of` has the vertices of each row's mesh.
    Times are seconds per 1000 vertices. Settings without an error on some mesh (no transfer) are left out.
    """
    meshes = {row["mesh"] for row in rows}
    groups: dict[tuple[str, str], list[tuple[dict[str, Any], int]]] = {}
    for row, vertices in zip(rows, of, strict=True):
        if row["relrmse"] is not None:
            groups.setdefault((row["method"], row["setting"]), []).append((row, vertices))
    found = []
    for (method, setting), held in groups.items():
        if len(held) < len(meshes):
            continue
        entry: dict[str, Any] = {"method": method, "setting": setting}
        for name in ("seconds", "seconds_without_set_up"):
            entry[name] = float(np.median([1e3 * row[name]["median"] / vertices for row, vertices in held]))
        for name in ("relrmse", "psnr"):
            if all(row.get(name) is not None for row, _ in held):
                entry[name] = float(np.median([row[name] for row, _ in held]))
        entry["equivalent_rays"] = median_rays([row["equivalent_rays"] for row, _ in held])
        found.append(entry)
    for name, key in FRONTS.items():
        _mark_front(found, name, [entry[key] for entry in found])
    return found


def median_rays(values: Sequence[float | str]) -> float | str:
    """The middle one of equivalent rays, of which some are bounds ("< 4", ">= 512"); of two middle ones the lower."""

    def rank(value: float | str) -> float:
        if isinstance(value, str):
            return float("-inf") if value.startswith("<") else float("inf")
        return value

    return sorted(values, key=rank)[(len(values) - 1) // 2]
