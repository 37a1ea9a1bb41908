"""`gash evaluate`: one model on many meshes."""

import json
from pathlib import Path

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, measuring_options
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.tables import print_meshes
from gash_jax.files.atomic import check_writable, write_json
from gash_jax.formats.meshes import mesh_files, read_mesh
from gash_jax.measure.methods import evaluate_mesh
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import make_reference
from gash_jax.models.model import load_model, model_file


@click.command(cls=Command, epilog="gash evaluate runs/two-stage bunny.ply spot.ply -o scores.json")
@click.argument("run", type=PATH)
@click.argument("meshes", nargs=-1, required=True, type=PATH, metavar="MESH...")
@measuring_options
def evaluate(
    run: Path, meshes: tuple[Path, ...], rays: int, up: str, output: Path | None, as_json: bool, quiet: bool
) -> None:
    """Hold the model of RUN (or a weights file) against reference bakes of every MESH."""
    if output:
        check_writable(output, [model_file(run), *(file for mesh in meshes for file in mesh_files(mesh))])
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
