"""The tables of docs/animation.md, from what experiments/geometry_images wrote."""

from typing import Any

from docs.baking_tables import origin

MAPS = {"harmonic": "harmonic", "stretch": "less stretch"}


def maps_table(result: dict[str, Any]) -> str:
    """What each map reports, whatever the resolution."""
    lines = [
        "| mesh | vertices | map | L2 stretch | smallest face / square | holes filled | edges cut | seams | seconds |",
        "|---|--:|---|--:|--:|--:|--:|--:|--:|",
    ]
    for row in result["rows"]:
        cells = [row["mesh"], row["vertices"], MAPS[row["method"]], f"{row['stretch']:.2f}"]
        cells += [f"{row['smallest_area']:.1e}", row["filled_loops"], row["cut_edges"], row["seams"]]
        lines.append(f"| {' | '.join(map(str, cells))} | {row['seconds']:.1f} |")
    return "\n".join([*lines, "", f"{origin(result)}."])


def round_trip_table(result: dict[str, Any]) -> str:
    """Crowded faces and round trips by resolution."""
    lines = [
        "| mesh | map | texels | faces below a texel | positions: RMS, most / box | transfer: sampled, fitted |",
        "|---|---|--:|--:|--:|--:|",
    ]
    for row in result["rows"]:
        for found in row["sizes"]:
            cells = [row["mesh"], MAPS[row["method"]], f"{found['size']}²", f"{found['below_a_texel']:.1%}"]
            cells.append(f"{found['positions_rms']:.5f}, {found['positions_most']:.4f}")
            cells.append(f"{found['transfer_relrmse']:.3f}, {found['fitted_relrmse']:.3f}")
            lines.append(f"| {' | '.join(cells)} |")
    arguments = result["arguments"]
    told = f"Transfer: relrmse of {arguments['bands']} bands baked with {arguments['rays']} rays; {origin(result)}."
    return "\n".join([*lines, "", told])


def evenness_table(result: dict[str, Any]) -> str:
    """The less stretched map at other weights of small faces."""
    rows = [row for row in result["rows"] if "evenness" in row]
    found = [entry["evenness"] for entry in rows[0]["evenness"]]
    lines = [f"| mesh | {' | '.join(f'{value:g}' for value in found)} |", "|---|" + "--:|" * len(found)]
    for row in rows:
        cells = [f"{entry['transfer_relrmse']:.3f}, {entry['below_a_texel']:.1%}" for entry in row["evenness"]]
        lines.append(f"| {row['mesh']} | {' | '.join(cells)} |")
    size = rows[0]["evenness"][0]["size"]
    return "\n".join([*lines, "", f"relrmse of transfer, and faces below a texel, at {size}²; {origin(result)}."])
