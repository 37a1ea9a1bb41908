"""Tables of the results page that are about `local` alone, from docs/results/local_{trust,speed}.json."""

from typing import Any

import numpy as np

# meshes of which a call of the network is not full, and pays for what is not there
SMALL = 2000


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
    header = ["mesh", "same lists, RMS", "largest", "rebuilt, RMS", "largest", "motors, mesh moved", "mesh turned"]
    return table(header, rows)


def convex(result: dict[str, Any]) -> str:
    """The largest difference to the closed form, and expected error, on convex bodies, as a sentence."""
    bodies = result["convex"].items()
    return ", ".join(f"{name} {of['difference']:.0e} (expected {of['expected']:.0e})" for name, of in bodies)


def continuity(result: dict[str, Any]) -> str:
    """How the error changes from block to block, beside the reference, and between copies of a vertex."""
    keys = ("error", "reference", "quotient", "shifted")
    lines = [{**row, "quotient": _quotient(row["error"], row["reference"])} for row in result["continuity"]]
    rows = [
        [line["mesh"], *(decimals(line[key]) for key in keys), str(line["copies"]), f"{line['seam']:.0e}"]
        for line in lines
    ]
    for name, of in (("median", np.median), ("largest", np.max)):
        known = [[line[key] for line in lines if line[key] is not None] for key in keys]
        rows.append([name, *(decimals(float(of(values)) if values else None) for values in known), "", ""])
    header = ["mesh", "error", "reference", "error / reference", "error, beside shifted blocks"]
    return table([*header, "copies in seams", "largest difference"], rows)


def _quotient(a: float | None, b: float | None) -> float | None:
    return a / b if a is not None and b else None


def tenths(result: dict[str, Any]) -> str:
    """Expected beside true RMS error: tenths of the partly hidden vertices of all meshes by what was expected."""
    both = (result["calibration"]["tenths"][key] for key in ("said", "found"))
    rows = [
        [str(i + 1), f"{said:.4f}", f"{found:.4f}", f"{said / max(found, 1e-9):.2f}"]
        for i, (said, found) in enumerate(zip(*both, strict=True))
    ]
    return table(["tenth", "expected", "true", "expected / true"], rows)


def calibration(result: dict[str, Any]) -> str:
    """Mesh by mesh: expected beside true RMS error, and how many partly hidden vertices the bound holds."""
    rows = []
    for row in result["calibration"]["meshes"]:
        cells = [f"{row['said']:.4f}", f"{row['found']:.4f}", f"{row['partly_hidden']:.0%}"]
        cells += [decimals(row["rank_correlation"]), share(row["inside"])]
        most = row["most_where_unhidden"]
        rows.append([row["mesh"], *cells, "-" if most is None else f"{most:.4f}"])
    header = ["mesh", "expected", "true", "partly hidden", "rank correlation", "inside the bound"]
    return table([*header, "most expected where nothing is hidden"], rows)


def decimals(value: float | None) -> str:
    """Two decimals, or a dash where there is no value."""
    return "-" if value is None else f"{value:.2f}"


def share(value: float | None) -> str:
    """A share in percent, or a dash where there is none."""
    return "-" if value is None else f"{value:.1%}"


def bounded(result: dict[str, Any]) -> str:
    """What the 90 % bound holds of all meshes together, as a sentence."""
    found = result["calibration"]
    if found["bound"] is None:
        return "These weights have no bound."
    shares = [row["inside"] for row in found["meshes"] if row["inside"] is not None]
    return (
        f"The bound is {found['bound']:.2f} times the expected error. It holds {share(found['inside'])} of the partly "
        f"hidden vertices of all meshes, {share(min(shares))} to {share(max(shares))} of those of one mesh."
    )


def stages(result: dict[str, Any]) -> str:
    """Microseconds a vertex of every stage, beside the two-stage network, its twin and plain bakes."""
    keys = ("graph", "network", "predict", "bake 8", "bake 16", "equivalent rays", "bake of equal error")
    keys = (*keys, "two-stage", "pyg", "ratio")
    lines = [{**row, "ratio": row["pyg"] / row["predict"] if row["pyg"] else None} for row in result["rows"]]
    rows = [[line["mesh"], str(line["vertices"]), *(_number(line.get(key)) for key in keys)] for line in lines]
    for name, chosen in _by_size(lines):
        rows.append([f"median of {name}", "", *(_median(chosen, key) for key in keys)])
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


def _by_size(lines: list[dict[str, Any]]) -> list[tuple[str, list[dict[str, Any]]]]:
    """Small meshes apart from the others; of no size that does not occur."""
    sizes = {True: f"fewer than {SMALL} vertices", False: f"{SMALL} vertices or more"}
    parts = [(name, [line for line in lines if (line["vertices"] < SMALL) == small]) for small, name in sizes.items()]
    return [(name, chosen) for name, chosen in parts if chosen]


def _median(lines: list[dict[str, Any]], key: str) -> str:
    known = [line[key] for line in lines if isinstance(line.get(key), float)]
    return _number(float(np.median(known)) if known else None)


def further(result: dict[str, Any]) -> str:
    """Microseconds a vertex of a whole prediction by what is asked for, small meshes apart."""
    keys = {"predict": "as it ships", "all bands": "all bands that it knows", "bounces": "all bounces"}
    rows = [
        [name, str(len(chosen)), *(_median(chosen, key) for key in keys)] for name, chosen in _by_size(result["rows"])
    ]
    return table(["meshes", "how many", *keys.values()], rows)


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
        for method in ("closed form", "plan kept", "plan renewed", "bake, 64 rays"):
            cells += [f"{row[method]['skill']:.3f}", f"{row[method]['flicker']:.4f}"]
        rows.append([name, *cells])
    named = ("closed form", "lists kept", "graph renewed", "bake, 64 rays")
    methods = [f"{m}, {key}" for m in named for key in ("skill", "flicker")]
    return table(["motion", "vertices", "frames", "ms a frame", "us per vertex", *methods], rows)
