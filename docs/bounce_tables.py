"""Tables of light that bounces: cavities against their closed form, seconds and memory."""

from typing import Any

from docs.baking_tables import origin
from docs.local_tables import table


def cavity_table(result: dict[str, Any]) -> str:
    """Light in cavities with 0, 1 and 4 bounces beside the closed form, and how honest the error bars are."""
    shown = (0, 1, 4, 8)
    header = ["opening, half-angle", *(f"{n} bounce{'s' * (n != 1)}: baked, closed form" for n in shown)]
    rows = []
    for degrees in sorted({row["degrees"] for row in result["rows"]}):
        own = [row for row in result["rows"] if row["degrees"] == degrees]
        pairs = [
            f"{row['light']:.4f}, {row['closed_form']:.4f}"
            for row in own
            if row["albedo"] == 0.8 and row["bounces"] in shown
        ]
        spans = [(min(row[name] for row in own), max(row[name] for row in own)) for name in ("z", "covered")]
        z, covered = f"{spans[0][0]:.2f} to {spans[0][1]:.2f}", f"{spans[1][0]:.1%} to {spans[1][1]:.1%}"
        worst = max(row["mean"] for row in own)
        rows.append([f"{degrees}°", *pairs, f"{worst:.2%}", z, covered])
    sizes = f"{result['vertices']} vertices, {result['rays']} rays, {result['seeds']} seeds"
    found = table([*header, "mean of the seeds", "z", "in 95 %"], rows)
    return f"{found}\n\n{sizes}; {origin(result)}, seed {result['seed']}."


def mitsuba_table(result: dict[str, Any]) -> str:
    """How far the coefficients are from Mitsuba's, by our rule of what is black and by its own."""
    both = ["difference", "95 %", "constant light"]
    header = ["mesh, vertices", "bounced light", *both, f"by Mitsuba's rule: {both[0]}", *both[1:]]
    rows = []
    for row in result["rows"]:
        cells = []
        for one in (row, row["black"]):
            low, high = (max(one[name], 0.0) for name in ("low", "high"))
            cells += [f"{max(one['difference'], 0.0):.2%}", f"{low:.2%} to {high:.2%}", f"{one['constant']:+.2%}"]
        rows.append([f"{row['mesh']}, {row['vertices']}", f"{row['bounced']:.1%}", *cells])
    sizes = f"{result['bounces']} bounces, albedo {result['albedo']:g}; {result['sampled_vertices']} vertices a mesh"
    rays = f"{result['baked']} rays and {result['rendered']} paths a vertex, twice each"
    found = table(header, rows)
    return f"{found}\n\n{sizes}, {rays}; Mitsuba {result['mitsuba']}; {origin(result)}, seed {result['seed']}."


def bounce_speed_table(result: dict[str, Any]) -> str:
    """What bounces add to the direct bake of the same rays, and the memory of a large bake."""
    header = [
        "mesh, vertices",
        "direct, CPU s",
        "one bounce, all",
        "each further",
        "one in colour, all",
        "each further",
    ]
    rows = []
    for row in result["rows"]:
        ratios = [f"{row[name]:.2f} x" for name in ("first", "further", "first_colour", "further_colour")]
        rows.append([f"{row['mesh']}, {row['vertices']}", f"{row['direct_s']:.2f}", *ratios])
    large = [f"{name} {one['gib']:.2f} GiB in {one['seconds']:.0f} s" for name, one in result["large"].items()]
    vertices = result["large"]["grey"]["vertices"]
    memory = f"Peak memory of {vertices} vertices, {result['rays']} rays, 3 bounces: {', '.join(large)}."
    return f"{table(header, rows)}\n\n{memory} {origin(result)}."
