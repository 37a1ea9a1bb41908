"""Tables of the readings of the paper: networks in several frames, and the linear map that they have to beat."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table
from docs.method_names import method_name, reading_name
from experiments.neural_gash.variants import READING, RUNS

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


def linear(result: dict[str, Any]) -> str:
    """The linear stage 2: one matrix from traced visibilities to coefficients, on shapes that its fit has not seen."""
    header = [f"{mesh['kind']}, {mesh['vertices']} v" for mesh in result["meshes"]]
    rows = [
        [reading_name(row["frame"], row["residual"]), str(row["shapes"]), *(f"{skill:.2f}" for skill in row["skills"])]
        for row in result["rows"]
    ]
    return table(["reading", "fitted on", *header], rows) + f"\n\n{origin(result)}."
