"""`gash evaluate`: one model on many meshes."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, measuring_options
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.tables import print_meshes
from gash_jax.files.atomic import check_writable, write_json
from gash_jax.formats.animations import load_animation
from gash_jax.formats.meshes import mesh_files, read_mesh
from gash_jax.measure.methods import evaluate_mesh
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import make_reference
from gash_jax.models.deforming_model import DeformingModel, is_deforming, load_deforming_model
from gash_jax.models.model import load_model, model_file
from gash_jax.prt.sequence import moving_scene
from gash_jax.train.deforming_run import score_model
from gash_jax.train.truth import bake_truth


@click.command(cls=Command, epilog="gash evaluate runs/two-stage bunny.ply spot.ply -o scores.json")
@click.argument("run", type=PATH)
@click.argument("meshes", nargs=-1, required=True, type=PATH, metavar="MESH...")
@measuring_options
def evaluate(
    run: Path, meshes: tuple[Path, ...], rays: int, up: str, output: Path | None, as_json: bool, quiet: bool
) -> None:
    """Hold the model of RUN (or a weights file) against reference bakes of every MESH.

    A model of one object that deforms is held against all frames of every animation that is given in place of a mesh.
    """
    if output:
        check_writable(output, [model_file(run), *(file for mesh in meshes for file in mesh_files(mesh))])
    if is_deforming(model_file(run)):
        results = {**provenance(seed=0, arguments={"model": run.name, "rays": rays})}
        results["rows"] = _deforming_rows(load_deforming_model(run), meshes, rays, up, quiet or as_json)
        if as_json:
            click.echo(json.dumps(results))
        if output:
            write_json(output, results)
            say(f"wrote {output}", quiet or as_json)
        return
    model = load_model(run)
    rows = []
    with progress_bar(f"{len(meshes)} meshes", quiet) as update:
        for step, path in enumerate(meshes):
            mesh, _ = read_mesh(path, up)
            reference = make_reference(mesh, model.config.bands, rays)
            rows.append({"mesh": path.name, "vertices": len(mesh.vertices), **evaluate_mesh(model, mesh, reference)})
            update(step + 1, len(meshes))
    results = {**provenance(seed=0, arguments={"model": run.name, "rays": rays}), "rows": rows}
    skills = [row["skill"] for row in rows if isinstance(row["skill"], float)]
    if as_json:
        click.echo(json.dumps(results))
    elif not quiet:
        print_meshes(rows)
        if skills:
            say(f"median skill {np.median(skills):.3f}, worst {min(skills):.3f}")
    if output:
        write_json(output, results)
        say(f"wrote {output}", quiet or as_json)


def _deforming_rows(
    model: DeformingModel, animations: tuple[Path, ...], rays: int, up: str, quiet: bool
) -> list[dict[str, Any]]:
    """A model of one object on all frames of animations of it, a row for each."""
    data, rows, glossy = model.metadata["run"]["data"], [], model.light is not None
    for path in animations:
        scene = moving_scene(load_animation(path, up), data["vertices"], data["rest"])
        with progress_bar(f"frames of {path.name}", quiet) as update:
            scores = score_model(model, bake_truth(scene, model.config.bands, rays, update, glossy), flicker=True)
        rows.append({"animation": path.name, "frames": len(scene.animation), **scores})
        measures = ", ".join(f"{name} {value:.4g}" for name, value in scores.items())
        say(f"{path.name}, {len(scene.animation)} frames: {measures}", quiet)
    return rows
