"""What a bake to an error is held against: the plain bake with the best count of rays, known beforehand.

To reach an error E with the plain bake one has to know how many rays that takes. Somebody who knew would take the
fewest of `COUNTS` whose true error, over several seeds, is at most E. A bake to an error finds out by itself; the
*ratio* of its seconds to those of that plain bake is what finding out costs, or what rays at the right places save.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from gash_jax.geometry.mesh import Mesh
from gash_jax.measure import metrics
from gash_jax.measure.reference import Reference
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.tracing import ProgressFn

COUNTS = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768, 1024)
SEEDS = 4


def plain_error(mesh: Mesh, reference: Reference, rays: int, seeds: int = SEEDS) -> float:
    """relrmse of the plain bake, the squares averaged over seeds 0, 1 ...; infinite where the reference is dark."""
    truth, bands = reference.coefficients, round(reference.coefficients.shape[1] ** 0.5)
    energy = float(np.mean(truth.astype(np.float64) ** 2))
    found = [bake_transfer(mesh, bands, rays, replicates=1, seed=seed).coefficients for seed in range(seeds)]
    mean = float(np.mean([metrics.mse(one, truth) for one in found]))
    return float(np.sqrt(mean / energy)) if energy > 0 else float("inf")


def fewest_rays(
    error_at: Callable[[int], float],
    targets: Sequence[float],
    counts: Sequence[int] = COUNTS,
    progress: ProgressFn | None = None,
) -> dict[float, int | None]:
    """For each target the first of the rising `counts` with an error at most the target; None where none has.

    Each count is tried once, in their order, until all targets are met; so an error that rises again with more rays
    changes nothing. `progress(done, total)` counts rays.

    >>> fewest_rays(lambda rays: 1 / rays, [0.1, 0.01], (4, 16, 64))
    {0.1: 16, 0.01: None}
    """
    found: dict[float, int | None] = dict.fromkeys(targets)
    for step, count in enumerate(counts):
        missing = [target for target in targets if found[target] is None]
        if not missing:
            break
        error = error_at(count)
        found |= {target: count for target in missing if error <= target}
        if progress:
            progress(sum(counts[: step + 1]), sum(counts))
    return found


def compare_targets(
    rows: Sequence[dict[str, Any]], best: dict[float, int | None], names: tuple[str, str] = ("error", "plain")
) -> list[dict[str, Any]]:
    """For each target the bake to it beside the plain bake of the best count; `rows` are those of `measure_in_turn`.

    `names` are the methods'; settings are the target and the count as text. Where no count reaches a target there is
    no ratio.
    """
    by_name = {(row["method"], row["setting"]): row for row in rows}
    found = []
    for target, count in best.items():
        row = by_name[names[0], f"{target:g}"]
        entry = {"target": target, "relrmse": row["relrmse"], "rays": row["rays"], "best_count": count}
        if count is not None:
            other = by_name[names[1], str(count)]
            entry["best_relrmse"] = other["relrmse"]
            for name in ("seconds", "seconds_without_set_up", "cpu_seconds"):
                entry[f"ratio_of_{name}"] = row[name]["median"] / other[name]["median"]
        found.append(entry)
    return found


def pooled_targets(meshes: Sequence[Sequence[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Over the comparisons of all meshes: median and largest of the ratios, and of true error over target."""
    found = []
    for target in dict.fromkeys(entry["target"] for entries in meshes for entry in entries):
        held = [entry for entries in meshes for entry in entries if entry["target"] == target]
        held = [entry for entry in held if entry["relrmse"] is not None]
        pool: dict[str, Any] = {"target": target, "meshes": len(held)}
        values = {"error_over_target": [entry["relrmse"] / target for entry in held]}
        for name in ("seconds", "seconds_without_set_up", "cpu_seconds"):
            values[f"ratio_of_{name}"] = [e[f"ratio_of_{name}"] for e in held if f"ratio_of_{name}" in e]
        for name, numbers in values.items():
            pool[name] = {"median": float(np.median(numbers)), "largest": max(numbers)} if numbers else None
        pool["compared"] = len(values["ratio_of_seconds"])
        found.append(pool)
    return found
