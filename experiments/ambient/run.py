"""Strength of the ambient-occlusion refinement, fitted on generated shapes, and what it is worth on others.

    .venv/bin/python -m experiments.ambient.run --output experiments/ambient/results.json

For fixed occlusion a, the s that minimises |c (1 - s a) - t|² is closed: s = <c a, c - t> / |c a|².
"""

from pathlib import Path

import numpy as np

from benchmarks.options import parser, saved
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.measure import metrics
from gash_jax.measure.provenance import provenance
from gash_jax.models.ambient import STRENGTH, ambient_occlusion, ambient_refinement
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.procedural import make_shape

FIT_SEED, HELD_SEED, SHAPES = 5, 6, 36


def measured(seed: int, count: int) -> list[tuple]:
    """Meshes with their closed form and their bake."""
    found = []
    for index in range(count):
        mesh = make_shape(seed, index, (1000, 4000))[1]
        formula = np.asarray(unshadowed_transfer(mesh.normals, 3))
        found.append((mesh, formula, bake_transfer(mesh, rays=256, replicates=1).coefficients))
    return found


def main(output: Path | None, shapes: int) -> dict:
    above, below = 0.0, 0.0
    for mesh, formula, truth in measured(FIT_SEED, shapes):
        darkened = formula * ambient_occlusion(mesh)[:, None]
        above, below = above + np.sum(darkened * (formula - truth)), below + np.sum(darkened**2)
    held = [
        {"vertices": len(mesh.vertices), "skill": metrics.skill(ambient_refinement(mesh, formula), truth, mesh.normals)}
        for mesh, formula, truth in measured(HELD_SEED, shapes)
    ]
    skills = [row["skill"] for row in held if isinstance(row["skill"], float)]
    results = {
        **provenance(seed=FIT_SEED, arguments={"shapes": shapes}),
        "fitted_strength": float(above / below),
        "strength": STRENGTH,
        "median_skill": float(np.median(skills)),
        "worst_skill": min(skills),
        "rows": held,
    }
    print({key: results[key] for key in ("fitted_strength", "strength", "median_skill", "worst_skill")})
    return saved(output, results)


if __name__ == "__main__":
    command = parser(__doc__, "output")
    command.add_argument("--shapes", type=int, default=SHAPES)
    main(**vars(command.parse_args()))
