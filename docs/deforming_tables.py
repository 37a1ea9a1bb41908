"""The table of docs/deforming.md, from what experiments/deforming wrote."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table


def _number(row: dict[str, Any], key: str, form: str) -> str:
    return format(row[key], form) if key in row else ""


def deforming_table(result: dict[str, Any]) -> str:
    """Every method on one object."""
    header = ["method", "relrmse", "accuracy", "L1", "skill", "MB", "compression", "ms a frame", "CPU ms", "normals ms"]
    rows = []
    for row in result["rows"]:
        cells = [row["method"], *(_number(row, key, ".4f") for key in ("relrmse", "accuracy", "l1", "skill"))]
        size = row.get("bytes")
        cells += ["", ""] if size is None else [f"{size / 1e6:.1f}", f"{result['coefficient_bytes'] / size:.0f}"]
        rows.append([*cells, *(_number(row, key, ".1f") for key in ("model_ms", "model_cpu_ms", "normals_ms"))])
    asked, seconds = result["arguments"], result["cpu_seconds_a_baked_frame"]
    told = [f"{result['name']}, {result['vertices']} vertices, {asked['bands']} bands, random sparse expressions."]
    told += [f"{asked['frames']} training frames of {asked['rays']} rays, {seconds['training']:.2f} CPU seconds each;"]
    told += [f"{asked['test_frames']} test frames of {asked['test_rays']} rays, {seconds['test']:.1f}."]
    told += ["Compression: the training frames' coefficients in float16 over the model's file, in bytes."]
    told += [f"Seed {result['seed']}; {origin(result)}."]
    return f"{table(header, rows)}\n\n{chr(10).join(told)}"
