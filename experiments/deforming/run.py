"""Models of one object that deforms beside what is simpler, and beside baking: error, bytes, milliseconds a frame.

    .venv/bin/python -m experiments.deforming.run --object face --animation ict_face_expressions.npz \
        --vertices 0:11248 --more 1800:64 --also deep-prt-small=RUN --output docs/results/deforming_face.json
    .venv/bin/python -m experiments.deforming.run --object cloth --output docs/results/deforming_cloth.json

`experiments.deforming.objects` lists the objects. All models are fitted to the same frames and held against the same
test frames; with `--more 1800:64` `momo-prt` and `deform` also to so many frames of so many rays. *PCA floor*: the best
that any model can do whose coefficients are the mean and so many components of those of the training frames. `deform`
is fitted once, and cut to several sizes. `local` is the shipped network with its graph kept, which knows 3 bands: its
row is about those.
"""

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.options import parser, saved
from experiments.deforming.movie import path_of_poses
from experiments.deforming.objects import OBJECTS, object_file
from experiments.deforming.yardstick import Frames, Say, Yardstick, frames_of
from gash_jax.measure.deforming import coefficient_ranges
from gash_jax.measure.provenance import provenance
from gash_jax.measure.timing import timed_on_both_clocks
from gash_jax.models.deform import cut_to_size, fit_patches
from gash_jax.models.deforming import deforming_predictor
from gash_jax.models.deforming_model import (
    DeformingModel,
    deforming_model_file,
    is_deforming,
    load_deforming_model,
    save_deforming_model,
)
from gash_jax.models.model import load_model
from gash_jax.models.momo_prt import fit_momo
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import MovingScene, bake_pose
from gash_jax.train.config import RunConfig, load_config
from gash_jax.train.deforming_run import split_animation
from gash_jax.train.truth import Truth, bake_truth

MEGABYTES, COMPONENTS, RAYS, BANDS = (2.0, 4.0, 8.0, 16.0), (20, 40, 80, 160), (32, 64, 128, 256, 512), 4
PATH, POSES = 17, 2  # frames and poses of a path whose flicker is measured
STEADY = 64  # rays of the bake whose flicker is measured


def floors(training: Float[np.ndarray, "t v k"], test: Frames, yardstick: Yardstick) -> list[dict[str, Any]]:
    """The mean of the training frames, and the floors of their principal components."""
    flat, references = training.reshape(len(training), -1).astype(np.float32), np.stack(test.references)
    mean = flat.mean(axis=0)
    flat -= mean
    values, vectors = np.linalg.eigh((flat @ flat.T).astype(np.float64))
    order = np.argsort(-values)
    still = [mean.reshape(training.shape[1:])] * len(references)
    moves = yardstick.flicker(lambda mesh: still[0])  # of what never moves: how the truth itself moves
    rows = [{"method": "mean of the training frames", **yardstick.scores(still), **moves}]
    told = references.reshape(len(references), -1) - mean
    for count in [count for count in COMPONENTS if count < len(training)]:
        kept = order[:count]
        basis = (vectors[:, kept] / np.sqrt(np.maximum(values[kept], 1e-30))).T.astype(np.float32) @ flat
        found = ((told @ basis.T) @ basis + mean).reshape(references.shape)
        rows.append({"method": f"PCA floor, {count} components", **yardstick.scores(list(found))})
    return rows


def method_row(name: str, say: Say, test: Frames, yardstick: Yardstick) -> dict[str, Any]:
    """Scores and milliseconds a frame of what says the coefficients of a pose."""
    estimates = [np.asarray(say(mesh)) for mesh in test.meshes]
    _, spent = timed_on_both_clocks(lambda: say(test.meshes[0]), 9)
    times = {"model_ms": 1e3 * spent.wall, "model_cpu_ms": 1e3 * spent.cpu}
    return {"method": name, **yardstick.scores(estimates), **yardstick.flicker(say), **times}


def model_row(name: str, model: DeformingModel, path: Path, test: Frames, yardstick: Yardstick) -> dict[str, Any]:
    """The row of a model of this object, timed without the normals of the pose and from positions alone."""
    row = method_row(name, model.coefficients, test, yardstick)
    _, whole = timed_on_both_clocks(lambda: model(test.meshes[0].vertices), 9)
    return {**row, "bytes": path.stat().st_size, "positions_ms": 1e3 * whole.wall}


def bake_rows(test: Frames, rows: slice, yardsticks: Sequence[Yardstick]) -> list[dict[str, Any]]:
    """Plain bakes of few rays; they are the curve of the yardsticks, of which the first makes the rows."""
    found = []
    for rays in RAYS:
        started = time.process_time(), time.perf_counter()
        frames = [bake_pose(mesh, rows, BANDS, rays, 1000 + number) for number, mesh in enumerate(test.meshes)]
        cpu, wall = (
            clock() - start for clock, start in zip((time.process_time, time.perf_counter), started, strict=True)
        )
        times = {"model_ms": 1e3 * wall / len(frames), "model_cpu_ms": 1e3 * cpu / len(frames)}
        both = [{**yardstick.scores(frames), **times} for yardstick in yardsticks]
        for yardstick, row in zip(yardsticks, both, strict=True):
            yardstick.add_bake(rays, row)
        steady = (
            yardsticks[0].flicker(lambda mesh, n=rays: bake_pose(mesh, rows, BANDS, n, 0)) if rays == STEADY else {}
        )
        found.append({"method": f"bake, {rays} rays", **both[0], **steady})
    return found


def fitted_models(
    poses: TrainingPoses, sizes: Sequence[float]
) -> Iterator[tuple[str, RunConfig, dict[str, Any], float]]:
    """Name, config, arrays and CPU seconds of the fit of `momo-prt`, and of `deform` cut to every size."""
    linear: Any = load_config("momo-prt")
    ours: Any = load_config("deform")
    started = time.process_time()
    arrays = fit_momo(linear.model, poses)
    yield "momo-prt", linear, arrays, time.process_time() - started
    started = time.process_time()
    found = fit_patches(ours.model, poses)
    seconds = time.process_time() - started
    for size in sizes:
        started = time.process_time()
        arrays = cut_to_size(found, poses.animation.mesh, size)
        yield f"deform, {size:g} MB", ours, arrays, seconds + time.process_time() - started


def fitted_rows(
    poses: TrainingPoses,
    test: Frames,
    yardstick: Yardstick,
    folder: Path,
    sizes: Sequence[float],
    told: str = "",
) -> list[dict[str, Any]]:
    """The rows of what is fitted in one piece, `told` behind their names; the last model stays in the folder."""
    rows, path = [], folder / "model.npz"
    for name, config, arrays, seconds in fitted_models(poses, sizes):
        save_deforming_model(path, config.model, arrays, poses.animation.mesh)
        row = model_row(name + told, load_deforming_model(path), path, test, yardstick)
        rows.append({**row, "fit_cpu_seconds": seconds})
    return rows


def other_rows(also: Sequence[str], test: Frames, whole: Yardstick, three: Yardstick) -> list[dict[str, Any]]:
    """The shipped `local`, and models that were trained before: NAME=RUN each."""
    rows = []
    for text in ("local=local", *also):
        name, _, place = text.partition("=")
        path = None if place == "local" else deforming_model_file(place)
        if path is not None and is_deforming(path):
            rows.append(model_row(name, load_deforming_model(path), path, test, whole))
        else:
            predict = deforming_predictor(load_model(place), test.meshes[0])
            row = method_row(f"{name}, 3 bands", lambda mesh, p=predict: p(mesh.vertices)[0], test, three)
            rows.append(row | three.against_bakes(row["relrmse"]))
    return rows


def more_rows(
    more: tuple[int, int], data: Sequence[str], test: Frames, yardstick: Yardstick, folder: Path
) -> tuple[list[dict[str, Any]], float]:
    """The rows of what is fitted to other frames, so many of so many rays, and the CPU seconds that one took."""
    frames, rays = more
    scene = split_animation(load_config("deform", [*data, f"data.frames={frames}"]).data).training
    truth = bake_truth(scene, BANDS, rays)
    poses, told = TrainingPoses(scene.receivers, truth.shards()), f", {frames} frames of {rays} rays"
    return fitted_rows(poses, test, yardstick, folder, MEGABYTES[:3:2], told), truth.cpu_seconds


def in_time(test: Truth, follow: bool, rays: int) -> Frames | None:
    """Frames that follow one another: the test frames, a path between them, or none where there is no path."""
    if follow:
        return frames_of(test)
    if not len(test.scene.animation.shape_weights[0]):
        return None
    path = MovingScene(path_of_poses(test.scene.animation, PATH, POSES), test.scene.rows)
    return frames_of(bake_truth(path, BANDS, rays))


def main(
    object: str,
    animation: Path | None,
    vertices: str,
    frames: int,
    test_frames: int,
    rays: int,
    test_rays: int,
    more: tuple[int, int] | None,
    also: Sequence[str],
    work: Path,
    output: Path | None,
) -> dict[str, Any]:
    """Fit and measure everything on one object."""
    data = [f"data.animation={object_file(object, animation, work)}", f'data.vertices="{vertices}"']
    data += [f"data.test_frames={test_frames}", f"data.poses={OBJECTS[object].split}"]
    split = split_animation(load_config("deform", [*data, f"data.frames={frames}"]).data)
    truth, test_truth = bake_truth(split.training, BANDS, rays), bake_truth(split.test, BANDS, test_rays)
    poses, mesh = TrainingPoses(split.training.receivers, truth.shards()), split.training.receivers.mesh
    ranges, test = coefficient_ranges(poses.shards), frames_of(test_truth)
    along = in_time(test_truth, OBJECTS[object].follow, test_rays)
    whole, three = (Yardstick(test, along, ranges, bands) for bands in (BANDS, 3))
    work.mkdir(parents=True, exist_ok=True)
    bakes = bake_rows(test, split.test.rows, (whole, three))
    rows = [*floors(truth.coefficients(), test, whole), *fitted_rows(poses, test, whole, work, MEGABYTES)]
    found, seconds = more_rows(more, data, test, whole, work) if more else ([], 0.0)
    rows = [row | whole.against_bakes(row["relrmse"]) for row in rows + found] + other_rows(also, test, whole, three)
    arguments = {"frames": len(truth), "test_frames": len(test.meshes), "rays": rays, "test_rays": test_rays}
    baked = {"training": truth.cpu_seconds, "test": test_truth.cpu_seconds, **({"more": seconds} if more else {})}
    sizes = {"name": OBJECTS[object].title, "poses": OBJECTS[object].poses, "vertices": len(mesh.vertices)}
    sizes["coefficient_bytes"] = 2 * len(mesh.vertices) * BANDS**2 * len(truth)
    told = {**sizes, "cpu_seconds_a_baked_frame": baked, "rows": rows + bakes}
    return saved(output, {**provenance(seed=0, arguments={**arguments, "bands": BANDS}), **told})


if __name__ == "__main__":
    asked = parser(__doc__, "output")
    asked.add_argument("--object", choices=OBJECTS, default="bumps")
    asked.add_argument("--animation", type=Path, help="its file, where it is not generated")
    asked.add_argument("--vertices", default="", help="part of it, FIRST:LAST")
    asked.add_argument(
        "--also", action="append", default=[], metavar="NAME=RUN", help="a model that was trained before"
    )
    for option, count in (("frames", 450), ("test-frames", 50), ("rays", 256), ("test-rays", 4096)):
        asked.add_argument(f"--{option}", type=int, default=count)
    asked.add_argument(
        "--more", type=lambda text: tuple(map(int, text.split(":"))), metavar="FRAMES:RAYS", help="other frames to fit"
    )
    asked.add_argument("--work", type=Path, default=Path("runs/deforming"), help="folder for what is written meanwhile")
    main(**vars(asked.parse_args()))
