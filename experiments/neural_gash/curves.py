"""Validation curves of the runs that had long: is there more to be had from more time?

    .venv/bin/python -m experiments.neural_gash.curves --runs runs/neural_gash --output docs/results/curves.json

The figure stands beside the results. Phases follow each other, so minutes count from the start of each.
"""

import json
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from benchmarks.options import options, saved
from docs.method_names import method_name
from experiments.neural_gash.variants import RUNS
from gash_jax.measure.provenance import provenance

SHOWN = {"visibility": "balanced_accuracy", "coefficients": "skill"}
LABELS = {"balanced_accuracy": "visibility: both classes alike", "skill": "skill on validation shapes"}


def curve(log: Path, phase: str) -> list[list[float]]:
    """CPU minutes since the phase began and the phase's measure, at each validation."""
    rows = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    own = [row for row in rows if row["phase"] == phase]
    start = own[0]["cpu_seconds"] if own else 0.0
    return [[(row["cpu_seconds"] - start) / 60, row[SHOWN[phase]]] for row in own if "validation" in row]


def figure(rows: list[dict[str, Any]]) -> Figure:
    """One panel a measure."""
    drawn = Figure(figsize=(8, 3), layout="constrained")
    panels = dict(zip(SHOWN, drawn.subplots(1, len(SHOWN)), strict=True))
    colours = {name: f"C{i}" for i, name in enumerate(dict.fromkeys(row["run"] for row in rows))}
    for row in rows:
        minutes, values = zip(*row["curve"], strict=True)
        panels[row["phase"]].plot(minutes, values, color=colours[row["run"]], label=method_name(row["run"]))
    for phase, axes in panels.items():
        axes.set(xlabel="minutes of CPU time", ylabel=LABELS[SHOWN[phase]])
        axes.grid(alpha=0.3)
        if axes.lines:
            axes.legend(frameon=False)
    return drawn


def main(runs: Path, output: Path | None) -> dict[str, Any]:
    logs = {name: runs / name / "metrics.jsonl" for name, run in RUNS.items() if run.long}
    found = [(name, phase, curve(log, phase)) for name, log in logs.items() if log.exists() for phase in SHOWN]
    rows = [{"run": name, "phase": phase, "curve": values} for name, phase, values in found if values]
    if output:
        figure(rows).savefig(output.with_suffix(".png"), dpi=150)
    return saved(output, {**provenance(seed=0), "rows": rows})


if __name__ == "__main__":
    main(**options(__doc__, "runs", "output"))
