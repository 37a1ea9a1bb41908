"""The table of runtimes of docs/model_file.md, from what benchmarks/runtimes.py wrote."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table

NAMES = {"jax": "JAX", "onnx": "ONNX Runtime", "numpy": "NumPy"}


def runtime_table(result: dict[str, Any]) -> str:
    """Speed and memory of every network in every runtime; what a runtime does not do or tell apart is left empty."""
    header = ["network", "vertices", "runtime", "file, KiB", "graph", "network alone", "in total", "CPU", "peak MiB"]
    rows = []
    for row in result["rows"]:
        graph, total = row["graph_ms"], row["total_ms"]
        times = {"jax": (graph, total - graph, total), "onnx": (None, total, None), "numpy": (None, None, total)}
        cells = [f"`{row['network']}`", str(row["vertices"]), NAMES[row["runtime"]], f"{row['file_bytes'] / 1024:.0f}"]
        cells += ["" if value is None else f"{value:.1f}" for value in times[row["runtime"]]]
        cells += [f"{row['cpu_ms']:.1f}", f"{row['peak_mib']:.0f}"]
        rows.append([*cells, "" if row["runtime"] == "jax" else f"{row['difference']:.0e}"])
    told = f"Milliseconds, medians of {result['arguments']['repeats']}; {origin(result)}."
    return f"{table([*header, 'from JAX'], rows)}\n\n{told}"
