"""Speed against error: `gash bench` (every method on one mesh) and `gash evaluate` (one model on many meshes)."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from gash_jax.apps.progress import progress_bar, say
from gash_jax.files.atomic import check_writable, write_json
from gash_jax.formats.meshes import read_mesh
from gash_jax.measure.methods import evaluate_mesh, measure_methods
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import make_reference
from gash_jax.models.model import Model, load_model

SHORT = ("relrmse", "skill", "equivalent_rays")


def _cell(value: Any, digits: int) -> str:
    return f"{value:.{digits}f}" if isinstance(value, float) else str(value if value is not None else "no transfer")


def print_methods(rows: Sequence[dict[str, Any]]) -> None:
    """The table of `measure_methods` on standard output."""
    table = Table("method", box=box.SIMPLE_HEAD)
    for name in ("seconds", "relrmse", "skill", "equivalent rays"):
        table.add_column(name, justify="right")
    for row in rows:
        numbers = [_cell(row[key], digits) for key, digits in zip(SHORT, (4, 3, 1), strict=True)]
        table.add_row(row["method"], f"{row['seconds']:.3f}", *numbers)
    Console(width=100).print(table)


def bench(
    mesh_path: Path, names: Sequence[str], rays: int, up: str, output: Path | None, as_json: bool, quiet: bool
) -> None:
    """`gash bench`."""
    if output:
        check_writable(output)
    models = {name: load_model(name) for name in names}
    mesh, health = read_mesh(mesh_path, up)
    with progress_bar(f"reference, {rays} rays per vertex", quiet) as update:
        reference = make_reference(mesh, _common_bands(models), rays, update)
    with progress_bar("timing", quiet) as update:
        rows, _ = measure_methods(mesh, models, reference, update)
    arguments = {"mesh": mesh_path.name, "models": list(names), "rays": rays}
    results = {**provenance(seed=0, arguments=arguments), "vertices": len(mesh.vertices), "rows": rows}
    _report(results, output, as_json, quiet, print_methods, [f"{mesh_path.name}: {len(mesh.vertices)} vertices"])


def _common_bands(models: dict[str, Model]) -> int:
    bands = {model.config.bands for model in models.values()} or {3}
    if len(bands) > 1:
        raise ValueError(f"the models have {sorted(bands)} bands: compare models of the same number of bands")
    return bands.pop()


def evaluate(
    name: Path, meshes: Sequence[Path], rays: int, up: str, output: Path | None, as_json: bool, quiet: bool
) -> None:
    """`gash evaluate`: one row a mesh."""
    if output:
        check_writable(output)
    model = load_model(name / "model.npz" if name.is_dir() else name)
    rows = []
    with progress_bar(f"{len(meshes)} meshes", quiet) as update:
        for step, path in enumerate(meshes):
            mesh, _ = read_mesh(path, up)
            reference = make_reference(mesh, model.config.bands, rays)
            rows.append({"mesh": path.name, "vertices": len(mesh.vertices), **evaluate_mesh(model, mesh, reference)})
            update(step + 1, len(meshes))
    results = {**provenance(seed=0, arguments={"model": name.name, "rays": rays}), "rows": rows}
    skills = [row["skill"] for row in rows if isinstance(row["skill"], float)]
    lines = [f"median skill {np.median(skills):.3f}, worst {min(skills):.3f}"] if skills else []
    _report(results, output, as_json, quiet, print_meshes, lines)


def print_meshes(rows: Sequence[dict[str, Any]]) -> None:
    """The table of `evaluate` on standard output; times in microseconds per vertex."""
    table = Table("mesh", box=box.SIMPLE_HEAD)
    seen = "balanced_accuracy" in rows[0]
    extra = ("accuracy", "balanced", "majority") if seen else ()
    for name in ("vertices", "graph us", "network us", "relrmse", "skill", "equivalent rays", *extra):
        table.add_column(name, justify="right")
    for row in rows:
        numbers = [_cell(row[key], digits) for key, digits in zip(SHORT, (4, 3, 1), strict=True)]
        if seen:
            numbers += [f"{row[key]:.3f}" for key in ("accuracy", "balanced_accuracy", "majority_accuracy")]
        times = (f"{row[key]:.2f}" for key in ("graph_us", "network_us"))
        table.add_row(row["mesh"], str(row["vertices"]), *times, *numbers)
    Console(width=140).print(table)


def _report(
    results: dict[str, Any],
    output: Path | None,
    as_json: bool,
    quiet: bool,
    show: Callable[[Sequence[dict[str, Any]]], None],
    lines: list[str],
) -> None:
    if as_json:
        print(json.dumps(results))
    elif not quiet:
        show(results["rows"])
    for line in () if as_json else lines:
        say(line, quiet)
    if output:
        write_json(output, results)
        say(f"wrote {output}", quiet or as_json)
