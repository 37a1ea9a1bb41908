"""Tables of the trial of the published networks: every reading of the paper, and what each stage loses."""

from typing import Any

import numpy as np

from docs.baking_tables import origin
from docs.local_tables import table
from docs.method_names import method_name, reading_name
from experiments.neural_gash.linear import LinearMap
from experiments.neural_gash.variants import READING, READINGS, RUNS, SHORT, Run


def _skill(result: dict[str, Any], method: str, key: str = "skill") -> str:
    """Median over the meshes, and the worst; - where it was not measured."""
    found = [row["methods"].get(method, {}).get(key) for row in result["rows"]]
    known = [value for value in found if isinstance(value, float)]
    if not known:
        return "-"
    return f"{np.median(known):.2f} ({min(known):.2f})"


def readings(result: dict[str, Any]) -> str:
    """Every variant in every reading of the paper: median skill and the worst."""
    rows = [["linear in 25 rays", *(_skill(result, LinearMap.name_of(*reading)) for reading in READINGS)]]
    for variant in SHORT:
        runs = (Run(variant, *reading).name for reading in READINGS)
        rows.append([method_name(Run(variant, *READING).name), *(_skill(result, name) for name in runs)])
    return table(["skill: median (worst)", *(reading_name(*reading) for reading in READINGS)], rows)


def told(result: dict[str, Any]) -> str:
    """What the second stage makes of traced, predicted and constant visibilities, in every reading."""
    rows = []
    for name, run in RUNS.items():
        if "skill_traced" in result["rows"][0]["methods"].get(name, {}):
            cells = [_skill(result, name, f"skill_{source}") for source in ("traced", "predicted", "constant")]
            variant = method_name(run._replace(frame=READING[0], residual=READING[1]).name)
            rows.append([variant, reading_name(run.frame, run.residual), *cells])
    return table(["stage 2 of", "reading", "told traced", "told predicted", "told constant"], rows)


def linear(result: dict[str, Any]) -> str:
    """The linear stage 2: one matrix from traced visibilities to coefficients, on shapes that its fit has not seen."""
    header = [f"{mesh['kind']}, {mesh['vertices']} v" for mesh in result["meshes"]]
    rows = [
        [reading_name(row["frame"], row["residual"]), str(row["shapes"]), *(f"{skill:.2f}" for skill in row["skills"])]
        for row in result["rows"]
    ]
    return table(["reading", "fitted on", *header], rows) + f"\n\n{origin(result)}."
