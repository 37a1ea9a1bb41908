"""`gash bench frontier`: every method at several settings on the same meshes, in one run.

The command of its own is found by `gash bench`, of which it is a part.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.apps.frontier.measuring import (
    RESOLUTION,
    Choice,
    key_of,
    measure_mesh,
    pool,
    read_piece,
    write_piece,
)
from gash_jax.apps.frontier.methods import FAMILIES, METHODS, Task
from gash_jax.apps.options import LIGHT_HELP, PATH, Command, light_option, quiet_option, up_option
from gash_jax.apps.pictures.frontier import draw_frontier
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.tables import print_pooled, print_targets
from gash_jax.files.atomic import FileError, check_writable, write_json
from gash_jax.files.caches import source_hash
from gash_jax.files.settings import near_names
from gash_jax.formats.meshes import mesh_files, read_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.environment import load_light
from gash_jax.measure.frontier import compiled_anew
from gash_jax.measure.provenance import provenance
from gash_jax.models.model import Model, load_model, model_file, shipped_models

BANDS = 3  # of the weights that ship
ALBEDO = 0.6  # of all surfaces, where light bounces
RESULTS, FIGURE = "results.json", "frontier.png"
# whose source determines what is measured
ROOMS = ("algebra", "files", "geometry", "graph", "light", "measure", "models", "nn", "prt", "apps/frontier")


def _methods(ctx: click.Context, parameter: click.Parameter, value: str | None) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(value.split(","))) if value else tuple(METHODS)
    for name in names:
        if name not in METHODS:
            near = near_names(name, METHODS)
            raise click.BadParameter(f"unknown method {name!r}{near}: known are {', '.join(METHODS)}")
    return names


@click.command(cls=Command, epilog="gash bench frontier bunny.ply spot.ply --light studio.hdr -o frontier")
@click.argument("meshes", nargs=-1, required=True, type=PATH, metavar="MESH...")
@click.option("-o", "--output", required=True, type=PATH, help="Folder of the results.")
@light_option(f"{LIGHT_HELP}  With it the PSNR of relit pictures is measured as well.")
@click.option("--methods", metavar="NAME,NAME", callback=_methods, help=f"Of {', '.join(METHODS)}.  [default: all]")
@click.option("--model", "models", multiple=True, help="Weights file or run beside those that ship; may be repeated.")
@click.option(
    "--bounces",
    multiple=True,
    type=click.IntRange(0, 256),
    help=f"How often light may be reflected, off surfaces of albedo {ALBEDO}; may be repeated.  [default: 0]",
)
@click.option(
    "--rays",
    type=click.IntRange(64, 1 << 20),
    default=8192,
    show_default=True,
    help="Rays per vertex of the reference.",
)
@click.option("--rounds", type=click.IntRange(1, 1000), default=5, show_default=True, help="Timed calls of a setting.")
@up_option
@quiet_option
def frontier(
    meshes: tuple[Path, ...],
    output: Path,
    light_path: Path | None,
    methods: tuple[str, ...],
    models: tuple[str, ...],
    bounces: tuple[int, ...],
    rays: int,
    rounds: int,
    up: str,
    quiet: bool,
) -> None:
    """Speed against error of every method at several settings on every MESH; run again to continue.

    Writes results.json and a figure, frontier.png, with the Pareto front of each mesh and of all together. Settings
    are timed in turn, warm, in several rounds; what cannot be run here is named in the results with the reason.
    """
    loaded = _load_models(models)
    light = None if light_path is None else np.asarray(load_light(light_path, BANDS).coefficients)
    surfaces = _read_meshes(meshes, up)
    _make_folder(output, [*(file for mesh in meshes for file in mesh_files(mesh)), *map(model_file, models)])
    choice = Choice(methods, rays, rounds, light)
    weights = [(name, model_file(name).read_bytes()) for name in loaded]
    source, counts = source_hash(ROOMS), tuple(dict.fromkeys(bounces)) or (0,)
    tasks = [(name, mesh, count) for name, mesh in surfaces.items() for count in counts]
    found: list[dict[str, Any]] = []
    with progress_bar("", quiet) as update, compiled_anew():
        for step, (name, mesh, count) in enumerate(tasks):
            label = name if not count else f"{name}, {count} bounce{'s' * (count > 1)}"
            key = key_of(mesh, choice, weights, count, source)
            path = output / "pieces" / f"{label}.json"
            values = read_piece(path, key)
            if values is None:
                task = Task(mesh, BANDS, {Path(n).stem: m for n, m in loaded.items()}, count, ALBEDO)
                values = measure_mesh(
                    task,
                    choice,
                    lambda done, total, s=step: update(s * RESOLUTION + done, len(tasks) * RESOLUTION),
                )
                write_piece(path, key, values)
            found.append({"mesh": label, **values})
            update((step + 1) * RESOLUTION, len(tasks) * RESOLUTION)
    arguments = {"meshes": list(surfaces), "methods": list(methods), "models": [Path(n).stem for n in loaded]}
    arguments |= {"rays": rays, "rounds": rounds, "light": light_path and light_path.name}
    results = {**provenance(seed=0, arguments=arguments), "meshes": found, "pooled": pool(found)}
    write_json(output / RESULTS, results)
    draw_frontier(results, output / FIGURE)
    _tell(results, output, quiet)


def _load_models(given: Sequence[str]) -> dict[str, Model]:
    """The weights that ship and those that were given, all of families that are measured and of as many bands."""
    known = {name: load_model(name) for name in shipped_models()}
    for name in given:
        known[name] = model = load_model(name)
        if model.config.name not in FAMILIES:
            raise FileError(f"{name} is a {model.config.name} model: measured are {', '.join(FAMILIES)}")
        if model.config.bands != BANDS:
            raise FileError(f"{name} has {model.config.bands} bands: give a model of {BANDS}")
    return known


def _read_meshes(paths: Sequence[Path], up: str) -> dict[str, Mesh]:
    """Meshes by the names of their files, which must differ."""
    found: dict[str, Mesh] = {}
    for path in paths:
        if path.stem in found:
            raise FileError(f"two meshes are called {path.stem}: results are kept by name, give one another name")
        found[path.stem] = read_mesh(path, up)[0]
    return found


def _make_folder(output: Path, inputs: Sequence[Path]) -> None:
    if output.exists() and not output.is_dir():
        raise FileError(f"cannot write into {output}: it is a file, give a folder")
    output.mkdir(parents=True, exist_ok=True)
    for name in (RESULTS, FIGURE):
        check_writable(output / name, inputs)


def _tell(results: dict[str, Any], output: Path, quiet: bool) -> None:
    """The table, and what was left out."""
    if quiet:
        return
    for pool_of in results["pooled"]:
        print_pooled(pool_of)
        if pool_of["targets"]:
            print_targets(pool_of["targets"])
    for name, reason in {k: v for mesh in results["meshes"] for k, v in mesh["skipped"].items()}.items():
        say(f"left out: {name} ({reason})")
    say(f"wrote {output / RESULTS} and {output / FIGURE}")
