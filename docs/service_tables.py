"""The tables of docs/service.md, from what benchmarks/service.py wrote."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table

STAGES = ("read", "wait", "check", "graph", "network", "transfer")


def latency_table(result: dict[str, Any]) -> str:
    """New meshes and poses of held ones by stage, beside the prediction in one process and the paper's end to end."""
    header = ["request", "vertices", *STAGES, "in total", "`Model.predict`", "paper: its mesh"]
    rows = []
    for row in result["rows"]:
        paper = f"{row['paper_ms']:.0f}: {row['paper_mesh']}, {row['paper_vertices']}"
        for kind, name in (("new", "new mesh"), ("pose", "pose")):
            found = row[kind]
            cells = [name, str(row["vertices"]), *(f"{found[stage]:.1f}" for stage in STAGES), f"{found['total']:.1f}"]
            rows.append([*cells, *([f"{row['predict']:.1f}", paper] if kind == "new" else ["", ""])])
    told = f"Milliseconds, medians of {result['arguments']['repeats']}, model `{result['arguments']['model']}`"
    return f"{table(header, rows)}\n\n{told}; {origin(result)}."


def load_table(result: dict[str, Any]) -> str:
    """What became of the requests, and the memory of the service."""
    found = result["load"]
    header = [
        "clients",
        "requests",
        "answered right",
        "refused",
        "cut off",
        "lost",
        "seconds",
        "MiB after a tenth, at the end",
    ]
    names = ("clients", "requests", "answered", "refused", "cut off", "lost")
    memory = f"{found['memory_mib'][0]:.0f}, {found['memory_mib'][-1]:.0f}"
    row = [*(str(found[name]) for name in names), f"{found['seconds']:.0f}", memory]
    told = f"Meshes and poses of {found['vertices']} vertices, one request in ten malformed or cut off in its body"
    return f"{table(header, [row])}\n\n{told}; {origin(result)}."
