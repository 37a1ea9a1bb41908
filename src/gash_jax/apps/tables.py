"""Tables of speed against error on standard output: methods on one mesh, one model on many meshes."""

from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table

# measure, digits behind the point
SHORT = {"relrmse": 4, "skill": 3, "equivalent_rays": 1}
VISIBILITY = ("accuracy", "balanced_accuracy", "majority_accuracy")


def _cells(row: dict[str, Any]) -> list[str]:
    """The measures of a row; what is undefined says why."""
    values = ((row[key], digits) for key, digits in SHORT.items())
    return [
        f"{value:.{digits}f}" if isinstance(value, float) else str(value if value is not None else "no transfer")
        for value, digits in values
    ]


def _table(first: str, names: Sequence[str]) -> Table:
    table = Table(first, box=box.SIMPLE_HEAD)
    for name in names:
        table.add_column(name, justify="right")
    return table


def print_methods(rows: Sequence[dict[str, Any]]) -> None:
    """One row a method, as `measure_methods` gives them."""
    table = _table("method", ("seconds", "relrmse", "skill", "equivalent rays"))
    for row in rows:
        table.add_row(row["method"], f"{row['seconds']:.3f}", *_cells(row))
    Console(width=100).print(table)


def print_meshes(rows: Sequence[dict[str, Any]]) -> None:
    """One row a mesh, as `evaluate_mesh` gives them; times in microseconds per vertex."""
    seen = VISIBILITY if VISIBILITY[0] in rows[0] else ()
    names = ("vertices", "graph us", "network us", "both, CPU us", "relrmse", "skill", "equivalent rays")
    table = _table("mesh", (*names, *(name.removesuffix("_accuracy") for name in seen)))
    for row in rows:
        spent = (row["graph_us"], row["network_us"], row["graph_cpu_us"] + row["network_cpu_us"])
        times = (f"{value:.2f}" for value in spent)
        table.add_row(row["mesh"], str(row["vertices"]), *times, *_cells(row), *(f"{row[key]:.3f}" for key in seen))
    Console(width=140).print(table)
