"""Tables of what `gash bench frontier` measured: all methods together, and bakes to an error beside the best count."""

from typing import Any

import numpy as np

from docs.baking_tables import origin
from docs.local_tables import table

HEADER = ["method", "setting", "ms per 1000 vertices", "without set-up", "relrmse", "equivalent rays"]


def _pool(result: dict[str, Any]) -> dict[str, Any]:
    """Of meshes that stand still, in light that does not bounce."""
    return next(pool for pool in result["pooled"] if not pool["bounces"] and not pool["moving"])


def _told(result: dict[str, Any]) -> str:
    """What was measured, where, and what could not be."""
    meshes = [mesh for mesh in result["meshes"] if not mesh["bounces"] and not mesh["frames"]]
    sizes = [mesh["vertices"] for mesh in meshes]
    left = ", ".join(dict.fromkeys(name for mesh in meshes for name in mesh["skipped"]))
    arguments = result["arguments"]
    return (
        f"Medians over {len(meshes)} meshes of {min(sizes)} to {max(sizes)} vertices; {arguments['rounds']} rounds, "
        f"reference of {arguments['rays']} rays. {f'Left out: {left}. ' * bool(left)}{origin(result)}, JAX on "
        f"{result['machine']['device']}."
    )


def _table(result: dict[str, Any], rows: list[dict[str, Any]]) -> str:
    shown = any("psnr" in row for row in rows)
    cells = []
    for row in sorted(rows, key=lambda row: row["seconds"]):
        star = "**" if row["on_front"] else ""
        rays = row["equivalent_rays"]
        line = [f"{star}{row['label']}{star}", row["setting"]]
        line += [f"{1e3 * row[key]:.2f}" for key in ("seconds", "seconds_without_set_up")]
        line += [f"{row['relrmse']:.4f}", f"{rays:.1f}" if isinstance(rays, float) else rays]
        cells.append([*line, *[f"{row['psnr']:.1f}" if "psnr" in row else ""] * shown])
    return table([*HEADER, *["PSNR, dB"] * shown], cells)


def frontier_table(result: dict[str, Any]) -> str:
    """What is on the front of all meshes together, and of every other method its most exact setting."""
    rows = _pool(result)["rows"]
    best = {row["method"]: row for row in sorted(rows, key=lambda row: -row["relrmse"])}
    on_front = {row["method"] for row in rows if row["on_front"]}
    shown = [row for row in rows if row["on_front"] or (row is best[row["method"]] and row["method"] not in on_front)]
    return f"{_table(result, shown)}\n\n**Bold**: on the Pareto front. {_told(result)}"


def whole_table(result: dict[str, Any]) -> str:
    """Every setting."""
    return f"{_table(result, _pool(result)['rows'])}\n\n**Bold**: on the Pareto front. {_told(result)}"


def _span(values: dict[str, float] | None) -> str:
    return f"{values['median']:.2f}, {values['largest']:.2f}" if values else "-"


def targets_table(result: dict[str, Any]) -> str:
    """Each target over all meshes."""
    header = ["target", "meshes", "true / target: median, largest", "seconds / best plain: median, largest"]
    header += ["the same without scene build", "the same in CPU seconds"]
    keys = ("error_over_target", "ratio_of_seconds", "ratio_of_seconds_without_set_up", "ratio_of_cpu_seconds")
    rows = [
        [f"{pool['target']:g}", str(pool["compared"]), *(_span(pool[key]) for key in keys)]
        for pool in _pool(result)["targets"]
    ]
    return f"{table(header, rows)}\n\n{_told(result)}"


def mesh_targets_table(result: dict[str, Any]) -> str:
    """Each target on each mesh."""
    header = ["mesh", "vertices", "target", "true error", "rays", "best count", "its error", "seconds / best plain"]
    rows = []
    for mesh in result["meshes"]:
        for entry in mesh["targets"]:
            count = entry["best_count"]
            line = [mesh["mesh"], str(mesh["vertices"]), f"{entry['target']:g}", f"{entry['relrmse']:.4f}"]
            line += [f"{entry['rays']:.1f}", "-" if count is None else str(count)]
            line += (
                ["-", "-"] if count is None else [f"{entry['best_relrmse']:.4f}", f"{entry['ratio_of_seconds']:.2f}"]
            )
            rows.append(line)
    return table(header, rows)


def equal_time_table(result: dict[str, Any]) -> str:
    """`local`, and the guided and the plain bake in the seconds that it takes, scene or graph included."""
    header = ["mesh", "vertices", "`local`: ms per 1000 vertices", "relrmse", "guided bake in that time", "plain bake"]
    header += ["the least"]
    rows = []
    for mesh in result["meshes"]:
        of = {name: [row for row in mesh["rows"] if row["method"] == name] for name in ("local", "guided", "plain")}
        if not of["local"]:
            continue
        local = of["local"][0]
        found = {"`local`": local["relrmse"]}
        seconds = local["seconds"]["median"]
        found |= {name: _in_time(of[name], seconds) for name in ("guided", "plain") if of[name]}
        shown = [f"{found[name]:.4f}" if name in found else "-" for name in ("guided", "plain")]
        line = [
            mesh["mesh"],
            str(mesh["vertices"]),
            f"{1e6 * seconds / mesh['vertices']:.2f}",
            f"{local['relrmse']:.4f}",
        ]
        rows.append([*line, *shown, min(found, key=lambda name: found[name])])
    told = f"{result['arguments']['rounds']} rounds, reference of {result['arguments']['rays']} rays. {origin(result)}."
    return f"{table(header, rows)}\n\n{told}"


def _in_time(rows: list[dict[str, Any]], seconds: float) -> float:
    """The error that a method comes to in so many seconds, between its settings; infinite below the quickest."""
    points = sorted((row["seconds"]["median"], row["relrmse"]) for row in rows)
    times, errors = np.array(points).T
    if seconds < times[0]:
        return float("inf")
    return float(np.exp(np.interp(np.log(seconds), np.log(times), np.log(np.minimum.accumulate(errors)))))
