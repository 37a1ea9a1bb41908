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


def print_pooled(pool: dict[str, Any]) -> None:
    """One row a setting, as `measure.frontier.pooled` gives them; a star marks the Pareto front."""
    shown = any("psnr" in row for row in pool["rows"])
    names = ("ms per 1000 vertices", "without set-up", "relrmse", "equivalent rays", *("PSNR",) * shown, "front")
    table = _table("method", ("setting", *names))
    for row in sorted(pool["rows"], key=lambda row: row["seconds"]):
        times = (f"{1e3 * row[key]:.2f}" for key in ("seconds", "seconds_without_set_up"))
        rays = row["equivalent_rays"]
        cells = [f"{row['relrmse']:.4f}", f"{rays:.1f}" if isinstance(rays, float) else rays]
        cells += [f"{row['psnr']:.1f}" if "psnr" in row else ""] * shown
        table.add_row(row["label"], row["setting"], *times, *cells, "*" if row["on_front"] else "")
    Console(width=140).print(table)


def print_targets(targets: Sequence[dict[str, Any]]) -> None:
    """Bakes to an error beside the plain bake of the best count, as `measure.best_count.pooled_targets` gives them."""
    names = ("meshes", "true / target: median", "largest", "seconds / best plain: median", "largest")
    table = _table("target", names)
    for row in targets:
        cells = [str(row["compared"])]
        for key in ("error_over_target", "ratio_of_seconds"):
            cells += [f"{row[key][name]:.2f}" if row[key] else "-" for name in ("median", "largest")]
        table.add_row(f"{row['target']:g}", *cells)
    Console(width=140).print(table)
