"""Figures: learning curves of a run, speed against error of a sweep. The only file that imports matplotlib."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from gash_jax.train.logs import read_lines


def pareto_front(costs: np.ndarray) -> np.ndarray:
    """Indices of the rows (n, 2) that no other row beats in both columns, by rising first column."""
    order = np.lexsort((costs[:, 1], costs[:, 0]))
    lowest = np.minimum.accumulate(np.concatenate([[np.inf], costs[order, 1][:-1]]))
    return order[costs[order, 1] < lowest]


def plot_pareto(rows: Sequence[dict[str, Any]], axes: Sequence[str], path: Path) -> None:
    """Error against inference time of every point, error bars over seeds, the Pareto front as a line."""
    time, error = (np.array([row[name] for row in rows]) for name in ("us_per_vertex", "relrmse"))
    spread = [row["relrmse_std"] or 0.0 for row in rows]
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    plot = figure.subplots()
    front = pareto_front(np.stack([time, error], -1))
    plot.plot(time[front], error[front], color="C1", zorder=1, label="Pareto front")
    plot.errorbar(time, error, yerr=spread, fmt="o", color="C0", capsize=3, label="run (bar: one deviation over seeds)")
    for turn, index in enumerate(np.argsort(error)):
        label = " ".join(f"{axis} {rows[index][axis]}" for axis in axes)
        # neighbours in error would write over each other: by turns above and below
        place = (4, 4) if turn % 2 else (4, -9)
        plot.annotate(label, (time[index], error[index]), xytext=place, textcoords="offset points", fontsize=7)
    plot.set(xscale="log", xlabel="inference, us per vertex (graph built before)", ylabel="relrmse, validation shapes")
    plot.margins(x=0.15)
    for which in (plot.xaxis.set_major_formatter, plot.xaxis.set_minor_formatter):
        which(lambda value, _: f"{value:g}")
    plot.legend()
    plot.grid(alpha=0.3)
    figure.savefig(path, dpi=120)


def plot_curves(folder: Path, path: Path) -> None:
    """Training loss and validation loss of every phase of a run, against its steps."""
    lines = read_lines(folder)
    names = list(dict.fromkeys(line["phase"] for line in lines))
    figure = Figure(figsize=(5.5 * len(names), 4), layout="constrained")
    plots = figure.subplots(1, len(names), squeeze=False)
    for plot, name in zip(plots[0], names, strict=True):
        for key, label in (("loss", "training, one batch"), ("validation", "validation shapes")):
            points = [(line["step"], line[key]) for line in lines if line["phase"] == name and key in line]
            if points:
                plot.plot(*np.array(points).T, label=label, alpha=0.5 if key == "loss" else 1.0)
        plot.set(title=name, xlabel="step", ylabel="loss", yscale="log")
        plot.legend()
        plot.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
