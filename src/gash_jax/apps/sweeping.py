"""`gash sweep`: every run of a sweep in a process of its own, one line of JSON each, a table and a picture.

A finished run is one line of `results.jsonl`; a sweep that was stopped goes on with the runs that are missing, from
their last checkpoint. Parallel runs are pinned to cores of their own. Inference is timed at the end, one network
after the other, so that nothing else of the sweep runs beside it.
"""

import csv
import json
import multiprocessing
import os
import queue
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.apps.pictures.plots import plot_pareto
from gash_jax.apps.progress import progress_bar, say
from gash_jax.files.atomic import check_writable, whole_file
from gash_jax.files.cores import available_cores
from gash_jax.files.settings import ConfigError
from gash_jax.measure.provenance import provenance
from gash_jax.measure.timing import timed
from gash_jax.models.model import load_model
from gash_jax.shapes.procedural import make_shape
from gash_jax.train.sweep import Run, load_sweep, train_run

LINES, TABLE, PICTURE = "results.jsonl", "results.csv", "pareto.png"
TIMED_SHAPE = (7, 2)  # seed and index of the generated mesh that inference is timed on


def _child(run: Run, folder: Path, cores: list[int], pipe: Any) -> None:
    """One run in its own process, on its own cores; sends fractions, then the line or the error."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)
    try:
        line = train_run(run, folder, lambda phase, fraction, values: pipe.send(fraction))
        pipe.send({**line, **provenance()})
    except KeyboardInterrupt:
        pass
    except Exception as error:  # noqa: BLE001 - whatever it was, the other runs go on and the user is told
        pipe.send(f"{type(error).__name__}: {' '.join(str(error).split())}")


def _core_sets(jobs: int) -> list[list[int]]:
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else list(range(available_cores()))
    if jobs > len(cores):
        raise ConfigError(f"--jobs {jobs}: this machine has {len(cores)} cores to give")
    return [list(map(int, part)) for part in np.array_split(cores, jobs)]


def _work(waiting: "queue.Queue[Run]", cores: list[int], folder: Path, tell: Any) -> None:
    """A thread that runs one process after the other on its cores."""
    context = multiprocessing.get_context("spawn")
    while True:
        try:
            run = waiting.get_nowait()
        except queue.Empty:
            return
        mine, theirs = context.Pipe(duplex=False)
        process = context.Process(target=_child, args=(run, folder / run.id, cores, theirs), daemon=True)
        process.start()
        theirs.close()
        try:
            while not isinstance(message := mine.recv(), dict | str):
                tell(run, message)
            tell(run, message)
        except EOFError:
            tell(run, "the process ended without a word (killed, or out of memory)")
        process.join()


def _read(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def sweep(spec: Path, output: Path, jobs: int, quiet: bool) -> None:
    """`gash sweep`."""
    name, runs = load_sweep(spec)
    output.mkdir(parents=True, exist_ok=True)
    check_writable(output / LINES)
    done = {line["id"] for line in _read(output / LINES)}
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
    if failures:
        raise ConfigError(f"{len(failures)} of {len(runs)} runs failed, the others are kept: " + "; ".join(failures))


def _train_missing(missing: Sequence[Run], output: Path, jobs: int, quiet: bool) -> list[str]:
    """Run what is missing; lines are appended as they come. Returns what failed."""
    waiting: queue.Queue[Run] = queue.Queue()
    for run in missing:
        waiting.put(run)
    lock, fractions, failures = threading.Lock(), dict.fromkeys((run.id for run in missing), 0.0), []
    with progress_bar(f"{len(missing)} runs", quiet or not missing) as update:

        def tell(run: Run, message: float | dict | str) -> None:
            with lock:
                fractions[run.id] = message if isinstance(message, float) else 1.0
                update(round(1000 * sum(fractions.values())), 1000 * len(missing))
                if isinstance(message, dict):
                    with open(output / LINES, "a", encoding="utf-8") as file:
                        file.write(json.dumps(message) + "\n")
                if isinstance(message, str):
                    failures.append(f"{run.config.name}: {message}")

        cores = _core_sets(jobs)
        threads = [
            threading.Thread(target=_work, args=(waiting, own, output / "runs", tell), daemon=True) for own in cores
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            while thread.is_alive():  # a plain join would not let Ctrl-C through
                thread.join(0.2)
    return failures


def _inference_times(lines: Sequence[dict[str, Any]], output: Path, quiet: bool) -> dict[str, float]:
    """Microseconds per vertex by run id, graph building not counted; a network's seeds share one timing."""
    _, mesh = make_shape(*TIMED_SHAPE, vertices=(10000, 12000))
    times: dict[str, float] = {}
    by_shape: dict[str, float] = {}
    with progress_bar("timing", quiet) as update:
        for step, line in enumerate(lines):
            model = load_model(output / "runs" / line["id"] / "model.npz")
            shape = json.dumps(model.config.to_dict())
            if shape not in by_shape:
                graph = model.graph(mesh)
                by_shape[shape] = timed(lambda m=model, g=graph: m(g))[1] / len(mesh.vertices) * 1e6
            times[line["id"]] = by_shape[shape]
            update(step + 1, len(lines))
    return times


def _summary(lines: Sequence[dict[str, Any]], axes: list[str], times: dict[str, float]) -> list[dict[str, Any]]:
    """One row a point: mean and standard deviation over its seeds."""
    rows = []
    for point in dict.fromkeys(tuple(line[axis] for axis in axes) for line in lines):
        seeds = [line for line in lines if tuple(line[axis] for axis in axes) == point]
        row = dict(zip(axes, point, strict=True)) | {"seeds": len(seeds), "parameters": seeds[0]["parameters"]}
        row["us_per_vertex"] = times[seeds[0]["id"]]
        for measure in ("relrmse", "skill", "shadow_mse"):
            values = [line[measure] for line in seeds]
            row[measure] = float(np.mean(values))
            row[f"{measure}_std"] = float(np.std(values, ddof=1)) if len(values) > 1 else None
        row["steps"] = round(float(np.mean([line["steps"] for line in seeds])))
        rows.append(row)
    return rows


def _write_table(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    with whole_file(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
