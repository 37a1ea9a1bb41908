"""The tables of docs/animation.md, from what experiments/geometry_images wrote."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table

MAPS = {"harmonic": "harmonic", "stretch": "less stretch"}


def maps_table(result: dict[str, Any]) -> str:
    """What each map reports, whatever the resolution."""
    header = ["mesh", "map", "vertices", "L2 stretch", "smallest face / square", "holes filled", "edges cut", "seams"]
    rows = []
    for row in result["rows"]:
        cells = [row["mesh"], MAPS[row["method"]], row["vertices"], f"{row['stretch']:.2f}"]
        cells += [f"{row['smallest_area']:.1e}", row["filled_loops"], row["cut_edges"], row["seams"]]
        rows.append([*map(str, cells), f"{row['seconds']:.1f}"])
    return f"{table([*header, 'seconds'], rows)}\n\n{origin(result)}."


def round_trip_table(result: dict[str, Any]) -> str:
    """Crowded faces and round trips by resolution."""
    header = ["mesh", "map", "texels", "faces below a texel", "positions: RMS, most / box", "transfer: sampled, fitted"]
    rows = []
    for row in result["rows"]:
        for found in row["sizes"]:
            cells = [row["mesh"], MAPS[row["method"]], f"{found['size']}²", f"{found['below_a_texel']:.1%}"]
            cells.append(f"{found['positions_rms']:.5f}, {found['positions_most']:.4f}")
            cells.append(f"{found['transfer_relrmse']:.3f}, {found['fitted_relrmse']:.3f}")
            rows.append(cells)
    arguments = result["arguments"]
    told = f"Transfer: relrmse of {arguments['bands']} bands baked with {arguments['rays']} rays; {origin(result)}."
    return f"{table(header, rows)}\n\n{told}"


def evenness_table(result: dict[str, Any]) -> str:
    """The less stretched map at other weights of small faces."""
    rows = [row for row in result["rows"] if "evenness" in row]
    found = [entry["evenness"] for entry in rows[0]["evenness"]]
    lines = []
    for row in rows:
        cells = [f"{entry['transfer_relrmse']:.3f}, {entry['below_a_texel']:.1%}" for entry in row["evenness"]]
        lines.append([row["mesh"], *cells])
    size = rows[0]["evenness"][0]["size"]
    note = f"relrmse of transfer, and faces below a texel, at {size}²; {origin(result)}."
    return f"{table(['mesh', *(f'{value:g}' for value in found)], lines)}\n\n{note}"
