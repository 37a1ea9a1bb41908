"""Tables inside documents that are otherwise written by hand, from docs/results/*.json.

Text between <!-- NAME --> and <!-- /NAME --> is replaced; nothing in those tables is typed by hand. The results are
what `gash bench frontier` and the scripts of benchmarks/ and experiments/ write.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from docs import (
    animation_tables,
    baking_tables,
    bounce_tables,
    frontier_tables,
    gloss_tables,
    light_tables,
    rotation_tables,
    runtime_tables,
    service_tables,
    texture_tables,
    trial_tables,
)
from docs.baking_tables import origin
from docs.deforming_tables import (
    deforming_table,
    glossy_table,
    image_step_table,
    leaving_table,
    sizes_table,
)
from docs.model_tables import stage_tables

ROOT = Path(__file__).parents[1]


def speed_table(result: dict[str, Any]) -> str:
    """The bake against raw embreex."""
    raw, build, bake, process = (result[key] for key in ("raw_s", "build_s", "bake_s", "process_s"))
    rows = [
        ("raw embreex, the same rays, scene built before", raw, ""),
        ("embreex scene build", build, ""),
        (
            "`bake_transfer`, scene build included",
            bake,
            f"{bake / raw:.2f} x raw, {bake / (raw + build):.2f} x raw and build",
        ),
        ("`gash bake`, the whole process", process, f"1.6 x raw + {process - 1.6 * raw:.1f} s"),
    ]
    lines = [f"| {result['mesh']}, {result['rays']} rays per vertex | seconds | |", "|---|--:|---|"]
    lines += [f"| {name} | {seconds:.3f} | {remark} |" for name, seconds, remark in rows]
    return "\n".join([*lines, "", f"Peak memory of the process {result['peak_mib']:.0f} MiB; {origin(result)}."])


def start_up_table(result: dict[str, Any]) -> str:
    """Whole processes, the first time and from the second time on."""
    lines = [f"| whole process, {result['mesh']} | first time, seconds | later, seconds |", "|---|--:|--:|"]
    for name, both in result["seconds"].items():
        lines.append(f"| `{name}` | {both['cold']['wall']:.2f} | {both['warm']['wall']:.2f} |")
    return "\n".join([*lines, "", f"Medians of {result['repeats']}; {origin(result)}."])


def hard_cases_table(result: dict[str, Any]) -> str:
    """What was measured in every hard case, against its bound."""
    lines = ["| case | measured | result | bound | because of | what you are told |", "|---|---|--:|--:|---|---|"]
    for row in result["rows"]:
        if isinstance(row["bound"], str):
            measured, told = ["refusal", "" if row["passed"] else "NOT REFUSED", "", ""], f"`error: {row['bound']}`"
        else:
            verdict = "" if row["passed"] else " EXCEEDED"
            measured = [row["measured"], f"{row['value']:.1e}{verdict}", f"{row['bound']:.1e}", row["why"]]
            told = row["told"]
        lines.append(f"| {' | '.join([row['name'], *measured, told])} |")
    return "\n".join([*lines, "", f"{len(result['rows'])} cases; {origin(result)}."])


def corpus_table(result: dict[str, Any]) -> str:
    """How many vertices the shapes have that networks are trained and validated on."""
    lines = ["| corpus | shapes | vertices asked for | vertices made: least, median, most |", "|---|--:|--:|--:|"]
    for row in result["rows"]:
        made = f"{row['least']}, {row['median']:.0f}, {row['most']}"
        lines.append(f"| `{row['config']}` | {row['shapes']} | {' to '.join(map(str, row['asked']))} | {made} |")
    return "\n".join([*lines, "", f"{origin(result)}, seed {result['seed']}."])


class Table(NamedTuple):
    """A marked table: where it stands, its name, what makes it, and from which results."""

    document: str
    name: str
    render: Callable[[dict[str, Any]], str]
    results: str


GUIDED = "../../experiments/guided/results.json"
GUIDED_ERROR = "../../experiments/guided/calibration.json"
ROTATION = "../../experiments/rotation/results.json"
TABLES = (
    Table("README.md", "FRONTIER", frontier_tables.frontier_table, "frontier.json"),
    Table("README.md", "SPEED", speed_table, "bake_speed.json"),
    Table("README.md", "START UP", start_up_table, "start_up.json"),
    Table("README.md", "CORPUS", corpus_table, "corpus_sizes.json"),
    Table("docs/baking.md", "CALIBRATION", baking_tables.calibration_table, "calibration.json"),
    Table("docs/baking.md", "GUIDED", baking_tables.guided_table, GUIDED),
    Table("docs/baking.md", "GUIDED ERROR", baking_tables.guided_error_table, GUIDED_ERROR),
    Table("docs/baking.md", "GUIDED BY MESH", baking_tables.guided_meshes_table, GUIDED),
    Table("docs/baking.md", "ERROR TARGET", baking_tables.error_target_table, "error_target.json"),
    Table("docs/baking.md", "TARGETS", frontier_tables.targets_table, "frontier.json"),
    Table("docs/baking.md", "TARGETS BY MESH", frontier_tables.mesh_targets_table, "frontier.json"),
    Table("docs/baking.md", "FRONTIER", frontier_tables.whole_table, "frontier.json"),
    Table("docs/baking.md", "EQUAL TIME", frontier_tables.equal_time_table, "frontier.json"),
    Table("docs/baking.md", "PAPER", baking_tables.paper_table, "paper_sizes.json"),
    Table("docs/baking.md", "SCALING", baking_tables.scaling_table, "scaling.json"),
    Table("docs/baking.md", "ALGEBRA", baking_tables.algebra_table, "algebra_speed.json"),
    Table("docs/transport.md", "TURN TIMES", rotation_tables.time_table, ROTATION),
    Table("docs/transport.md", "TURN ERRORS", rotation_tables.error_table, ROTATION),
    Table("docs/transport.md", "COMPOSITIONS", rotation_tables.composition_table, ROTATION),
    Table("docs/transport.md", "TURNED ERROR BARS", rotation_tables.error_bar_table, ROTATION),
    Table("docs/transport.md", "CAVITY", bounce_tables.cavity_table, "interreflection.json"),
    Table("docs/transport.md", "MITSUBA", bounce_tables.mitsuba_table, "against_mitsuba.json"),
    Table("docs/transport.md", "BOUNCE SPEED", bounce_tables.bounce_speed_table, "bounce_speed.json"),
    Table("docs/transport.md", "GLOSS INTEGRAL", gloss_tables.integral_table, "gloss.json"),
    Table("docs/transport.md", "GLOSS BANDS", gloss_tables.bands_table, "gloss.json"),
    Table("docs/transport.md", "GLOSS BRUTE FORCE", gloss_tables.brute_force_table, "gloss_brute_force.json"),
    Table("docs/transport.md", "GLOSS GGX", gloss_tables.ggx_table, "gloss.json"),
    Table("docs/transport.md", "GLOSS EIGENVALUES", gloss_tables.eigenvalue_table, "gloss.json"),
    Table("docs/transport.md", "GLOSS COMPONENTS", gloss_tables.components_table, "gloss.json"),
    Table("docs/light.md", "MAP SIZES", light_tables.map_sizes_table, "map_sizes.json"),
    Table("docs/light.md", "WINDOWS", light_tables.kept_table, "windows.json"),
    Table("docs/light.md", "WINDOWS ON MESHES", light_tables.shaded_table, "windows.json"),
    Table("docs/light.md", "FEWER NUMBERS", light_tables.fewer_numbers_table, "fewer_numbers.json"),
    Table("docs/animation.md", "MAPS", animation_tables.maps_table, "geometry_images.json"),
    Table("docs/animation.md", "ROUND TRIPS", animation_tables.round_trip_table, "geometry_images.json"),
    Table("docs/animation.md", "EVENNESS", animation_tables.evenness_table, "geometry_images.json"),
    Table("docs/choices.md", "READINGS", trial_tables.validation, "readings.json"),
    Table("docs/choices.md", "LINEAR", trial_tables.linear, "linear_stage.json"),
    Table("docs/service.md", "SERVICE LATENCY", service_tables.latency_table, "service.json"),
    Table("docs/service.md", "SERVICE LOAD", service_tables.load_table, "service.json"),
    Table("docs/light.md", "TEXTURES", texture_tables.texture_table, "textures.json"),
    *(
        Table("docs/deforming.md", f"DEFORMING {name.upper()}", deforming_table, f"deforming_{name}.json")
        for name in ("face", "cloth", "figure", "walk")
    ),
    Table("docs/deforming.md", "LEAVING", leaving_table, "leaving.json"),
    Table("docs/deforming.md", "GLOSSY", glossy_table, "deforming_glossy.json"),
    Table("docs/deforming.md", "SIZES", sizes_table, "deforming_sizes.json"),
    Table("docs/deforming.md", "IMAGE STEP", image_step_table, "image_step.json"),
    Table("docs/hard_cases.md", "HARD CASES", hard_cases_table, "hard_cases.json"),
    Table("docs/model_file.md", "RUNTIMES", runtime_tables.runtime_table, "runtimes.json"),
    *(Table("docs/model_file.md", name, render, "model_example.json") for name, render in stage_tables()),
)


def fill(text: str, name: str, table: str) -> str:
    """The text with the table between its markers; ValueError unless these stand there once."""
    block = f"<!-- {name} -->\n{table}\n<!-- /{name} -->"
    text, count = re.subn(f"<!-- {name} -->.*?<!-- /{name} -->", lambda _: block, text, flags=re.DOTALL)
    if count != 1:
        raise ValueError(f"the markers of table {name} must stand in the document once, not {count} times")
    return text


def documents(root: Path = ROOT) -> dict[str, str]:
    """Every document with its tables as the results have them."""
    texts: dict[str, str] = {}
    for table in TABLES:
        result = json.loads((root / "docs" / "results" / table.results).read_text(encoding="utf-8"))
        text = texts.get(table.document) or (root / table.document).read_text(encoding="utf-8")
        texts[table.document] = fill(text, table.name, table.render(result))
    return texts
