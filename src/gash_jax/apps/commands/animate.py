"""`gash animate`: the transfer of every frame of an animation, baked or by a model."""

import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import click
import numpy as np
from jaxtyping import Float

from gash_jax.apps.options import (
    PATH,
    Command,
    bands_option,
    output_option,
    quiet_option,
    rest_option,
    up_option,
    vertices_option,
)
from gash_jax.apps.printing import say
from gash_jax.apps.progress import UpdateFn, progress_bar
from gash_jax.apps.shard_options import Work, by_jobs, shard_options
from gash_jax.files.atomic import check_writable
from gash_jax.files.npz import Rows, write_npz_rows
from gash_jax.formats.animations import load_animation
from gash_jax.formats.meshes import mesh_files
from gash_jax.models.deforming_model import DeformingModel, deforming_model_file, load_deforming_model
from gash_jax.prt.sequence import MovingScene, moving_scene, posed_meshes
from gash_jax.prt.transfer import make_metadata
from gash_jax.train.truth import bake_shard, bake_truth, check_truth

BAKE, FORMAT, LIT = "bake", "gash-animated-transfer", "gash-animated-radiance"
PLACES = {"vertices": "<f4", "normals": "<f2"}


@click.command(cls=Command, epilog="gash animate walk.glb -o walk.npz --rays 64")
@click.argument("animation", type=PATH)
@output_option
@click.option("--model", default=BAKE, show_default=True, help="Run folder or weights file (.npz); bake: by rays.")
@bands_option(4)
@click.option(
    "--rays", type=click.IntRange(1, 1 << 20), default=256, show_default=True, help="Rays per vertex of a bake."
)
@vertices_option
@rest_option
@click.option("--clip", help="Clip of a glTF file.  [default: the first]")
@up_option
@click.option("--glossy", is_flag=True, help="Bake what every vertex sees too, for glossy surfaces.")
@shard_options
@quiet_option
def animate(
    animation: Path,
    output: Path,
    model: str,
    bands: int,
    rays: int,
    vertices: str,
    rest: str,
    clip: str | None,
    up: str,
    glossy: bool,
    quiet: bool,
    work: Work,
) -> None:
    """Write the transfer of every frame of ANIMATION: baked, or by a model of the object that deforms.

    The file holds coefficients (frames, vertices, bands²) in float16, and vertices and normals of every frame, so that
    `gash view` shows it; --glossy adds visibility (frames, vertices, (2 bands - 1)²). Of a model of radiance it holds
    radiance (frames, vertices, bands², 3) in place of coefficients, and the light. A bake is kept frame by frame, so
    after an interruption the same command goes on where it stopped; frames are kept in the cache folder, $GASH_CACHE,
    which machines that share the work must share. A shard bakes, --merge writes the file.
    """
    if model != BAKE and work != Work():
        raise click.UsageError("--shard, --merge and --cluster share out a bake: leave out --model")
    if model != BAKE and glossy:
        raise click.UsageError("--glossy is baked: leave out --model")
    fitted = None if model == BAKE else load_deforming_model(model)
    weights = None if model == BAKE else deforming_model_file(model)
    check_writable(output, [*mesh_files(animation), weights])
    scene = moving_scene(load_animation(animation, up, clip), vertices, rest)
    left = by_jobs(work, quiet)
    if left is None:
        return
    if left.merge:
        check_truth(scene, bands, rays, left.merge, glossy)
    if left.shard is not None:
        with progress_bar(f"frames of shard {left.shard}", quiet) as update:
            done = bake_shard(scene, bands, rays, left.shard, update, glossy)
        say(f"shard {left.shard}: {done} of {len(scene.animation)} frames are in the cache", quiet)
        return
    with progress_bar(f"{len(scene.animation)} frames", quiet) as update:
        if fitted is None:
            seconds = _bake(output, scene, bands, rays, glossy, update)
        else:
            seconds = _predict(output, scene, fitted, update, quiet)
    say(f"{len(scene.animation)} frames x {scene.rows.stop - scene.rows.start} vertices, {seconds}", quiet)
    say(f"wrote {output}", quiet)


def _bake(output: Path, scene: MovingScene, bands: int, rays: int, glossy: bool, update: UpdateFn) -> str:
    truth = bake_truth(scene, bands, rays, update, glossy)
    parameters = {"rays": rays, "rows": [scene.rows.start, scene.rows.stop], **({"glossy": True} if glossy else {})}
    names = ("coefficients", *(("visibility",) if glossy else ()))
    found = {name: (frame for shard in truth.shards(name) for frame in shard) for name in names}
    _write(output, found, scene, bands, "bake", parameters)
    return f"{truth.cpu_seconds:.3g} CPU seconds a frame when they were baked"


def _predict(output: Path, scene: MovingScene, model: DeformingModel, update: UpdateFn, quiet: bool) -> str:
    moving, light, outside, taken = scene.receivers, model.light, [], []
    say_pose = model if light is None else model.radiance

    def frames() -> Iterator[np.ndarray]:
        for number, positions in enumerate(moving.frames()):
            started = time.perf_counter()
            found = np.asarray(say_pose(positions))
            taken.append(time.perf_counter() - started)
            outside.extend([number] * model.outside(positions))
            update(number + 1, len(moving))
            yield found

    model.pose(moving.mesh.vertices)  # another mesh is refused before anything is written
    found = {"coefficients" if light is None else "radiance": frames()}
    parameters = {"weights": model.metadata.get("name", "")}
    _write(output, found, scene, model.config.bands, model.config.name, parameters, light)
    if outside:
        say(f"  {len(outside)} frames (first: {outside[0]}) are outside the poses that the model was fitted to", quiet)
    return f"{1e3 * float(np.median(taken)):.3g} ms a frame"


def _write(
    output: Path,
    found: Mapping[str, Iterator[np.ndarray]],
    scene: MovingScene,
    bands: int,
    method: str,
    parameters: dict[str, Any],
    light: Float[np.ndarray, "k 3"] | None = None,
) -> None:
    """The file: what was found, the light it was found under, and vertices and normals as the bake has them."""
    shape = (len(scene.animation), scene.rows.stop - scene.rows.start)
    widths = {"coefficients": (bands**2,), "radiance": (bands**2, 3), "visibility": ((2 * bands - 1) ** 2,)}
    large = {name: Rows(rows, (*shape, *widths[name])) for name, rows in found.items()}
    large |= {name: Rows(_places(scene, name), (*shape, 3), dtype) for name, dtype in PLACES.items()}
    metadata = {**make_metadata(bands, method, parameters), "format": FORMAT if light is None else LIT}
    small = {"faces": scene.receivers.mesh.faces, **({} if light is None else {"light": light})}
    write_npz_rows(output, large, small, metadata)


def _places(scene: MovingScene, name: str) -> Iterator[np.ndarray]:
    """Vertices or normals of every frame."""
    return (getattr(mesh, name)[scene.rows] for mesh in posed_meshes(scene.animation))
