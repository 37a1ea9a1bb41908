"""Bytes against error of compressed visibility: `.venv/bin/python -m experiments.gloss.figure --output FILE.png`.

Drawn from docs/results/gloss.json: the meshes of `experiments.gloss.run`, thin, and their median.
"""

import json
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.options import options
from docs.tables import ROOT


def main(output: Path) -> None:
    rows = json.loads((ROOT / "docs" / "results" / "gloss.json").read_text(encoding="utf-8"))["components"]
    figure = Figure(figsize=(7.5, 4.2), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for axis, bands in zip(axes, (3, 4), strict=True):
        for frame, color, label in (
            ("world", "tab:gray", "in the world"),
            ("local", "tab:blue", "in the vertices' frames"),
        ):
            own = [row for row in rows if row["bands"] == bands and row["components"] < (2 * bands - 1) ** 2]
            curves = {}
            for row in own:
                curves.setdefault(row["mesh"], []).append((row["bytes"], row[frame]))
            for curve in curves.values():
                axis.plot(*zip(*curve, strict=True), color=color, linewidth=0.6, alpha=0.6)
            median = np.median([list(zip(*curve, strict=True))[1] for curve in curves.values()], axis=0)
            axis.plot([size for size, _ in next(iter(curves.values()))], median, color=color, marker="o", label=label)
        axis.set_title(f"{bands} bands, whole: {2 * (2 * bands - 1) ** 2} bytes")
        axis.set_xlabel("bytes a vertex (float16)")
        axis.set_yscale("log")
        axis.grid(alpha=0.3, which="both")
    axes[0].set_ylabel("relrmse of the visibility")
    axes[0].legend()
    figure.savefig(output, dpi=110)


if __name__ == "__main__":
    main(**options(__doc__, "output"))
