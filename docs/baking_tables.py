"""The tables of docs/baking.md, each from one results file."""

from typing import Any

import numpy as np

from docs.local_tables import table


def origin(result: dict[str, Any]) -> str:
    """Machine and commit of a result, for the line under its table."""
    machine = result["machine"]
    return f"{machine['processor']}, {machine['cores']} cores, commit {result['commit']}"


def calibration_table(result: dict[str, Any]) -> str:
    """rms z-score and coverage of each closed-form scene, each way to bake."""
    ways = [key for key in result["rows"][0] if key not in ("scene", "less_than_a_ray")]
    rows = []
    for row in result["rows"]:
        cells = [text for way in ways for text in (f"{row[way][0]:.2f}", f"{row[way][1]:.1%}")]
        rows.append([row["scene"] + " *" * row["less_than_a_ray"], *cells])
    found = table(["scene", *(text for way in ways for text in (f"{way}: z", "in 95 %"))], rows)
    note = "* the count of free rays is nearly fixed by symmetry: t_00 is off by less than a ray, the floor is a bound."
    return f"{found}\n\n{note}\n\n{result['samples']} rows a scene; {origin(result)}."


def guided_table(result: dict[str, Any]) -> str:
    """The guided bake over all meshes, and over those of 5000 vertices and more."""
    header = ["rays", "meshes", "MSE / plain: median, largest", "MSE / own rays: median, largest", "z: from, to"]
    rows = []
    for rays in sorted({row["rays"] for row in result["rows"]}):
        for least, which in ((0, "all"), (5000, "5000 vertices and more")):
            part = [row for row in result["rows"] if row["rays"] == rays and row["vertices"] >= least]
            if not part:
                continue
            ratios = [np.array([row["guided"] / row[name] for row in part]) for name in ("plain", "own")]
            scores = [row["score"] for row in part]
            spans = [f"{np.median(ratio):.2f}, {ratio.max():.2f}" for ratio in ratios]
            rows.append([str(rays), f"{len(part)}, {which}", *spans, f"{min(scores):.2f}, {max(scores):.2f}"])
    return f"{table(header, rows)}\n\n{result['seeds']} seeds; {origin(result)}."


def guided_error_table(result: dict[str, Any]) -> str:
    """What the halves of the rays are worth, and how far error over expected error lies apart between shapes."""
    header = ["rays", "shapes", "worth of the halves", "power", "level", "slope", "spread before", "after"]
    rows = [
        [
            str(level["rays"]),
            str(level["shapes"]),
            f"{level['worth']:.2f}",
            f"{level['power']:.2f}",
            f"{level['level']:.2f}",
            f"{level['slope']:.2f}",
            *(f"{np.expm1(level[name]):.0%}" for name in ("spread_before", "spread_after")),
        ]
        for level in result["levels"]
    ]
    return f"{table(header, rows)}\n\n{origin(result)}."


def guided_meshes_table(result: dict[str, Any]) -> str:
    """The guided bake on every mesh, its smallest number of rays and its largest."""
    counts = sorted({row["rays"] for row in result["rows"]})
    header = ["mesh", "vertices", *(f"{n} rays: MSE / plain, / own, z" for n in counts)]
    rows = []
    for name in dict.fromkeys(row["mesh"] for row in result["rows"]):
        part = {row["rays"]: row for row in result["rows"] if row["mesh"] == name}
        cells = [
            f"{row['guided'] / row['plain']:.2f}, {row['guided'] / row['own']:.2f}, {row['score']:.2f}"
            for row in part.values()
        ]
        rows.append([name, str(next(iter(part.values()))["vertices"]), *cells])
    return table(header, rows)


def error_target_table(result: dict[str, Any]) -> str:
    """What each target took and gave, over all meshes, and the worst of each."""
    header = ["target", "meshes", "true / target: median, largest", "rays / plain: median, largest"]
    rows = []
    for error in sorted({row["error"] for row in result["rows"]}, reverse=True):
        part = [row for row in result["rows"] if row["error"] == error]
        true = np.array([row["true"] / error for row in part])
        ratio = np.array([row["ratio"] for row in part])
        plan = np.array([row["planned_rays"] / row["rays"] for row in part])
        worst = part[int(np.argmax(ratio))]["mesh"], part[int(np.argmax(true))]["mesh"]
        spans = [
            f"{np.median(found):.2f}, {found.max():.2f} ({mesh})"
            for found, mesh in ((true, worst[1]), (ratio, worst[0]))
        ]
        rows.append([f"{error:g}", str(len(part)), *spans, f"{plan.min():.2f} to {plan.max():.2f}"])
    found = table([*header, "planned / spent rays"], rows)
    return f"{found}\n\n{origin(result)}, seed {result['seed']}."


def scaling_table(result: dict[str, Any]) -> str:
    """Throughput against raw embreex as a mesh grows."""
    header = ["vertices", "raw embreex, M rays/s", "plain bake, M rays/s", "share", "tracing, s", "scene build, s"]
    rows = []
    for row in result["rows"]:
        values = (row["raw"] / 1e6, row["bake"] / 1e6, row["share"], row["trace_s"], row["build_s"])
        rows.append([str(row["vertices"]), *(f"{value:.2f}" for value in values)])
    note = (
        f"{result['mesh']} subdivided, {result['rays']} rays per vertex. Time grows as vertices^"
        f"{result['exponent']:.2f}. `gash bake --rays 32` of the {rows[-1][0]} vertices: {result['process_s']:.0f} s, "
        f"peak {result['peak_gib']:.2f} GiB. {origin(result)}."
    )
    return f"{table(header, rows)}\n\n{note}"


def paper_table(result: dict[str, Any]) -> str:
    """The GNN paper's Table 1 beside our seconds."""
    header = [
        "vertices: paper, ours",
        "paper: unshadowed, shadowed s",
        "closed form, s",
        "256 rays, s",
        "to 2 % by rays alone, s",
    ]
    rows = []
    for row in result["rows"]:
        pairs = (
            f"{row['paper_vertices']}, {row['vertices']}",
            f"{row['paper_unshadowed_s']:g}, {row['paper_shadowed_s']:g}",
        )
        rows.append([*pairs, f"{row['closed_form_s']:.4f}", f"{row['bake_s']:.2f}", f"{row['error_s']:.2f}"])
    return f"{table(header, rows)}\n\n{origin(result)}."


def algebra_table(result: dict[str, Any]) -> str:
    """R(4,1) products and spherical harmonics beside their competitors, of the same run."""
    count, product = result["count"], result["product"]

    def row(what: str, ours: float, name: str, theirs: float, target: str) -> list[str]:
        rates = [f"{count / seconds / 1e6:.2f} M/s" for seconds in (ours, theirs)]
        return [what, rates[0], name, rates[1], f"{theirs / ours:.2f} x as fast", target]

    rows = [row("R(4,1) product", product["ours_s"], "kingdon, best", product["kingdon_s"], ">= 2")]
    rows.append(row("R(4,1) product", product["ours_s"], "kingdon, whole", product["kingdon_whole_s"], ""))
    for bands in (3, 10):
        own = result[f"bands_{bands}"]
        rows.append(row(f"SH, {bands} bands", own["ours_s"], "sphericart", own["sphericart_s"], ">= 0.5"))
    found = table(["what", "ours", "competitor", "theirs", "ours is", "target"], rows)
    return f"{found}\n\nBatches of {count}; {origin(result)}."
