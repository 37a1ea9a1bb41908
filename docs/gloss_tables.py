"""The tables of gloss, from docs/results/gloss.json."""

from typing import Any

import numpy as np

from docs.baking_tables import origin
from docs.local_tables import table

ANGLES = (0, 45, 75)
DEGREES = [f"{angle} degrees" for angle in ANGLES]


def _median(rows: list[dict[str, Any]], key: str) -> float:
    return float(np.median([row[key] for row in rows]))


def integral_table(result: dict[str, Any]) -> str:
    """z-scores of shading against quadrature of the band-limited integral."""
    rows = []
    for mesh in dict.fromkeys(row["mesh"] for row in result["integral"]):
        own = [row for row in result["integral"] if row["mesh"] == mesh]
        cells = []
        for angle in ANGLES:
            scores = [row["score"] for row in own if row["angle"] == angle]
            cells.append(f"{min(scores):.2f} to {max(scores):.2f}")
        rows.append([mesh, *cells])
    lobes = ", ".join(dict.fromkeys(row["lobe"] for row in result["integral"]))
    note = (
        f"rms z-score of the mean of {result['seeds']} bakes of 256 rays, {result['vertices']} vertices a mesh, least "
        f"and largest of four lobes ({lobes}); quadrature by {result['rays']} rays; {origin(result)}, seed "
        f"{result['seed']}."
    )
    return f"{table(['mesh', *DEGREES], rows)}\n\n{note}"


def bands_table(result: dict[str, Any]) -> str:
    """What the cut to bands costs, by lobe and view angle."""
    bands = [key for key in result["bands"][0] if key.isdigit()]
    header, rows = ["lobe", "view angle", *(f"{count} bands" for count in bands), "8, Hann", "rays"], []
    for lobe in dict.fromkeys(row["lobe"] for row in result["bands"]):
        for angle in ANGLES:
            own = [row for row in result["bands"] if (row["lobe"], row["angle"]) == (lobe, angle)]
            cells = [f"{_median(own, count):.3f}" for count in (*bands, "windowed")]
            rows.append([lobe, str(angle), *cells, f"{_median(own, 'dense_error'):.3f}"])
    note = (
        "relrmse of radiance against the whole lobe or the microfacets, the light's own map and dense rays; median of "
        f"five meshes, {result['vertices']} vertices each. *8, Hann*: the light windowed to vanish at l = 10; *rays*: "
        f"standard error of the reference. {origin(result)}, seed {result['seed']}."
    )
    return f"{table(header, rows)}\n\n{note}"


def brute_force_table(result: dict[str, Any]) -> str:
    """The same cut against every ray on every triangle, and how far Embree's rays are from those."""
    bands = [key for key in result["rows"][0] if key.isdigit()]
    rows = []
    for row in result["rows"]:
        cells = [f"{row[count]:.3f}" for count in bands]
        rows.append([row["lobe"], str(row["angle"]), *cells, f"{row['dense_error']:.3f}", f"{row['apart']:.2g}"])
    note = (
        f"relrmse on {result['vertices']} vertices of a body of {result['faces']} faces, {result['rays']} rays each; "
        f"*Embree*: how far the radiance by its rays is from that by brute force, where {result['rays_apart']:.2g} of "
        f"the rays are answered differently. {origin(result)}, seed {result['seed']}."
    )
    header = ["lobe", "view angle", *(f"{count} bands" for count in bands), "rays", "Embree"]
    return f"{table(header, rows)}\n\n{note}"


def ggx_table(result: dict[str, Any]) -> str:
    """The fitted lobe of GGX against the microfacets."""
    rows = [[f"{row['roughness']:g}", *(f"{row[str(angle)]:.2f}" for angle in ANGLES)] for row in result["ggx"]]
    note = "Relative L2 over the hemisphere of the lobe against f (n.w), both with integral 1, no bands cut."
    return f"{table(['roughness', *DEGREES], rows)}\n\n{note} {origin(result)}."


def eigenvalue_table(result: dict[str, Any]) -> str:
    """Extreme eigenvalues of the plain estimate."""
    rows = []
    for rays in dict.fromkeys(row["rays"] for row in result["eigenvalues"]):
        own = [row for row in result["eigenvalues"] if row["rays"] == rays]
        largest = [row["largest"] for row in own]
        span = f"{min(largest):.4f} to {max(largest):.4f}"
        rows.append([str(rays), f"{min(row['least'] for row in own):.1e}", span])
    found = table(["rays", "least eigenvalue", "largest: over the meshes"], rows)
    return f"{found}\n\nAll vertices of five meshes, 4 bands, float16; {origin(result)}."


def components_table(result: dict[str, Any]) -> str:
    """Bytes against error of compressed visibility."""
    header = [
        "bands",
        "components",
        "bytes a vertex",
        "of the whole",
        "relrmse in the vertices' frames",
        "in the world",
    ]
    rows = []
    for bands, count in dict.fromkeys((row["bands"], row["components"]) for row in result["components"]):
        own = [row for row in result["components"] if (row["bands"], row["components"]) == (bands, count)]
        share = own[0]["bytes"] / own[0]["whole"]
        errors = [f"{_median(own, name):.3f}" for name in ("local", "world")]
        rows.append([str(bands), str(count), str(own[0]["bytes"]), f"{share:.0%}", *errors])
    note = "Median of five meshes of 2,000 to 3,000 vertices; the components themselves come once a file."
    return f"{table(header, rows)}\n\n{note} {origin(result)}."
