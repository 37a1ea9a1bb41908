"""The results page docs/results.md, made whole from what the experiments wrote.

Its words are those of docs/results_text.md; its numbers those of docs/results/*.json, experiments/latent_depth and
experiments/cga.
"""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from docs import trial_tables
from docs.baking_tables import origin
from docs.cga_table import encodings, versor_speed
from docs.conclusions import beaten, conclusions, median_rays
from docs.local_page import NEEDED, read_result, sections
from docs.local_tables import table as _table
from docs.method_names import key_of_names, method_name
from docs.paper_statements import statements
from experiments.neural_gash.linear import LinearMap
from experiments.neural_gash.variants import LONG, READING, RUNS

ROOT = Path(__file__).parents[1]

# the papers' own numbers: Tables 3 and 5 of the GNN paper (vertices, PRT s, network ms)
PAPER = {
    "Coolseal": (9673, 417.5, 146.5),
    "Bipolar": (3808, 151.9, 68.1),
    "Focus": (8534, 369.3, 121.9),
    "Brain": (21966, 1051.5, 271.3),
    "Heart": (29661, 1619.2, 2730.3),
    "Anatomy": (33995, 1908.6, 4886.8),
}


def _median(values: list[Any], digits: int) -> str:
    numbers = [value for value in values if isinstance(value, float)]
    return f"{np.median(numbers):.{digits}f}" if numbers else "-"


def _methods(result: dict[str, Any]) -> list[str]:
    """What the tables show in full: of runs and linear maps those in their reading."""
    elsewhere = {name for name, run in RUNS.items() if not run.shown}
    linear, kept = LinearMap.name_of(*READING), result["rows"][0]["methods"]
    return [name for name in kept if name not in elsewhere and (name == linear or not name.startswith("linear"))]


def _column(result: dict[str, Any], method: str, key: str) -> list[Any]:
    return [row["methods"][method].get(key) for row in result["rows"]]


def summary(result: dict[str, Any]) -> str:
    """One row a method: medians over meshes."""
    rows = []
    for method in _methods(result):
        skills = [value for value in _column(result, method, "skill") if isinstance(value, float)]
        cells = [
            method_name(method),
            _median(skills, 3),
            f"{min(skills):.2f}",
            _median(_column(result, method, "relrmse"), 4),
        ]
        cells += [median_rays(_column(result, method, "equivalent_rays"))]
        cells += [_median(_column(result, method, key), 2) for key in ("graph_us", "network_us")]
        rows.append([*cells, beaten(result, method)])
    header = ["method", "median skill", "worst", "relrmse", "equivalent rays", "graph us", "network us", "bake wins"]
    return _table(header, rows)


def per_mesh(result: dict[str, Any]) -> str:
    """Skill of every model on every mesh."""
    models = [name for name in _methods(result) if "graph_us" in result["rows"][0]["methods"][name]]
    rows = []
    for row in result["rows"]:
        skills = [row["methods"][name]["skill"] for name in models]
        cells = [f"{skill:.2f}" if isinstance(skill, float) else skill for skill in skills]
        rows.append([row["mesh"], str(row["vertices"]), *cells])
    return _table(["mesh", "vertices", *map(method_name, models)], rows)


def visibility(result: dict[str, Any]) -> str:
    """Stage 1 of the two-stage networks (the paper's Figure 11)."""
    models = [n for n in _methods(result) if "balanced_accuracy" in result["rows"][0]["methods"][n]]
    rows = []
    for row in result["rows"]:
        cells = [f"{row['methods'][models[0]]['majority_accuracy']:.3f}"] if models else []
        for name in models:
            cells += [f"{row['methods'][name][key]:.3f}" for key in ("accuracy", "balanced_accuracy")]
        rows.append([row["mesh"], *cells])
    header = [
        "mesh",
        "majority class",
        *(f"{method_name(name)}: {key}" for name in models for key in ("accuracy", "balanced")),
    ]
    return _table(header, rows) if models else ""


def coefficients(result: dict[str, Any]) -> str:
    """MSE and standard deviation of each coefficient, medians over meshes (the paper's Figures 9 and 10)."""
    models = [name for name in _methods(result) if "graph_us" in result["rows"][0]["methods"][name]]
    rows = []
    for name in ["closed form", *models]:
        for key, label in (("mse_per_coefficient", "MSE"), ("std", "std")):
            values = np.median(np.array(_column(result, name, key)), axis=0)
            rows.append([f"{method_name(name)}: {label}", *(f"{value:.1e}" for value in values)])
    return _table(["1-based index", *(str(i + 1) for i in range(9))], rows)


def latency(result: dict[str, Any]) -> str:
    """Tables 3 and 5 rebuilt: seconds of the bake, milliseconds of the network by stage, and of its twin in PyG."""
    rows = [
        [f"{name} (paper)", str(vertices), f"{bake:.1f}", "", "", "", "", f"{total:.0f}", "", ""]
        for name, (vertices, bake, total) in PAPER.items()
    ]
    for row in result["rows"]:
        times = [1000 * row[key] for key in ("graph", "stage1", "stage2", "ambient")]
        cells = [f"{row['bake']:.2f}", *(f"{time:.1f}" for time in times), f"{sum(times):.0f}"]
        ratio = ["-", "-"]
        if row["pyg"] is not None:
            ratio = [f"{1000 * row['pyg']:.0f}", f"{row['pyg'] / (row['stage1'] + row['stage2']):.1f}"]
        rows.append([row["mesh"], str(row["vertices"]), *cells, *ratio])
    stages = ["graph ms", "stage 1 ms", "stage 2 ms", "AO ms", "total ms"]
    return _table(["mesh", "vertices", "bake s", *stages, "PyG networks ms", "PyG / ours"], rows)


def moving_scene(result: dict[str, Any]) -> str:
    """The scene with a moving object under three lights."""
    rows = []
    for name, row in result["rows"].items():
        cells = [f"{row['skill']:.3f}", f"{row['flicker']:.4f}"]
        for light in ("dark", "normal", "bright"):
            cells += [f"{row[light]['psnr']:.1f}", f"{row[light]['ssim']:.3f}"]
        rows.append([method_name(name), *cells])
    lights = [f"{light} {key}" for light in ("dark", "normal", "bright") for key in ("PSNR", "SSIM")]
    return _table(["method", "skill", "flicker", *lights], rows)


def sweep(path: Path) -> str:
    """The finished sweep, its CSV as a table."""
    with open(path, newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))

    def spread(line: dict[str, str], key: str, digits: int) -> str:
        deviation = f" ± {float(line[f'{key}_std']):.{digits}f}" if line[f"{key}_std"] else ""
        return f"{float(line[key]):.{digits}f}{deviation}"

    rows = [
        [
            *(line["latent"], line["depth"], line["parameters"], f"{float(line['us_per_vertex']):.1f}"),
            *(spread(line, "relrmse", 3), spread(line, "skill", 2), line["seeds"]),
        ]
        for line in lines
    ]
    return _table(["latent", "depth", "parameters", "us per vertex", "relrmse", "skill", "seeds"], rows)


def renewed(result: dict[str, Any]) -> str:
    """Where rows come from that were measured after the others."""
    by_origin: dict[str, list[str]] = {}
    for name, entry in result.get("renewed", {}).items():
        by_origin.setdefault(origin(entry), []).append(method_name(name))
    return "".join(f" Measured later: {'; '.join(names)}: {where}." for where, names in by_origin.items())


def trained_at(result: dict[str, Any]) -> str:
    """The commits of the runs of a sweep."""
    return ", ".join(sorted({row["commit"] for row in result["rows"]}))


def _long() -> str:
    """The longer budgets, as a phrase."""
    return " and ".join(f"{seconds / 60:.0f} minutes ({method_name(name)})" for name, seconds in LONG.items())


def page(results: dict[str, dict[str, Any]], sweep_file: Path) -> str:
    """The whole document."""
    text = (Path(__file__).parent / "results_text.md").read_text(encoding="utf-8")
    result, times, scene = (results[name] for name in ("neural_gash", "latency", "scene"))
    tables = {
        "CONCLUSIONS": conclusions(results),
        "NAMES": key_of_names(),
        "LONG": _long(),
        "SUMMARY": summary(result),
        "READINGS": trial_tables.readings(result),
        "TOLD": trial_tables.told(result),
        "STATEMENTS": statements(result),
        "MESHES": per_mesh(result),
        "VISIBILITY": visibility(result),
        "COEFFICIENTS": coefficients(result),
        "LATENCY": latency(times),
        "SCENE": moving_scene(scene),
        "SWEEP": sweep(sweep_file),
        "ENCODINGS": encodings(results["cga"]),
        "VERSOR SPEED": versor_speed(results["versor_speed"]),
        "CGA": f"{origin(results['cga'])}; trained at commit {trained_at(results['cga'])}.",
        "TIMES": f"{origin(times)}.",
        "ORIGIN": f"{origin(result)}, seed 0; reference {result['arguments']['rays']} rays per vertex."
        + renewed(result),
        **sections(results),
    }
    for name, table in tables.items():
        text = text.replace(f"<!-- {name} -->", table)
    return text


RESULTS = ("neural_gash", "latency", "scene", *NEEDED, "calibration", "error_target", "versor_speed")


def committed_results() -> dict[str, dict[str, Any]]:
    """The results that are committed, by name. Raises ValueError, with what to run, where some are missing."""
    results = {name: read_result(name) for name in RESULTS}
    return results | {"cga": json.loads((ROOT / "experiments" / "cga" / "results.json").read_text())}


def committed_page() -> str:
    """The document of the results that are committed."""
    return page(committed_results(), ROOT / "experiments" / "latent_depth" / "results.csv")
