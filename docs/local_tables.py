"""Tables of the results page that are about `local` alone, from docs/results/local_{trust,speed}.json."""

from typing import Any

import numpy as np


def table(header: list[str], rows: list[list[str]]) -> str:
    """A Markdown table, numbers to the right."""
    lines = [f"| {' | '.join(header)} |", f"|---{'|--:' * (len(header) - 1)}|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def equivariance(result: dict[str, Any]) -> str:
    """How far the prediction of the moved mesh is from the moved prediction, and what relative motors do."""
    rows = []
    for row in result["equivariance"]:
        cells = [f"{row[key]:.1e}" for key in ("same_rms", "same_max", "rebuilt_rms", "rebuilt_max")]
        rows.append([row["mesh"], *cells, f"{row['rotor']['moved']:.1e}", f"{row['rotor']['turned']:.2f}"])
    header = ["mesh", "same table, RMS", "largest", "rebuilt, RMS", "largest", "motors, mesh moved", "mesh turned"]
    return table(header, rows)


def convex(result: dict[str, Any]) -> str:
    """The largest difference to the closed form on convex bodies, as a sentence."""
    return ", ".join(f"{name} {value:.0e}" for name, value in result["convex"].items())


def calibration(result: dict[str, Any]) -> str:
    """Predicted beside true RMS error: tenths of the vertices by what was said, and meshes."""
    tenths, meshes = result["calibration"]["tenths"], result["calibration"]["meshes"]
    rows = [
        [f"tenth {i + 1} of all vertices", f"{said:.4f}", f"{found:.4f}", f"{said / max(found, 1e-9):.2f}", ""]
        for i, (said, found) in enumerate(zip(tenths["said"], tenths["found"], strict=True))
    ]
    for row in meshes:
        ratio = f"{row['said'] / max(row['found'], 1e-9):.2f}"
        rows.append([row["mesh"], f"{row['said']:.4f}", f"{row['found']:.4f}", ratio, f"{row['rank_correlation']:.2f}"])
    return table(["vertices", "predicted", "true", "predicted / true", "rank correlation"], rows)


def stages(result: dict[str, Any]) -> str:
    """Microseconds a vertex of every stage, beside the two-stage network, its twin and plain bakes."""
    keys = ("graph", "network", "predict", "bake 8", "bake 16", "equivalent rays", "bake of equal error")
    keys = (*keys, "two-stage", "pyg", "ratio")
    lines = [{**row, "ratio": row["pyg"] / row["predict"] if row["pyg"] else None} for row in result["rows"]]
    rows = [[line["mesh"], str(line["vertices"]), *(_number(line.get(key)) for key in keys)] for line in lines]
    medians = []
    for key in keys:
        known = [line[key] for line in lines if isinstance(line.get(key), float)]
        medians.append(_number(float(np.median(known)) if known else None))
    rows.append(["median", "", *medians])
    header = [
        "mesh",
        "vertices",
        "graph",
        "network",
        "predict",
        "bake, 8 rays",
        "bake, 16 rays",
        "`local` is worth rays",
    ]
    return table([*header, "bake of as many", "two-stage networks", "the same in PyG", "PyG / predict"], rows)


def _number(value: Any) -> str:
    return f"{value:.1f}" if isinstance(value, float) else value or "-"


def faster(result: dict[str, Any]) -> str:
    """On how many meshes `local` takes less time than the plain bake of the same error, as a phrase."""
    rows = [row for row in result["rows"] if "bake of equal error" in row]
    wins = sum(row["predict"] < row["bake of equal error"] for row in rows)
    return f"{wins} of {len(rows)}"


def sizes(result: dict[str, Any]) -> str:
    """Time and memory from ten thousand vertices to a million."""
    rows = [
        [
            str(row["vertices"]),
            f"{row['seconds']:.2f}",
            f"{1e6 * row['seconds'] / row['vertices']:.1f}",
            f"{row['peak_mib']:.0f}",
        ]
        for row in result["sizes"]
    ]
    return table(["vertices", "seconds", "us per vertex", "peak MiB of the process"], rows)


def motions(result: dict[str, Any]) -> str:
    """Meshes that deform, one compiled call a frame."""
    rows = []
    for name, row in result["motions"].items():
        cells = [str(row["vertices"]), str(row["frames"]), f"{row['frame_ms']:.1f}", f"{row['us']:.1f}"]
        for method in ("closed form", "plan kept", "plan renewed"):
            cells += [f"{row[method]['skill']:.3f}", f"{row[method]['flicker']:.4f}"]
        rows.append([name, *cells])
    methods = [f"{m}, {key}" for m in ("closed form", "plan kept", "plan renewed") for key in ("skill", "flicker")]
    return table(["motion", "vertices", "frames", "ms a frame", "us per vertex", *methods], rows)
