"""How many vertices the generated shapes have: `.venv/bin/python -m benchmarks.corpus_sizes`.

A shape meets the number drawn for it to about 30 %, so a corpus reaches beyond the range its config asks for.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import options, saved
from gash_jax.measure.provenance import provenance
from gash_jax.shapes.procedural import make_shape
from gash_jax.train.config import load_config

CONFIGS = ("base", "local")


def main(output: Path | None, quick: bool) -> dict[str, Any]:
    rows = []
    for name in CONFIGS:
        data = load_config(name).data
        shapes = 4 if quick else data.shapes + data.validation_shapes
        asked = (data.min_vertices, data.max_vertices)
        counts = [len(make_shape(data.seed, index, asked, data.kinds)[1].vertices) for index in range(shapes)]
        found = {"least": min(counts), "median": float(np.median(counts)), "most": max(counts)}
        rows.append({"config": name, "shapes": shapes, "asked": list(asked), **found})
    return saved(output, provenance(seed=0, rows=rows))


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
