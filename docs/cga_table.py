"""The table of encodings on the results page, from experiments/cga/results.json, and the speed of `versor`."""

from typing import Any

import numpy as np
from scipy.stats import t as student

from docs.baking_tables import origin
from docs.local_tables import table

FORMS = {"gnn": "published: GATv2", "rings": "ours: `rings`", "versor": "products in R(4,1): `versor`"}
ENCODINGS = {
    "position-normal": "position and normal, 6 numbers",
    "motor-7": "motor, 7 numbers",
    "motor": "motor, 32 numbers",
    "relative-motor": "relative motors of edges, 8 numbers",
    "relative": "relative features of edges, 16 numbers",
}


def interval(values: np.ndarray) -> str:
    """Mean and half the width of its 95 % interval by Student's t; the mean alone of a single value."""
    mean = f"{values.mean():.3f}"
    if len(values) < 2:
        return mean
    half = student.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return f"{mean} ± {half:.3f}"


def _shown_skill(row: dict[str, Any]) -> float:
    return row["skill"]


def _median_skill(row: dict[str, Any]) -> float:
    return float(np.median([value for value in row["meshes"].values() if isinstance(value, float)]))


def _cells(result: dict[str, Any]) -> dict[tuple[str, str], dict[int, dict[str, Any]]]:
    """Runs by form and encoding, then by seed."""
    cells: dict[tuple[str, str], dict[int, dict[str, Any]]] = {}
    for row in result["rows"]:
        cells.setdefault((row["form"], row["encoding"]), {})[row["seed"]] = row
    return cells


def seed_differences(result: dict[str, Any], form: str, encoding: str, unseen: bool = False) -> str:
    """By how much the skill on generated shapes, or the median one on unseen meshes, differs from that of position and
    normal; - without common seeds."""
    cells = _cells(result)
    cell, plain = cells.get((form, encoding), {}), cells.get((form, "position-normal"), {})
    measure = _median_skill if unseen else _shown_skill
    gain = np.array([measure(cell[seed]) - measure(plain[seed]) for seed in sorted(set(cell) & set(plain))])
    return interval(gain) if gain.size else "-"


def mean_skill(result: dict[str, Any], form: str, encoding: str) -> str:
    """The skill on generated shapes with its interval over seeds; - without runs."""
    cell = _cells(result).get((form, encoding), {})
    return interval(np.array([_shown_skill(row) for row in cell.values()])) if cell else "-"


def encodings(result: dict[str, Any]) -> str:
    """A row for each form and encoding: skills with intervals over seeds, and the difference to position and normal.

    Runs of one seed see the same batches, so differences are taken seed by seed.
    """
    by_cell, rows = _cells(result), []
    for form, encoding in sorted(by_cell, key=lambda cell: (cell[0], list(ENCODINGS).index(cell[1]))):
        cell, plain = by_cell[form, encoding], by_cell.get((form, "position-normal"), {})
        cells = [FORMS[form], ENCODINGS[encoding], str(next(iter(cell.values()))["parameters"])]
        cells += [f"{np.mean([row['steps'] for row in cell.values()]):.0f}", str(len(cell))]
        common = sorted(set(cell) & set(plain))
        for measure in (_shown_skill, _median_skill):
            cells.append(interval(np.array([measure(row) for row in cell.values()])))
            gain = np.array([measure(cell[seed]) - measure(plain[seed]) for seed in common])
            cells.append("" if encoding == "position-normal" or not common else interval(gain))
        rows.append(cells)
    header = ["form", "a vertex is", "parameters", "steps", "seeds", "skill, generated shapes", "against the first"]
    return table([*header, "median skill, unseen meshes", "against the first"], rows)


WAYS = {
    "dense": "32 numbers through the table of 32 x 32 signs, each motor acts by two products",
    "even": "the same with the 16 even blades and the 256 terms between them",
    "network": "as the network does it: products of a motor's numbers are summed over the neighbours first",
}


def versor_speed(result: dict[str, Any]) -> str:
    """One prediction of `versor` by three ways of multiplying."""
    arguments, fastest = result["arguments"], result["rows"][-1]["seconds"]
    rows = [
        [
            WAYS[row["way"]],
            f"{row['seconds'] / arguments['vertices'] * 1e6:.1f}",
            f"{row['seconds'] / fastest:.1f}",
            f"{row['difference']:.0e}",
        ]
        for row in result["rows"]
    ]
    found = table(["way", "us a vertex", "times the last", "difference to the last"], rows)
    said = f"{arguments['vertices']} vertices, medians of {arguments['repeats']}; differences over the largest number"
    return f"{found}\n\n{said}. {origin(result)}."
