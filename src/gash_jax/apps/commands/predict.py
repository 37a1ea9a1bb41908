"""`gash predict`: the transfer of a mesh by a network."""

from pathlib import Path

import click

from gash_jax.apps.albedo import read_albedo
from gash_jax.apps.options import PATH, Command, output_option, quiet_option, up_option
from gash_jax.apps.printing import say
from gash_jax.files.atomic import check_writable
from gash_jax.formats.meshes import mesh_files, read_mesh
from gash_jax.models.model import load_model, model_file
from gash_jax.prt.transfer import save_transfer


@click.command(cls=Command, epilog="gash predict bunny.ply -o predicted.npz --bounces 2 --albedo 0.7")
@click.argument("mesh", type=PATH)
@output_option
@click.option("--model", default="local", show_default=True, help="Shipped name, weights file (.npz) or run folder.")
@click.option("--bands", type=int, help="SH bands, of those that the network knows: local 1 to 6.")
@click.option("--bounces", type=int, default=0, help="Bounces of light off surfaces of --albedo: local knows two.")
@click.option("--albedo", metavar="A | R,G,B", help="With --bounces: one number or one colour.")
@click.option(
    "--ambient", is_flag=True, help="Darken crevices afterwards by geometric ambient occlusion (GNN paper, 4.3.2)."
)
@up_option
@quiet_option
def predict(
    mesh: Path,
    output: Path,
    model: str,
    bands: int | None,
    bounces: int,
    albedo: str | None,
    ambient: bool,
    up: str,
    quiet: bool,
) -> None:
    """Predict the transfer of MESH with a network: no rays."""
    if bool(bounces) != (albedo is not None):
        raise click.UsageError("--bounces and --albedo belong together: give both, or none")
    if bounces and ambient:
        raise click.UsageError("--ambient darkens what has no bounces: leave it out, or --bounces")
    check_writable(output, [*mesh_files(mesh), model_file(model)])
    network = load_model(model, bands)
    surface, health = read_mesh(mesh, up)
    colour = None if albedo is None else read_albedo(albedo, [mesh])
    transfer = network.predict(surface, bounces=bounces, albedo=colour)
    entries = {**transfer.metadata, "health": health.to_dict()}
    if ambient:
        from gash_jax.models.ambient import STRENGTH, ambient_refinement  # its search tree is slow to import

        darker = ambient_refinement(surface, transfer.coefficients)
        transfer = transfer._replace(coefficients=darker, predicted_error=None)
        entries["parameters"] = {**entries["parameters"], "ambient": STRENGTH}
    save_transfer(output, transfer._replace(metadata=entries))
    for line in health.lines():
        say(f"  {line}", quiet)
    seconds = entries["seconds"]
    say(f"{len(surface.vertices)} vertices: graph {seconds['graph']:.2f} s, network {seconds['network']:.2f} s", quiet)
    say(f"wrote {output}", quiet)
