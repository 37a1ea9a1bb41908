"""Speed against error: `gash bench` (every method on one mesh) and `gash evaluate` (one model on many meshes)."""

import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from gash_jax.apps.progress import UpdateFn, progress_bar, say
from gash_jax.apps.provenance import provenance
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.mesh_io import read_mesh
from gash_jax.geometry.npz_io import check_writable
from gash_jax.learn.evaluation import Reference, make_reference, score, visibility_score
from gash_jax.learn.model import Model, load_model
from gash_jax.learn.timing import timed
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.transfer import unshadowed_transfer

PLAIN_RAYS = (8, 16, 32, 64, 128, 256)
SHORT = ("relrmse", "skill", "equivalent_rays")


def measure_methods(
    mesh: Mesh, models: dict[str, Model], reference: Reference, update: UpdateFn
) -> tuple[list[dict[str, Any]], dict[str, np.ndarray]]:
    """Rows of the table: closed form, plain bakes, models, each timed and scored; and the coefficients by method."""
    bands = round(reference.coefficients.shape[1] ** 0.5)
    methods: dict[str, Callable[[], np.ndarray]] = {
        "closed form": lambda: np.asarray(unshadowed_transfer(mesh.normals, bands))
    }
    for rays in PLAIN_RAYS:
        methods[f"plain bake, {rays} rays"] = lambda n=rays: bake_transfer(mesh, bands, n, replicates=1).coefficients
    for name, model in models.items():
        methods[name] = lambda m=model: m.predict(mesh).coefficients
    rows, found = [], {"reference": reference.coefficients}
    for step, (name, work) in enumerate(methods.items()):
        found[name], seconds = timed(work)
        rows.append({"method": name, "seconds": seconds, **score(found[name], mesh, reference)})
        update(step + 1, len(methods))
    return rows, found


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


def write_json(path: Path, values: dict[str, Any]) -> None:
    """Write whole or not at all."""
    path = check_writable(path)
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")
    os.replace(temporary, path)


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


def evaluate_mesh(model: Model, mesh: Mesh, reference: Reference) -> dict[str, Any]:
    """Scores and times of a model on one mesh; visibility scores where the model predicts visibility."""
    graph, graph_seconds = timed(lambda: model.graph(mesh))
    _, network_seconds = timed(lambda: model(graph))
    per_vertex = 1e6 / len(mesh.vertices)
    times = {"graph_us": graph_seconds * per_vertex, "network_us": network_seconds * per_vertex}
    seen = visibility_score(model, mesh) if model.config.name == "two-stage" else {}
    return {**times, **score(model.predict(mesh).coefficients, mesh, reference), **seen}


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
