"""The tables of docs/light.md, from docs/results/{windows,fewer_numbers,map_sizes}.json."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table


def kept_table(result: dict[str, Any]) -> str:
    """What the least windows keep of each light, and what is negative without them."""
    rows = []
    for light, bands in dict.fromkeys((row["light"], row["bands"]) for row in result["kept"]):
        own = {row["window"]: row for row in result["kept"] if (row["light"], row["bands"]) == (light, bands)}
        cells = [f"{own['none'][key]:.2f}" for key in ("radiance", "irradiance")]
        for window in ("irradiance", "radiance"):
            cells.append(f"{own[window]['l=1']:.2f}, {own[window]['l=2']:.2f}")
        cells += [f"{own[window]['radiance']:.2f}" for window in ("hann", "lanczos")]
        rows.append([light, str(bands), *cells])
    header = ["light", "bands", "least radiance", "least irradiance", "`irradiance` keeps", "`radiance` keeps"]
    found = table([*header, "least radiance with `hann`", "with `lanczos`"], rows)
    note = "Least: in any direction and colour, as a share of the mean, without a window. Keeps: of l = 1 and l = 2."
    return f"{found}\n\n{note} {origin(result)}."


def shaded_table(result: dict[str, Any]) -> str:
    """Negative vertices and error of each window on meshes."""
    windows = list(dict.fromkeys(row["window"] for row in result["shaded"]))
    rows = []
    for mesh, light in dict.fromkeys((row["mesh"], row["light"]) for row in result["shaded"]):
        own = {row["window"]: row for row in result["shaded"] if (row["mesh"], row["light"]) == (mesh, light)}
        cells = [f"{own[w]['negative']:.2%}, {own[w]['least']:.2f}, {own[w]['relrmse']:.2f}" for w in windows]
        rows.append([f"{mesh}, {light}", *cells])
    note = (
        "Each cell: vertices that are negative in a colour, the least radiance of any as a share of the light's mean, "
        f"relrmse against ten bands. {result['rays']} rays a vertex; {origin(result)}, seed {result['seed']}."
    )
    return f"{table(['mesh, light', *('none' if w == 'none' else f'`{w}`' for w in windows)], rows)}\n\n{note}"


def fewer_numbers_table(result: dict[str, Any]) -> str:
    """relrmse of shading for every way of storing a transfer or a light."""
    lights, rows = result["lights"], []
    for what, way, size in dict.fromkeys((row["what"], row["way"], row["bytes"]) for row in result["rows"]):
        own = {row["light"]: row for row in result["rows"] if (row["what"], row["way"]) == (what, way)}
        worst = max(own.values(), key=lambda row: row["worst"])
        cells = [f"{own[light]['median']:.4f}" for light in lights]
        rows.append([f"{what}: {way}", str(size), *cells, f"{worst['worst']:.3f} ({worst['mesh']}, {worst['light']})"])
    count = max(row["meshes"] for row in result["rows"])
    note = (
        f"Median of {count} meshes under each light, and the worst of all; bytes of a vertex, or of the whole "
        f"light. {result['rays']} rays a vertex; {origin(result)}, seed {result['seed']}."
    )
    return f"{table(['stored', 'bytes', *lights, 'worst'], rows)}\n\n{note}"


def map_sizes_table(result: dict[str, Any]) -> str:
    """What maps of all sizes take."""
    rows = []
    for row in result["rows"]:
        size = f"{2 * row['height']} x {row['height']}"
        rows.append([size, f"{row['file_mib']:.1f}", f"{row['seconds']:.1f}", f"{row['peak_mib']:.0f}"])
    return f"{table(['map, pixels', 'file, MiB', 'seconds', 'peak memory, MiB'], rows)}\n\n{origin(result)}."
