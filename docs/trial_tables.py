"""Tables of the trial of the published networks: every reading of the paper, what each stage loses, what is linear."""

from typing import Any

import numpy as np

from docs.baking_tables import origin
from docs.local_tables import table
from docs.method_names import method_name, reading_name
from experiments.neural_gash.linear import LinearMap
from experiments.neural_gash.variants import READING, READINGS, RUNS, SHORT, Run

CALLS = ("accuracy", "balanced_accuracy", "majority_accuracy")


def validation(result: dict[str, Any]) -> str:
    """Every variant in the readings that were trained: errors on generated shapes of the corpus."""
    rows = []
    for row in result["rows"]:
        run = RUNS[row["run"]]
        calls = [f"{row[key]:.3f}" if key in row else "" for key in CALLS]
        cells = [reading_name(run.frame, run.residual), f"{row['skill']:.3f}", f"{row['relrmse']:.3f}", *calls]
        rows.append([method_name(run._replace(frame=READING[0], residual=READING[1]).name), *cells])
    header = ["network", "reading", "skill", "relrmse", "visibility right", "both classes alike", "majority class"]
    return f"{table(header, rows)}\n\n{origin(result)}, seed {result['seed']}."


def _skill(result: dict[str, Any], method: str, key: str = "skill") -> str:
    """Median over the meshes, and the worst; - where it was not measured."""
    found = [row["methods"].get(method, {}).get(key) for row in result["rows"]]
    known = [value for value in found if isinstance(value, float)]
    return f"{np.median(known):.2f} ({min(known):.2f})" if known else "-"


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
