"""`gash sweep`: every run of a sweep in a process of its own, one line of JSON each, a table and a picture.

A finished run is one line of `results.jsonl`, and a record in `pieces` with the hash of its model (`files.shards`). A
sweep that was stopped goes on with the runs that are missing, from their last checkpoint. Shards leave records alone,
as machines cannot append to one file side by side; a merge makes the lines of them. Parallel runs are pinned to cores
of their own. Inference is timed at the end, one network after the other, so that nothing else of the sweep runs beside
it.
"""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, quiet_option
from gash_jax.apps.pictures.plots import plot_pareto
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.run_processes import train_in_processes
from gash_jax.apps.shard_options import Work, by_jobs, shard_options
from gash_jax.files.atomic import check_writable, whole_file, write_text
from gash_jax.files.settings import ConfigError
from gash_jax.files.shards import Shard, check_merge, fault_of, read_record, write_record
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.timing import timed
from gash_jax.models.deforming_model import DeformingModel, is_deforming, load_deforming_model
from gash_jax.models.model import Model, load_model
from gash_jax.shapes.procedural import make_shape
from gash_jax.train.logs import CLOCKS, whole_lines
from gash_jax.train.sweep import Run, load_sweep, run_folder

LINES, TABLE, PICTURE = "results.jsonl", "results.csv", "pareto.png"
MEASURES = ("relrmse", "skill", "shadow_mse", "accuracy", "l1")  # of those that the runs have
TIMED_SHAPE = (7, 2)  # seed and index of the generated mesh that inference is timed on


@click.command(cls=Command, epilog="gash sweep experiments/latent_depth/sweep.toml -o runs/latent_depth --jobs 2")
@click.argument("sweep_file", metavar="SWEEP", type=PATH)
@click.option("-o", "--output", required=True, type=PATH, help="Folder of the results; runs are kept in it.")
@click.option("--jobs", type=click.IntRange(1), default=1, show_default=True, help="Runs at a time, each on its cores.")
@shard_options
@quiet_option
def sweep(sweep_file: Path, output: Path, jobs: int, quiet: bool, work: Work) -> None:
    """Train every combination that SWEEP (.toml) names; results as JSON lines, CSV, plot. Run again to continue."""
    name, runs = load_sweep(sweep_file)
    left = by_jobs(work, quiet)
    if left is None:
        return
    output.mkdir(parents=True, exist_ok=True)
    check_writable(output / LINES)
    if left.shard is not None:
        _train_shard(name, left.shard, runs, output, jobs, quiet)
        return
    if left.merge:
        _write_lines(output, _merged(runs, output, left.merge))
    before = _read(output / LINES)
    kept = {line["id"] for line in before}
    recorded = [_record_of(run, output) for run in runs if run.id not in kept]  # by shards
    before += [line for line in recorded if line is not None]
    _write_lines(output, before)
    done = {line["id"] for line in before}
    missing = [run for run in runs if run.id not in done]
    say(f"{name}: {len(runs)} runs, {len(runs) - len(missing)} done before", quiet)
    failures = _train_missing(missing, output, jobs, quiet)
    known = {run.id for run in runs}
    lines = [line for line in _read(output / LINES) if line["id"] in known]
    if lines:
        axes = list(runs[0].point)
        rows = _summary(lines, axes, _inference_times(lines, output, quiet))
        _write_table(output / TABLE, rows)
        plot_pareto(rows, axes, output / PICTURE)
        say(f"wrote {output / LINES}, {output / TABLE} and {output / PICTURE}", quiet)
    _check_failures(failures, runs)


def _train_shard(name: str, shard: Shard, runs: Sequence[Run], output: Path, jobs: int, quiet: bool) -> None:
    """Train the runs of a shard that have no record yet; each leaves one."""
    own = shard.of(runs)
    missing = [run for run in own if _record_of(run, output) is None]
    say(f"{name}: {len(own)} of {len(runs)} runs are of shard {shard}, {len(own) - len(missing)} done before", quiet)
    _check_failures(_train_missing(missing, output, jobs, quiet, alone=False), own)


def _check_failures(failures: Sequence[str], runs: Sequence[Run]) -> None:
    if failures:
        raise ConfigError(f"{len(failures)} of {len(runs)} runs failed, the others are kept: " + "; ".join(failures))


def _merged(runs: Sequence[Run], output: Path, shards: int) -> list[dict[str, Any]]:
    """The lines of all runs from their records. Raises FileError where one is missing or damaged."""
    found = [_record_of(run, output) for run in runs]
    faults = [
        fault_of(f"the run {run.config.name}", _model_of(run, output), line is not None)
        for run, line in zip(runs, found, strict=True)
    ]
    check_merge(faults, shards)
    return [line for line in found if line is not None]


def _model_of(run: Run, output: Path) -> Path:
    return output / "runs" / run.folder / "model.npz"


def _record_of(run: Run, output: Path) -> dict[str, Any] | None:
    return read_record(output, run.id, run.id, _model_of(run, output))


def _write_lines(output: Path, lines: Sequence[dict[str, Any]]) -> None:
    write_text(output / LINES, "".join(json.dumps(line) + "\n" for line in lines))


def _read(path: Path) -> list[dict[str, Any]]:
    """The results so far."""
    return [line for line in whole_lines(path) if "id" in line]


def _train_missing(missing: Sequence[Run], output: Path, jobs: int, quiet: bool, alone: bool = True) -> list[str]:
    """Run what is missing; records are written as runs end, and lines by who is `alone`. Returns what failed."""
    fractions, failures = dict.fromkeys((run.id for run in missing), 0.0), []
    with progress_bar(f"{len(missing)} runs", quiet or not missing) as update:

        def tell(run: Run, news: float | dict[str, Any] | str) -> None:
            fractions[run.id] = news if isinstance(news, float) else 1.0
            update(round(1000 * sum(fractions.values())), 1000 * len(missing))
            if isinstance(news, dict):
                write_record(output, run.id, run.id, _model_of(run, output), news)
            if isinstance(news, dict) and alone:
                with open(output / LINES, "a", encoding="utf-8") as file:
                    file.write(json.dumps(news) + "\n")
            if isinstance(news, str):
                failures.append(f"{run.config.name}: {news}")

        train_in_processes(missing, output / "runs", jobs, tell)
    return failures


def _inference_times(lines: Sequence[dict[str, Any]], output: Path, quiet: bool) -> dict[str, float]:
    """Microseconds per vertex by run id, graph building not counted; a network's seeds share one timing.

    Networks of any mesh are timed on a generated one, models of one object on its rest, normals included.
    """
    _, mesh = make_shape(*TIMED_SHAPE, vertices=(10000, 12000))
    times: dict[str, float] = {}
    by_shape: dict[str, float] = {}
    with progress_bar("timing", quiet) as update:
        for step, line in enumerate(lines):
            path = run_folder(output / "runs", line["id"]) / "model.npz"
            model = load_deforming_model(path) if is_deforming(path) else load_model(path)
            shape = json.dumps(model.config.to_dict())
            if shape not in by_shape:
                by_shape[shape] = _seconds_a_vertex(model, mesh) * 1e6
            times[line["id"]] = by_shape[shape]
            update(step + 1, len(lines))
    return times


def _seconds_a_vertex(model: Model | DeformingModel, mesh: Mesh) -> float:
    if isinstance(model, DeformingModel):
        positions = model.mesh.vertices
        say = model if model.light is None else model.radiance
        return timed(lambda: say(positions))[1] / len(positions)
    graph = model.graph(mesh)
    return timed(lambda: model(graph))[1] / len(mesh.vertices)


def _summary(lines: Sequence[dict[str, Any]], axes: list[str], times: dict[str, float]) -> list[dict[str, Any]]:
    """One row a point: mean and standard deviation over its seeds."""
    rows = []
    for point in dict.fromkeys(tuple(line[axis] for axis in axes) for line in lines):
        seeds = [line for line in lines if tuple(line[axis] for axis in axes) == point]
        row = dict(zip(axes, point, strict=True)) | {"seeds": len(seeds), "parameters": seeds[0]["parameters"]}
        row["us_per_vertex"] = times[seeds[0]["id"]]
        for measure in [name for name in MEASURES if all(name in line for line in lines)]:
            values = [line[measure] for line in seeds]
            row[measure] = float(np.mean(values))
            row[f"{measure}_std"] = float(np.std(values, ddof=1)) if len(values) > 1 else None
        row["steps"] = round(float(np.mean([line["steps"] for line in seeds])))
        for name in CLOCKS:
            spent = [line[name] for line in seeds if line.get(name) is not None]  # older runs were not timed
            row[name] = float(np.mean(spent)) if spent else None
        rows.append(row)
    return rows


def _write_table(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    with whole_file(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
