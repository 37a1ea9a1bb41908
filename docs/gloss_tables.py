"""The tables of gloss, from docs/results/gloss.json."""

from typing import Any

import numpy as np

from docs.baking_tables import origin

ANGLES = (0, 45, 75)


def _median(rows: list[dict[str, Any]], key: str) -> float:
    return float(np.median([row[key] for row in rows]))


def integral_table(result: dict[str, Any]) -> str:
    """z-scores of shading against quadrature of the band-limited integral."""
    lines = ["| mesh | " + " | ".join(f"{angle} degrees" for angle in ANGLES) + " |", "|---|" + "--:|" * len(ANGLES)]
    for mesh in dict.fromkeys(row["mesh"] for row in result["integral"]):
        own = [row for row in result["integral"] if row["mesh"] == mesh]
        cells = []
        for angle in ANGLES:
            scores = [row["score"] for row in own if row["angle"] == angle]
            cells.append(f"{min(scores):.2f} to {max(scores):.2f}")
        lines.append(f"| {mesh} | {' | '.join(cells)} |")
    lobes = ", ".join(dict.fromkeys(row["lobe"] for row in result["integral"]))
    note = (
        f"rms z-score of the mean of {result['seeds']} bakes of 256 rays, {result['vertices']} vertices a mesh, least "
        f"and largest of four lobes ({lobes}); quadrature by {result['rays']} rays; {origin(result)}, seed "
        f"{result['seed']}."
    )
    return "\n".join([*lines, "", note])


def bands_table(result: dict[str, Any]) -> str:
    """What the cut to bands costs, by lobe and view angle."""
    bands = [key for key in result["bands"][0] if key.isdigit()]
    lines = [
        "| lobe | view angle | " + " | ".join(f"{count} bands" for count in bands) + " | 8, Hann | rays |",
        "|---|--:|" + "--:|" * (len(bands) + 2),
    ]
    for lobe in dict.fromkeys(row["lobe"] for row in result["bands"]):
        for angle in ANGLES:
            own = [row for row in result["bands"] if (row["lobe"], row["angle"]) == (lobe, angle)]
            cells = [f"{_median(own, count):.3f}" for count in (*bands, "windowed")]
            lines.append(f"| {lobe} | {angle} | {' | '.join(cells)} | {_median(own, 'dense_error'):.3f} |")
    note = (
        "relrmse of radiance against the whole lobe or the microfacets, the light's own map and dense rays; median of "
        f"five meshes, {result['vertices']} vertices each. *8, Hann*: the light windowed to vanish at l = 10; *rays*: "
        f"standard error of the reference. {origin(result)}, seed {result['seed']}."
    )
    return "\n".join([*lines, "", note])


def ggx_table(result: dict[str, Any]) -> str:
    """The fitted lobe of GGX against the microfacets."""
    lines = ["| roughness | " + " | ".join(f"{angle} degrees" for angle in ANGLES) + " |", "|--:|" + "--:|" * 3]
    for row in result["ggx"]:
        lines.append(f"| {row['roughness']:g} | " + " | ".join(f"{row[str(angle)]:.2f}" for angle in ANGLES) + " |")
    note = "Relative L2 over the hemisphere of the lobe against f (n.w), both with integral 1, no bands cut."
    return "\n".join([*lines, "", f"{note} {origin(result)}."])


def eigenvalue_table(result: dict[str, Any]) -> str:
    """Extreme eigenvalues of the plain estimate."""
    lines = ["| rays | least eigenvalue | largest: over the meshes |", "|--:|--:|--:|"]
    for rays in dict.fromkeys(row["rays"] for row in result["eigenvalues"]):
        own = [row for row in result["eigenvalues"] if row["rays"] == rays]
        largest = [row["largest"] for row in own]
        lines.append(f"| {rays} | {min(row['least'] for row in own):.1e} | {min(largest):.4f} to {max(largest):.4f} |")
    return "\n".join([*lines, "", f"All vertices of five meshes, 4 bands, float16; {origin(result)}."])


def components_table(result: dict[str, Any]) -> str:
    """Bytes against error of compressed visibility."""
    lines = [
        "| bands | components | bytes a vertex | of the whole | relrmse in the vertices' frames | in the world |",
        "|--:|--:|--:|--:|--:|--:|",
    ]
    for bands, count in dict.fromkeys((row["bands"], row["components"]) for row in result["components"]):
        own = [row for row in result["components"] if (row["bands"], row["components"]) == (bands, count)]
        share = own[0]["bytes"] / own[0]["whole"]
        cells = f"{_median(own, 'local'):.3f} | {_median(own, 'world'):.3f}"
        lines.append(f"| {bands} | {count} | {own[0]['bytes']} | {share:.0%} | {cells} |")
    note = "Median of five meshes of 2,000 to 3,000 vertices; the components themselves come once a file."
    return "\n".join([*lines, "", f"{note} {origin(result)}."])
