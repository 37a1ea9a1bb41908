"""`gash view`: a page to look at transfer in a browser, one HTML file that needs no server and no network."""

import tempfile
import webbrowser
from pathlib import Path

import click

from gash_jax.apps.options import PATH, Command, check_layout, layout_option, quiet_option, up_option
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.viewer.contents import PageFile, map_file, own_lights
from gash_jax.apps.viewer.moving import read_moving
from gash_jax.apps.viewer.page import Shown, make_page
from gash_jax.files.atomic import FileError, check_writable
from gash_jax.files.npz import names_in_npz
from gash_jax.formats.meshes import mesh_files, read_mesh
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.texture import load_texture
from gash_jax.prt.transfer import load_transfer

RAYS, MODEL = 256, "local"  # of a mesh that comes without its transfer


@click.command(cls=Command, epilog="gash view bunny.npz predicted.npz --light studio.hdr -o bunny.html")
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option(
    "--light", "lights", multiple=True, type=PATH, help="Map (.hdr, .exr), light (.npz) or its name; several times."
)
@layout_option
@up_option
@click.option("-o", "--output", type=PATH, help="Page to write (.html).  [default: a temporary one, in your browser]")
@quiet_option
def view(
    files: tuple[Path, ...],
    lights: tuple[Path, ...],
    layout: str | None,
    up: str,
    output: Path | None,
    quiet: bool,
) -> None:
    """Write a page that shows transfer under light: turn both, compare results, see errors. FILE is a transfer (.npz),
    a transfer texture (.npz), the transfer of an animation's frames (.npz), or a mesh, which is baked and predicted
    first; several FILEs are results for one mesh."""
    check_layout(layout, lights[0] if lights else None)
    if output is not None:
        check_writable(output, [*lights, *(source for file in files for source in mesh_files(file))])
    results: dict[str, Shown] = {}
    for file in files:
        results |= _results(file, up, quiet)
    shining = _lights(lights, layout, next(iter(results.values())).bands, quiet)
    with progress_bar("fitting the frames onto a page", quiet) as update:
        page = make_page(files[0].stem, results, shining, update)
    target = output or Path(tempfile.mkdtemp(prefix="gash-view-")) / f"{files[0].stem}.html"
    page.save(target)
    for note in page.notes:
        say(f"  {note}", quiet)
    say(f"wrote {target} ({len(page.html) / 2**20:.1f} MiB)", quiet)
    if output is None and not webbrowser.open(target.resolve().as_uri()):
        raise FileError(f"no browser could be opened: open {target} yourself, or name a file with -o")


def _results(path: Path, up: str, quiet: bool) -> dict[str, Shown]:
    """What a file has to show, by names."""
    if path.suffix.lower() == ".npz":
        if "texture" in names_in_npz(path):
            return {path.name: load_texture(path)}
        moving = read_moving(path)
        return {path.name: load_transfer(path) if moving is None else moving}
    mesh, health = read_mesh(path, up)
    for line in health.lines():
        say(f"  {line}", quiet)
    with progress_bar(f"baking {path.name}, {RAYS} rays per vertex", quiet) as update:
        baked = bake_transfer(mesh, rays=RAYS, progress=update)
    from gash_jax.models.model import load_model  # most pages are of files that are there, and need no network

    say(f"{path.name}: predicting with {MODEL}", quiet)
    return {path.name: baked, f"{path.name}, {MODEL}": load_model(MODEL).predict(mesh)}


def _lights(paths: tuple[Path, ...], layout: str | None, bands: int, quiet: bool) -> list[PageFile]:
    found = []
    for path in paths:
        with progress_bar(f"projecting {path.name}", quiet) as update:
            found.append(map_file(path, bands, layout, update))
    return found or own_lights()
