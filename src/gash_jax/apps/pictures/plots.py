"""Figures: learning curves of a run, speed against error of a sweep."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from matplotlib.transforms import Bbox

from gash_jax.measure.frontier import pareto_front
from gash_jax.train.logs import read_lines

# offsets in points and alignments at which a label of a point is tried
PLACES = tuple(
    ((x, sign * far), side, level)
    for far in (4.0, 12.0)
    for x, side in ((5.0, "left"), (-5.0, "right"), (0.0, "center"))
    for sign, level in ((1.0, "bottom"), (-1.0, "top"))
)


def plot_pareto(rows: Sequence[dict[str, Any]], axes: Sequence[str], path: Path) -> None:
    """Error against inference time of every point, error bars over seeds, the Pareto front as a line."""
    time, error = (np.array([row[name] for row in rows]) for name in ("us_per_vertex", "relrmse"))
    spread = [row["relrmse_std"] or 0.0 for row in rows]
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    plot = figure.subplots()
    front = pareto_front(np.stack([time, error], -1))
    plot.plot(time[front], error[front], color="C1", zorder=1, label="Pareto front")
    plot.errorbar(time, error, yerr=spread, fmt="o", color="C0", capsize=3, label="run (bar: one deviation over seeds)")
    plot.set(
        xscale="log", xlabel="inference, us per vertex (graph built before)", ylabel="relrmse of what was held out"
    )
    plot.margins(x=0.15, y=0.15)
    plot.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    plot.xaxis.set_major_formatter("{x:g}")
    plot.xaxis.set_minor_formatter(NullFormatter())
    figure.legend(*plot.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    plot.grid(alpha=0.3)
    bars = [np.array([[x, y - s], [x, y + s]]) for x, y, s in zip(time, error, spread, strict=True)]
    labels = [" ".join(f"{axis} {row[axis]}" for axis in axes) for row in rows]
    label_points(plot, labels, np.stack([time, error], -1), [*bars, np.stack([time[front], error[front]], -1)])
    figure.savefig(path, dpi=120)


def label_points(plot: Axes, labels: Sequence[str], points: np.ndarray, lines: Sequence[np.ndarray]) -> list[Bbox]:
    """Write every label beside its point (n, 2), where it covers no line (m, 2) and no other label; boxes in pixels.

    A label that fits nowhere stands at the last of the places tried.
    """
    plot.get_figure(root=True).draw_without_rendering()  # type: ignore[union-attr]  # sets the axes' scale
    steps = np.linspace(0.0, 1.0, 40)[:, None, None]
    ends = [plot.transData.transform(line) for line in lines]
    drawn = np.concatenate([((1 - steps) * line[:-1] + steps * line[1:]).reshape(-1, 2) for line in ends])
    boxes: list[Bbox] = []
    for label, point in zip(labels, points, strict=True):
        text = plot.annotate(label, point, xytext=(0, 0), textcoords="offset points", fontsize=7)
        for place, side, level in PLACES:
            text.set(position=place, ha=side, va=level)
            box = text.get_window_extent()
            inside = plot.bbox.contains(*box.min) and plot.bbox.contains(*box.max)
            if inside and not box.padded(3).count_contains(drawn) and not box.count_overlaps(boxes):
                break
        boxes.append(text.get_window_extent())
    return boxes


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
