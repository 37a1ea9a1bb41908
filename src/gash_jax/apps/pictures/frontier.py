"""The figure of `gash bench frontier`: relative error against time, and the PSNR of relit pictures where there is one.

One panel for all meshes together and one for each; every method has a colour of its own, and settings that are numbers
(rays, errors) are joined by a line. The Pareto front is the thick grey line behind them: whoever wants less error must
pay more time.
"""

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from gash_jax.measure.frontier import pareto_front

MOST_COLUMNS = 4
LEAST_WIDTH = 9.0  # inches, for the legend
MARKERS = "osD^v<>ph8"
TIME = "seconds per 1000 vertices, set-up included"


class _Panel(NamedTuple):
    title: str
    rows: Sequence[dict[str, Any]]
    seconds: np.ndarray  # per 1000 vertices, of each row


def draw_frontier(results: dict[str, Any], path: Path) -> None:
    """Draw the results as the command writes them. Raises ValueError where nothing was measured."""
    panels = _panels(results)
    if not panels:
        raise ValueError("no method was measured on any mesh: nothing to draw, choose others with --methods")
    labels = list(dict.fromkeys(row["label"] for panel in panels for row in panel.rows))
    measures = [("relrmse", "relative RMS error")]
    if any(row.get("psnr") is not None for panel in panels for row in panel.rows):
        measures.append(("psnr", "PSNR of relit pictures, dB"))
    lines = ceil(len(panels) / MOST_COLUMNS)
    columns = ceil(len(panels) / lines)
    figure = Figure(figsize=(max(4.2 * columns, LEAST_WIDTH), 3.6 * lines * len(measures) + 1.2), layout="constrained")
    plots = figure.subplots(lines * len(measures), columns, squeeze=False)
    for block, (name, text) in enumerate(measures):
        for index in range(lines * columns):
            plot = plots[block * lines + index // columns, index % columns]
            if index < len(panels):
                _draw(plot, panels[index], name, text, labels)
            else:
                plot.set_axis_off()
    handles: dict[str, Any] = {}
    for plot in plots.flat:
        handles |= {label: handle for handle, label in zip(*plot.get_legend_handles_labels(), strict=True)}
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=max(3, columns), fontsize=9)
    figure.savefig(path, dpi=110)


def timed_vertices(mesh: dict[str, Any]) -> int:
    """How many vertices a call had to say something of: those of all frames."""
    return mesh["vertices"] * (mesh["frames"] or 1)


def _panels(results: dict[str, Any]) -> list[_Panel]:
    found = []
    for pool in results["pooled"]:
        if pool["meshes"] > 1:
            kind = "animations" if pool["moving"] else "meshes"
            bounces = f", {pool['bounces']} bounces" if pool["bounces"] else ""
            title, seconds = f"median of {pool['meshes']} {kind}{bounces}", [row["seconds"] for row in pool["rows"]]
            found.append(_Panel(title, pool["rows"], np.array(seconds)))
    for mesh in results["meshes"]:
        rows = [row for row in mesh["rows"] if row["relrmse"] is not None]
        seconds = np.array([1e3 * row["seconds"]["median"] / timed_vertices(mesh) for row in rows])
        frames = f"{mesh['frames']} frames of " if mesh["frames"] else ""
        found.append(_Panel(f"{mesh['mesh']}, {frames}{mesh['vertices']} vertices", rows, seconds))
    return [panel for panel in found if len(panel.rows)]


def _draw(plot: Axes, panel: _Panel, name: str, text: str, labels: Sequence[str]) -> None:
    kept = [index for index, row in enumerate(panel.rows) if row.get(name) is not None]
    rows, seconds = [panel.rows[index] for index in kept], panel.seconds[kept]
    values = np.array([row[name] for row in rows])
    if name == "relrmse":
        plot.set_yscale("log")
        if not np.all(values > 0):  # exact, which a logarithm cannot show
            keep = values > 0
            rows, seconds, values = [row for row, k in zip(rows, keep, strict=True) if k], seconds[keep], values[keep]
    plot.set(title=panel.title, xlabel=TIME, ylabel=text, xscale="log")
    if len(rows):
        front = pareto_front(np.stack([seconds, values if name == "relrmse" else -values], -1))
        plot.plot(
            seconds[front], values[front], color="0.7", lw=6, solid_capstyle="round", zorder=1, label="Pareto front"
        )
    for label in dict.fromkeys(row["label"] for row in rows):
        own = [index for index, row in enumerate(rows) if row["label"] == label]
        numbers = all(rows[index]["setting"].replace(".", "").isdigit() for index in own)
        if numbers:
            own.sort(key=lambda index: float(rows[index]["setting"]))
        place = labels.index(label)
        color, marker = colormaps["tab20"](place * 2 % 20 + place * 2 // 20), MARKERS[place % len(MARKERS)]
        style: dict[str, Any] = {"color": color, "marker": marker, "ms": 5, "lw": 1, "ls": "-" if numbers else "none"}
        plot.plot(seconds[own], values[own], label=label, **style)
    if name == "relrmse":
        plot.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        plot.yaxis.set_major_formatter("{x:g}")
        plot.yaxis.set_minor_formatter(NullFormatter())
    plot.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    plot.xaxis.set_major_formatter("{x:g}")
    plot.xaxis.set_minor_formatter(NullFormatter())
    plot.grid(alpha=0.3, which="both", lw=0.4)
