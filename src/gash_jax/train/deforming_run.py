"""From an animation to a model of the object that deforms: poses, ground truth, fit or training, test.

A run folder holds `config.json`, `model.npz` and `scores.json`: the measures on test frames that were not trained on.
What was baked is kept (`truth`), so a run that was interrupted goes on with the frames that are left.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gash_jax.files.atomic import write_json
from gash_jax.files.settings import ConfigError
from gash_jax.formats.animations import load_animation
from gash_jax.geometry.animation import Animation
from gash_jax.measure.deforming import SequenceScores, coefficient_ranges
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import LIGHT, DeformingModel, load_deforming_model, save_deforming_model
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import MovingScene, moving_scene, posed_meshes
from gash_jax.shapes.deformations import has_random_poses, random_poses
from gash_jax.train.config import DataConfig, RunConfig
from gash_jax.train.image_training import fit_deep_prt
from gash_jax.train.loop import open_folder
from gash_jax.train.target import target_frames, target_light, target_shards
from gash_jax.train.truth import Truth, bake_truth

Progress = Callable[[int, int], None]
SCORES = "scores.json"
ALL_RAYS, FEWEST_RAYS, MOST_RAYS = 115_200, 64, 256  # of all frames together, and of one, where `data.rays` is 0
TRAINING = 1000  # parts of a progress bar for what is trained step by step, beside its frames


class Split(NamedTuple):
    """What a model is fitted to, and what it is tested on."""

    training: MovingScene
    test: MovingScene


def split_animation(data: DataConfig) -> Split:
    """The frames of a config: random poses of blendshapes, or those of the file, of which the last are for the test.

    Raises ConfigError where there are too few, or no animation is named.
    """
    if not data.animation:
        raise ConfigError("this model is of one object that deforms: name its file, data.animation=FILE")
    animation = load_animation(data.animation)
    if data.poses == "random" or (data.poses == "auto" and has_random_poses(animation)):
        parts = [
            random_poses(animation, data.seed, count, held_out)
            for count, held_out in ((data.frames, False), (data.test_frames, True))
        ]
    else:
        parts = _frames_of_file(animation, data)
    return Split(*(moving_scene(part, data.vertices, data.rest) for part in parts))


def _frames_of_file(animation: Animation, data: DataConfig) -> list[Animation]:
    count = len(animation)
    test = min(data.test_frames, count // 5 or 1)
    if count - test < 2:
        raise ConfigError(
            f"{data.animation} has {count} frames: a model needs two to be fitted to and one to be tested on; bake it "
            "with gash animate"
        )
    held = np.arange(count - test, count)
    if data.poses == "between":
        held = ((np.arange(test) + 0.5) * count / test).astype(int)
    ends, seconds = (np.setdiff1d(np.arange(count), held)[: data.frames], held), animation.seconds
    return [
        animation._replace(parameters=animation.parameters[part], seconds=None if seconds is None else seconds[part])
        for part in ends
    ]


def rays_of_frames(data: DataConfig, frames: int) -> int:
    """Rays per vertex of each of so many training frames.

    A fit averages over frames, so noise matters less than poses: a face has a seventh less error from 1800 frames of
    64 rays than from 450 of 256. What a recording lacks in frames it gets in rays.

    >>> [rays_of_frames(DataConfig(rays=0), frames) for frames in (40, 450, 900, 1800, 9000)]
    [256, 256, 128, 64, 64]
    """
    return data.rays or min(max(ALL_RAYS // frames, FEWEST_RAYS), MOST_RAYS)


def run_deforming(config: RunConfig, folder: Path, progress: Progress | None = None) -> tuple[Path, dict[str, Any]]:
    """Bake what a config needs, fit its model, test it; the model's file and its scores on the test frames."""
    data, bands, split = config.data, config.model.bands, split_animation(config.data)
    light = target_light(data.light, bands)
    glossy = light is not None
    open_folder(folder, config)
    first, frames = len(split.training.animation), len(split.training.animation) + len(split.test.animation)
    report, fit = progress or (lambda done, total: None), DEFORMING[config.model.name].fit
    total = frames + (1 if fit else TRAINING)
    rays = rays_of_frames(data, first)
    truth = bake_truth(split.training, bands, rays, lambda done, _: report(done, total), glossy)
    test = bake_truth(split.test, bands, data.test_rays, lambda done, _: report(first + done, total), glossy)
    started = time.process_time(), time.perf_counter()
    poses = TrainingPoses(split.training.receivers, target_shards(truth, light))
    if fit:
        arrays = fit(config.model, poses)
    else:
        arrays = fit_deep_prt(config, poses, folder, lambda part: report(frames + int(part * (TRAINING - 1)), total))
    if glossy:
        arrays = {**arrays, LIGHT: light}
    taken = {"cpu": time.process_time() - started[0], "wall": time.perf_counter() - started[1]}
    ranges = coefficient_ranges(poses.shards)
    entries = {"name": config.name, "run": config.to_dict(), "ranges": ranges.tolist(), "fit_seconds": taken}
    path = folder / "model.npz"
    save_deforming_model(path, config.model, arrays, poses.animation.mesh, **entries)
    baked = {"training": truth.cpu_seconds, "test": test.cpu_seconds}
    result = {
        **score_model(load_deforming_model(path), test),
        **{
            "frames": first,
            "rays": rays,
            "test_frames": len(test),
            "fit_seconds": taken,
            "cpu_seconds_a_baked_frame": baked,
        },
        "bytes": path.stat().st_size,
    }
    write_json(folder / SCORES, result)
    report(total, total)
    return path, result


def score_model(model: DeformingModel, truth: Truth, flicker: bool = False) -> dict[str, float]:
    """The measures of a model on baked frames, glossy ones for a model of radiance."""
    scores = SequenceScores(np.array(model.metadata["ranges"]))
    frames = target_frames(truth, model.light)
    for mesh, reference in zip(posed_meshes(truth.scene.receivers), frames, strict=True):
        scores.add(np.asarray(model.outputs(mesh)), reference, mesh.normals)
    return scores.scores(flicker)
