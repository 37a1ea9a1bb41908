"""`gash convert`: lights and transfers in the numbers of other programs and back, and as glTF for engines."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, output_option, quiet_option
from gash_jax.apps.printing import say
from gash_jax.files.atomic import FileError, check_writable
from gash_jax.files.npz import read_npz
from gash_jax.formats.hdr import write_hdr
from gash_jax.formats.maps import SUFFIXES as MAPS
from gash_jax.formats.maps import read_map
from gash_jax.formats.meshes import load_mesh
from gash_jax.light.convention_files import read_numbers, write_numbers, written_beside
from gash_jax.light.conventions import turn_map
from gash_jax.light.conversion import from_convention, to_convention
from gash_jax.light.engines import CONVENTIONS, convention
from gash_jax.light.environment import FORMAT as LIGHT
from gash_jax.light.environment import Light, load_light, save_light
from gash_jax.light.layouts import layout_of
from gash_jax.light.pifu_faces import pifu_faces
from gash_jax.prt.asset import OURS, write_asset
from gash_jax.prt.transfer import Transfer, load_transfer, make_metadata, save_transfer
from gash_jax.prt.vertex_attributes import STORES

_NAMES = click.Choice(list(CONVENTIONS))


@click.command(cls=Command, epilog="gash convert studio.npz --to unity -o studio.json")
@click.argument("source", metavar="IN", type=PATH)
@output_option
@click.option("--to", "target", type=_NAMES, help="Write the numbers that this program has.")
@click.option("--from", "origin", type=_NAMES, help="Read the numbers of this program, write a file of ours.")
@click.option("--bands", type=click.IntRange(1, 10), help="Keep the first bands only.")
@click.option("--mesh", "mesh", type=PATH, help="The mesh: a .glb to keep, for PIFu the .obj, with --from any.")
@click.option(
    "--attributes",
    type=click.Choice(["sh", "uv"]),
    default="sh",
    show_default=True,
    help="In a .glb: as _SH0 to _SH3, or as texture coordinates, which Unity can read.",
)
@click.option(
    "--store",
    type=click.Choice(list(STORES)),
    default="float",
    show_default=True,
    help="In a .glb: what a number is stored in.",
)
@click.option(
    "--weld", type=PATH, help="Carry coefficients over by place; file to write: which vertex is which (.npz)."
)
@quiet_option
def convert(source: Path, output: Path, target: str | None, origin: str | None, quiet: bool, **options: Any) -> None:
    """Write a light or a transfer the way another program reads it, and back: numbers, or a .glb file.

    IN is a transfer, a light, a map (.hdr, .exr) to be turned, or with --from a file of another program.
    """
    inputs = [path for path in (source, options["mesh"]) if path]
    asset = output.suffix.lower() == ".glb"
    _check_options(source, target, origin, asset, options)
    check_writable(output, inputs)
    if source.suffix.lower() in MAPS:
        _turn(source, output, str(target), quiet)
    elif origin:
        _read_back(source, output, origin, options["mesh"], quiet)
    elif asset:
        _asset(source, output, target, options, inputs, quiet)
    else:
        _numbers(source, output, str(target), options, inputs, quiet)


def _check_options(source: Path, target: str | None, origin: str | None, asset: bool, options: dict[str, Any]) -> None:
    """Refuse options that would have no effect, and too few of them."""
    if (target is not None or asset) == (origin is not None):
        raise click.UsageError("give --to NAME, --from NAME, or an output that ends in .glb")
    if source.suffix.lower() in MAPS and target is None:
        raise click.UsageError("a map is turned for a program: give --to NAME")
    if not asset and (options["weld"] or options["attributes"] != "sh" or options["store"] != "float"):
        raise click.UsageError("--attributes, --store and --weld say how a .glb is written: name the output so")
    if options["bands"] and (origin or source.suffix.lower() in MAPS):
        raise click.UsageError("--bands cuts our own lights and transfers: leave it out")
    if options["weld"] and options["weld"].suffix.lower() != ".npz":
        raise click.UsageError("--weld is the name of a file to write: let it end in .npz")
    if options["mesh"] and not asset and target not in (None, "pifu"):
        raise click.UsageError("--mesh goes with a .glb, with --to pifu and with --from")


def _turn(source: Path, output: Path, target: str, quiet: bool) -> None:
    if output.suffix.lower() != ".hdr":
        raise FileError(f"{output}: a map that is turned is written as .hdr")
    picture = read_map(source)
    with _naming(source):
        layout, _ = layout_of(picture.radiance, picture.layout)
        if layout != "latlong":
            raise ValueError(f"a map of the kind {layout}, and only latlong maps are turned")
        turned = turn_map(picture.radiance, convention(target))
    write_hdr(output, turned)
    say(f"wrote {output}: {convention(target).title} shows every light of it where we have those of {source}", quiet)


def _read_back(source: Path, output: Path, origin: str, mesh_path: Path | None, quiet: bool) -> None:
    numbers, mesh = read_numbers(source, origin)
    with _naming(source):
        value = from_convention(numbers, origin)
    if isinstance(value, Light):
        save_light(output, value)
    else:
        if mesh_path:
            mesh = load_mesh(mesh_path)._asdict()
        if len(mesh) != 3 or len(mesh["vertices"]) != len(value):
            raise FileError(f"{source} has {len(value)} rows and no mesh of as many vertices: give it, --mesh FILE")
        bands = round(value.shape[1] ** 0.5)
        metadata = make_metadata(bands, "converted", {"convention": origin, "file": source.name})
        save_transfer(output, Transfer(value, None, **mesh, metadata=metadata))
    say(f"wrote {output}: a {'light' if isinstance(value, Light) else 'transfer'} in our conventions", quiet)


def _load(source: Path, bands: int | None, quiet: bool) -> Light | Transfer:
    """A light or a transfer, cut to so many bands; says that error bars and gloss stay behind."""
    arrays, metadata = read_npz(source, "transfer or light", ("coefficients",))
    if metadata.get("format") == LIGHT:
        value = load_light(source, max(1, math.isqrt(arrays["coefficients"].size // 3)))
    else:
        value = load_transfer(source)
    lost = [name for name in ("standard_error", "predicted_error", "visibility", "matrices") if name in arrays]
    if lost:
        say(f"  left behind: {', '.join(lost)}", quiet)
    if bands is None or bands == value.bands:
        return value
    if bands > value.bands:
        raise FileError(f"{source} has {value.bands} bands, not {bands}: make it again with --bands {bands}")
    axis = 0 if isinstance(value, Light) else 1
    kept = np.take(np.asarray(value.coefficients), range(bands * bands), axis)
    if isinstance(value, Light):
        return Light(kept, {**value.metadata, "bands": bands})
    return Transfer(kept, None, value.vertices, value.normals, value.faces, {**value.metadata, "bands": bands})


def _asset(
    source: Path, output: Path, target: str | None, options: dict[str, Any], inputs: list[Path], quiet: bool
) -> None:
    value = _load(source, options["bands"], quiet)
    if isinstance(value, Light):
        raise FileError(f"{source} is a light, and a .glb holds a transfer: write numbers instead, with --to NAME")
    if options["mesh"] and options["mesh"].suffix.lower() != ".glb":
        raise FileError(f"{options['mesh']} is no .glb: leave --mesh out, the transfer has its own mesh")
    weld = options["weld"]
    if weld:
        check_writable(weld, [*inputs, output])
    if target:
        with _naming(source):
            value = value._replace(coefficients=to_convention(value, target))
    how = options["attributes"], options["store"], weld, target or OURS
    asset = write_asset(output, value, options["mesh"], *how)
    rounding = f", rounded by {asset.error:.1e} at most" if options["store"] != "float" else ""
    say(f"wrote {output}: {asset.vertices} vertices, {' '.join(asset.attributes)}{rounding}", quiet)
    if weld:
        say(f"wrote {weld}: file_vertex of each vertex of the .glb, engine_vertex of each of the transfer", quiet)


def _numbers(source: Path, output: Path, target: str, options: dict[str, Any], inputs: list[Path], quiet: bool) -> None:
    value = _load(source, options["bands"], quiet)
    if options["mesh"] and isinstance(value, Light):
        raise FileError("--mesh says in which order PIFu's loader reads faces, and a light has none: leave it out")
    corners = None
    if isinstance(value, Transfer) and options["mesh"]:
        corners = pifu_faces(options["mesh"], len(value.vertices))
    files = written_beside(output, value, target)
    for file in files:
        check_writable(file, inputs)
    with _naming(source):
        write_numbers(output, value, target, corners)
    say(f"wrote {' and '.join(map(str, files))} for {convention(target).title}", quiet)


@contextmanager
def _naming(source: Path) -> Iterator[None]:
    """What is wrong with the numbers of a file names that file."""
    try:
        yield
    except FileError:
        raise
    except ValueError as error:
        raise FileError(f"{source}: {error}") from None
