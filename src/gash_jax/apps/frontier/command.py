"""`gash bench frontier`: every method at several settings on the same meshes, in one run.

The command of its own is found by `gash bench`, of which it is a part.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.apps.frontier.inputs import BANDS, load_models, read_frames
from gash_jax.apps.frontier.measuring import (
    Choice,
    key_of,
    measure_mesh,
    pool,
    read_piece,
    write_piece,
)
from gash_jax.apps.frontier.methods import METHODS, Task
from gash_jax.apps.options import LIGHT_HELP, PATH, Command, light_option, quiet_option, up_option
from gash_jax.apps.pictures.frontier import draw_frontier
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.tables import print_pooled, print_targets
from gash_jax.files.atomic import FileError, check_writable, write_json
from gash_jax.files.caches import source_hash
from gash_jax.files.settings import near_names
from gash_jax.formats.meshes import mesh_files
from gash_jax.light.environment import load_light
from gash_jax.measure.frontier import compiled_anew
from gash_jax.measure.provenance import provenance
from gash_jax.models.model import model_file

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

    A MESH may be an animation (.npz, .glb): then some of its frames are measured, by the methods that are for them.
    Writes results.json and a figure, frontier.png, with the Pareto front of each mesh and of all together. Settings
    are timed in turn, warm, in several rounds; what cannot be run here is named in the results with the reason.
    """
    loaded = load_models(models)
    light = None if light_path is None else np.asarray(load_light(light_path, BANDS).coefficients)
    surfaces = read_frames(meshes, up)
    weights = [model_file(name) for name in models]
    _check_folder(output, [*(file for mesh in meshes for file in mesh_files(mesh)), *weights])
    choice = Choice(methods, rays, rounds, light)
    determined = (methods, rays, rounds, light, [(*loaded.networks, *loaded.deforming)])
    determined += (source_hash(ROOMS), *(file.read_bytes() for file in weights))
    tasks = [
        Task(frames[0], BANDS, loaded.networks, count, ALBEDO, frames * (len(frames) > 1), loaded.deforming)
        for frames in surfaces.values()
        for count in dict.fromkeys(bounces or (0,))
    ]
    names = [name for name in surfaces for _ in dict.fromkeys(bounces or (0,))]
    found: list[dict[str, Any]] = []
    with progress_bar(f"{len(surfaces)} meshes", quiet) as update, compiled_anew():
        for step, (name, task) in enumerate(zip(names, tasks, strict=True)):
            label = f"{name}, {task.bounces} bounce{'s' * (task.bounces > 1)}" if task.bounces else name
            key = key_of(surfaces[name], task.bounces, *determined)
            path = output / "pieces" / f"{label}.json"
            values = read_piece(path, key)
            if values is None:
                report = lambda done, total, s=step: update(s * total + done, len(tasks) * total)  # noqa: E731
                values = measure_mesh(task, choice, report)
                write_piece(path, key, values)
            found.append({"mesh": label, **values})
            update(step + 1, len(tasks))
    arguments = {"meshes": list(surfaces), "methods": list(methods), "models": [Path(name).stem for name in models]}
    arguments |= {"rays": rays, "rounds": rounds, "light": light_path and light_path.name}
    results = {**provenance(seed=0, arguments=arguments), "meshes": found, "pooled": pool(found)}
    draw_frontier(results, output / FIGURE)
    write_json(output / RESULTS, results)
    _tell(results, output, quiet)


def _check_folder(output: Path, inputs: Sequence[Path]) -> None:
    """Fail before anything is measured; the folder itself is made with the first result."""
    if output.exists() and not output.is_dir():
        raise FileError(f"cannot write into {output}: it is a file, give a folder")
    for path in (output / RESULTS, output / FIGURE) if output.is_dir() else (output,):
        check_writable(path, inputs)


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
