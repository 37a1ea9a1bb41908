"""`gash bench`: some methods on one mesh; `gash bench frontier`: every method at several settings on many meshes."""

import json
from pathlib import Path
from typing import Any

import click

from gash_jax.apps.options import PATH, Command, measuring_options
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.tables import print_methods
from gash_jax.files.atomic import check_writable, write_json
from gash_jax.formats.meshes import mesh_files, read_mesh
from gash_jax.measure.methods import measure_methods
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import make_reference
from gash_jax.models.model import Model, load_model, model_file


class Bench(Command):
    """The command of one mesh, and that of many where the first word is its name: no file of a mesh is called so."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """As click does it, for the command that is meant."""
        if args[:1] != ["frontier"]:
            return super().make_context(info_name, args, parent, **extra)
        from gash_jax.apps.frontier.command import frontier  # Matplotlib and more, which one mesh does not need

        return frontier.make_context(f"{info_name} frontier", args[1:], parent, **extra)


@click.command(cls=Bench, epilog="gash bench bunny.ply --model local -o bench.json")
@click.argument("mesh", type=PATH)
@click.option(
    "--model",
    "models",
    multiple=True,
    help="Shipped name, weights file or run; may be given several times.",
)
@measuring_options
def bench(
    mesh: Path, models: tuple[str, ...], rays: int, up: str, output: Path | None, as_json: bool, quiet: bool
) -> None:
    """Speed against error on MESH: closed form, plain bakes, networks.

    `gash bench frontier MESH... -o FOLDER` measures every method at several settings on many meshes, with a figure.
    """
    if output:
        check_writable(output, [*mesh_files(mesh), *map(model_file, models)])
    names = models or ("local",)
    loaded = {name: load_model(name) for name in names}
    surface, _ = read_mesh(mesh, up)
    with progress_bar(f"reference, {rays} rays per vertex", quiet) as update:
        reference = make_reference(surface, _common_bands(loaded), rays, update)
    with progress_bar("timing", quiet) as update:
        rows, _ = measure_methods(surface, loaded, reference, update)
    arguments = {"mesh": mesh.name, "models": list(names), "rays": rays}
    results = {**provenance(seed=0, arguments=arguments), "vertices": len(surface.vertices), "rows": rows}
    if as_json:
        click.echo(json.dumps(results))
    elif not quiet:
        print_methods(rows)
        say(f"{mesh.name}: {len(surface.vertices)} vertices")
    if output:
        write_json(output, results)
        say(f"wrote {output}", quiet or as_json)


def _common_bands(models: dict[str, Model]) -> int:
    bands = {model.config.bands for model in models.values()}
    if len(bands) > 1:
        raise ValueError(f"the models have {sorted(bands)} bands: compare models of the same number of bands")
    return bands.pop()
