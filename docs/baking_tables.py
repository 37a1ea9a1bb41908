"""The tables of docs/baking.md, each from one results file."""

from typing import Any

import numpy as np


def origin(result: dict[str, Any]) -> str:
    """Machine and commit of a result, for the line under its table."""
    machine = result["machine"]
    return f"{machine['processor']}, {machine['cores']} cores, commit {result['commit']}"


def calibration_table(result: dict[str, Any]) -> str:
    """rms z-score and coverage of each closed-form scene, each way to bake."""
    ways = [key for key in result["rows"][0] if key not in ("scene", "less_than_a_ray")]
    head = "| scene | " + " | ".join(f"{way}: z | in 95 %" for way in ways) + " |"
    lines = [head, "|---|" + "--:|--:|" * len(ways)]
    for row in result["rows"]:
        cells = [f"{row[way][0]:.2f} | {row[way][1]:.1%}" for way in ways]
        mark = " *" if row["less_than_a_ray"] else ""
        lines.append(f"| {row['scene']}{mark} | {' | '.join(cells)} |")
    note = "* the count of free rays is nearly fixed by symmetry: t_00 is off by less than a ray, the floor is a bound."
    return "\n".join([*lines, "", note, "", f"{result['samples']} rows a scene; {origin(result)}."])


def error_target_table(result: dict[str, Any]) -> str:
    """What each target took and gave, over all meshes, and the worst of each."""
    lines = [
        "| target | meshes | true / target: median, largest | rays / plain: median, largest | planned / spent rays |",
        "|--:|--:|--:|--:|--:|",
    ]
    for error in sorted({row["error"] for row in result["rows"]}, reverse=True):
        part = [row for row in result["rows"] if row["error"] == error]
        true = np.array([row["true"] / error for row in part])
        ratio = np.array([row["ratio"] for row in part])
        plan = np.array([row["planned_rays"] / row["rays"] for row in part])
        worst = part[int(np.argmax(ratio))]["mesh"], part[int(np.argmax(true))]["mesh"]
        lines.append(
            f"| {error:g} | {len(part)} | {np.median(true):.2f}, {true.max():.2f} ({worst[1]}) "
            f"| {np.median(ratio):.2f}, {ratio.max():.2f} ({worst[0]}) | {plan.min():.2f} to {plan.max():.2f} |"
        )
    return "\n".join([*lines, "", f"{origin(result)}, seed {result['seed']}."])


def scaling_table(result: dict[str, Any]) -> str:
    """Throughput against raw embreex as a mesh grows."""
    lines = [
        "| vertices | raw embreex, M rays/s | plain bake, M rays/s | share | tracing, s | scene build, s |",
        "|--:|--:|--:|--:|--:|--:|",
    ]
    for row in result["rows"]:
        lines.append(
            f"| {row['vertices']} | {row['raw'] / 1e6:.2f} | {row['bake'] / 1e6:.2f} | {row['share']:.2f} "
            f"| {row['trace_s']:.2f} | {row['build_s']:.2f} |"
        )
    last = result["rows"][-1]["vertices"]
    return "\n".join(
        [
            *lines,
            "",
            f"{result['mesh']} subdivided, {result['rays']} rays per vertex. Time grows as vertices^"
            f"{result['exponent']:.2f}. `gash bake --rays 32` of the {last} vertices: {result['process_s']:.0f} s, "
            f"peak {result['peak_gib']:.2f} GiB. {origin(result)}.",
        ]
    )


def paper_table(result: dict[str, Any]) -> str:
    """The GNN paper's Table 1 beside our seconds."""
    lines = [
        "| vertices: paper, ours | paper: unshadowed, shadowed s | closed form, s | 256 rays, s | to 2 %, s |",
        "|--:|--:|--:|--:|--:|",
    ]
    for row in result["rows"]:
        paper = f"{row['paper_unshadowed_s']:g}, {row['paper_shadowed_s']:g}"
        lines.append(
            f"| {row['paper_vertices']}, {row['vertices']} | {paper} "
            f"| {row['closed_form_s']:.4f} | {row['bake_s']:.2f} | {row['error_s']:.2f} |"
        )
    return "\n".join([*lines, "", f"{origin(result)}."])


def algebra_table(result: dict[str, Any]) -> str:
    """R(4,1) products and spherical harmonics beside their competitors, of the same run."""
    count, product = result["count"], result["product"]
    lines = ["| what | ours | competitor | theirs | ours is | target |", "|---|--:|---|--:|--:|--:|"]

    def row(what: str, ours: float, name: str, theirs: float, target: str) -> str:
        rates = [f"{count / seconds / 1e6:.2f} M/s" for seconds in (ours, theirs)]
        return f"| {what} | {rates[0]} | {name} | {rates[1]} | {theirs / ours:.2f} x as fast | {target} |"

    lines.append(row("R(4,1) product", product["ours_s"], "kingdon, best", product["kingdon_s"], ">= 2"))
    lines.append(row("R(4,1) product", product["ours_s"], "kingdon, whole", product["kingdon_whole_s"], ""))
    for bands in (3, 10):
        own = result[f"bands_{bands}"]
        lines.append(row(f"SH, {bands} bands", own["ours_s"], "sphericart", own["sphericart_s"], ">= 0.5"))
    return "\n".join([*lines, "", f"Batches of {count}; {origin(result)}."])
