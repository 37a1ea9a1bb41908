"""The table of docs/deforming.md, from what experiments/deforming wrote."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table

# column, key of a row, how it is written
COLUMNS = (
    ("relrmse", "relrmse", ".4f"),
    ("accuracy", "accuracy", ".4f"),
    ("L1", "l1", ".4f"),
    ("SSIM", "ssim", ".4f"),
    ("skill", "skill", ".4f"),
    ("worth, rays", "equivalent_rays", ".0f"),
    ("flicker", "flicker", ".4f"),
    ("MB", "megabytes", ".1f"),
    ("compression", "compression", ".0f"),
    ("fit, CPU s", "fit_cpu_seconds", ".0f"),
    ("ms a frame", "model_ms", ".1f"),
    ("CPU ms", "model_cpu_ms", ".1f"),
    ("ms from positions", "positions_ms", ".1f"),
    ("a bake as good, ms", "bake_ms", ".0f"),
)


def _cell(row: dict[str, Any], key: str, form: str) -> str:
    value = row.get(key, "")
    return value if isinstance(value, str) else format(value, form)


def _of_frames(result: dict[str, Any], training: int, test: int) -> list[str]:
    """How many frames there were, of how many rays, and what they took."""
    asked, seconds = result["arguments"], result["cpu_seconds_a_baked_frame"]
    more = f"; the others {seconds['more']:.2f}" if "more" in seconds else ""
    return [
        f"{training} training frames of {asked['rays']} rays, {seconds['training']:.2f} CPU seconds each{more};",
        f"{test} test frames of {asked['test_rays']} rays, {seconds['test']:.1f}.",
        f"Seed {result['seed']}; {origin(result)}.",
    ]


def deforming_table(result: dict[str, Any]) -> str:
    """Every method on one object; of the columns those that the result has."""
    rows = [dict(row) for row in result["rows"]]
    for row in rows:
        if "bytes" in row:
            row |= {"megabytes": row["bytes"] / 1e6, "compression": result["coefficient_bytes"] / row["bytes"]}
    shown = [column for column in COLUMNS if any(column[1] in row for row in rows)]
    lines = [[row["method"], *(_cell(row, key, form) for _, key, form in shown)] for row in rows]
    asked = result["arguments"]
    told = [f"{result['name']}, {result['vertices']} vertices, {asked['bands']} bands; {result['poses']}."]
    told += _of_frames(result, asked["frames"], asked["test_frames"])
    table_of = table(["method", *(name for name, _, _ in shown)], lines)
    return "\n".join([table_of, "", *told])


def glossy_table(result: dict[str, Any]) -> str:
    """Models of radiance, and bakes of it."""
    columns = [
        column for column in COLUMNS if column[1] in ("relrmse", "accuracy", "l1", "model_ms", "fit_cpu_seconds")
    ]
    columns.insert(3, ("MB", "megabytes", ".1f"))
    rows = [{**row, **({"megabytes": row["bytes"] / 1e6} if "bytes" in row else {})} for row in result["rows"]]
    lines = [[row["method"], *(_cell(row, key, form) for _, key, form in columns)] for row in rows]
    asked = result["arguments"]
    told = [f"The {result['animation']}, {asked['bands']} bands, light `{asked['light']}`."]
    told += _of_frames(result, result["frames"], result["test_frames"])
    return "\n".join([table(["method", *(name for name, _, _ in columns)], lines), "", *told])


def sizes_table(result: dict[str, Any]) -> str:
    """The U-Net by width, depth and the size of its images."""
    header = ["width", "depth", "images", "parameters", "MB", "steps", "relrmse", "accuracy", "L1", "skill"]
    rows = [
        [str(row["width"]), str(row["depth"]), f"{row['images']}²", str(row["parameters"]), f"{row['bytes'] / 1e6:.1f}"]
        + [str(row["steps"])]
        + [f"{row[name]:.4f}" for name in ("relrmse", "accuracy", "l1", "skill")]
        for row in result["rows"]
    ]
    told = f"{result['arguments']['seconds']:.0f} CPU seconds of a core each; seed {result['seed']}; {origin(result)}."
    return f"{table(header, rows)}\n\n{told}"


def image_step_table(result: dict[str, Any]) -> str:
    """One training step of the U-Net at its shipped sizes."""
    header = ["config", "images", "parameters", "frames", "seconds a step", "GFLOP", "memory, MB", "slope / gradient²"]
    header += [f"loss of the batch, steps 1 to {result['arguments']['steps']}"]
    rows = []
    for row in result["rows"]:
        cells = [f"`{row['config']}`", f"{row['size']}²", str(row["parameters"]), str(row["frames"])]
        cells += [f"{row['seconds']:.2f}", f"{row['flops'] / 1e9:.1f}", f"{row['bytes'] / 1e6:.0f}"]
        cells += [f"{row['slope_over_gradient']:.3f}", ", ".join(f"{loss:.3f}" for loss in row["losses"])]
        rows.append(cells)
    return f"{table(header, rows)}\n\n{origin(result)}, JAX on {result['machine']['device']}, seed {result['seed']}."


def leaving_table(result: dict[str, Any]) -> str:
    """relrmse along both journeys, at five places of each."""
    lines = []
    for name, told in result["journeys"].items():
        places = range(0, len(told["distance"]), max((len(told["distance"]) - 1) // 4, 1))
        told_of = f"{name} ({told['training_frames']} frames)"
        lines.append([f"**{told_of}**, {told['from_to']}", *(f"**{told['distance'][t]:.2g}**" for t in places)])
        lines += [[row["method"], *(f"{row['relrmse'][t]:.3f}" for t in places)] for row in told["rows"]]
    count = len(lines[0]) - 1
    images = f"`deep-prt-small`: {result['arguments']['images']:.0f} CPU seconds of each core for each training. "
    told = f"{images if result['arguments']['images'] else ''}Seed {result['seed']}; {origin(result)}."
    return f"{table(['relrmse', *('' for _ in range(count))], lines)}\n\n{told}"
