"""The table of docs/deforming.md, from what experiments/deforming wrote."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table

# column, key of a row, how it is written
COLUMNS = (
    ("relrmse", "relrmse", ".4f"),
    ("accuracy", "accuracy", ".4f"),
    ("L1", "l1", ".4f"),
    ("skill", "skill", ".4f"),
    ("MB", "megabytes", ".1f"),
    ("compression", "compression", ".0f"),
    ("fit, CPU s", "fit_cpu_seconds", ".0f"),
    ("ms a frame", "model_ms", ".1f"),
    ("CPU ms", "model_cpu_ms", ".1f"),
    ("normals ms", "normals_ms", ".1f"),
)


def deforming_table(result: dict[str, Any]) -> str:
    """Every method on one object; of the columns those that the result has."""
    rows = [dict(row) for row in result["rows"]]
    for row in rows:
        if "bytes" in row:
            row |= {"megabytes": row["bytes"] / 1e6, "compression": result["coefficient_bytes"] / row["bytes"]}
    shown = [column for column in COLUMNS if any(column[1] in row for row in rows)]
    lines = [[row["method"], *(format(row[key], form) if key in row else "" for _, key, form in shown)] for row in rows]
    asked, seconds = result["arguments"], result["cpu_seconds_a_baked_frame"]
    told = [f"{result['name']}, {result['vertices']} vertices, {asked['bands']} bands, random sparse expressions."]
    told += [f"{asked['frames']} training frames of {asked['rays']} rays, {seconds['training']:.2f} CPU seconds each;"]
    told += [f"{asked['test_frames']} test frames of {asked['test_rays']} rays, {seconds['test']:.1f}."]
    told += ["Compression: the training frames' coefficients in float16 over the model's file, in bytes."]
    told += [f"Seed {result['seed']}; {origin(result)}."]
    table_of = table(["method", *(name for name, _, _ in shown)], lines)
    return "\n".join([table_of, "", *told])
