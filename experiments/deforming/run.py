"""Models of one object that deforms beside what is simpler, and beside baking: error, bytes, milliseconds a frame.

    .venv/bin/python -m experiments.deforming.run --animation ict_face_expressions.npz --vertices 0:11248 \
        --name "ICT face" --output FILE.json

All are fitted to the same frames and held against the same test frames, random sparse expressions (1 to 8 shapes at
weights U(0, 1)) of other seeds. *PCA floor*: the best that any model can do whose coefficients are the mean and so
many components of those of the training frames. `deform` is fitted once, and cut to fewer numbers of a patch's pose.
Without --animation a generated body with bumps, small.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.options import parser, saved
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.deforming import SequenceScores, coefficient_ranges
from gash_jax.measure.provenance import provenance
from gash_jax.measure.timing import timed_on_both_clocks
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import load_deforming_model, save_deforming_model
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import bake_pose, posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.config import RunConfig, load_config
from gash_jax.train.deforming_run import split_animation
from gash_jax.train.truth import Truth, bake_truth

RANKS, COMPONENTS, RAYS, BAKED = (8, 16, 24, 48), (20, 40, 80, 160), (64, 128, 256), 10


def generated(folder: Path) -> Path:
    """A body with bumps as a file of blendshapes."""
    folder.mkdir(parents=True, exist_ok=True)
    moving, path = blendshape_animation(bumpy_sphere(8), 0, 2, 8), folder / "bumps.npz"
    motion: Any = moving.motion
    np.savez(path, base=motion.rest, delta=motion.deltas, faces=moving.mesh.faces, names=np.array(moving.names))
    return path


def scored(test: Truth, ranges: np.ndarray, estimates: Any) -> dict[str, float]:
    """Scores of the estimates of as many test frames as there are."""
    scores, references = SequenceScores(ranges), (frame for shard in test.shards() for frame in shard)
    for mesh, reference, estimate in zip(posed_meshes(test.scene.receivers), references, estimates, strict=False):
        scores.add(np.asarray(estimate), reference, mesh.normals)
    return scores.scores()


def floors(training: Float[np.ndarray, "t v k"], test: Truth, ranges: np.ndarray) -> list[dict[str, Any]]:
    """The mean of the training frames, and the floors of their principal components."""
    flat = training.reshape(len(training), -1).astype(np.float32)
    mean = flat.mean(axis=0)
    flat -= mean
    values, vectors = np.linalg.eigh((flat @ flat.T).astype(np.float64))
    order = np.argsort(-values)
    rows = [
        {
            "method": "mean of the training frames",
            **scored(test, ranges, [mean.reshape(training.shape[1:])] * len(test)),
        }
    ]
    told = test.coefficients().astype(np.float32).reshape(len(test), -1) - mean
    for count in [count for count in COMPONENTS if count < len(training)]:
        kept = order[:count]
        basis = (vectors[:, kept] / np.sqrt(np.maximum(values[kept], 1e-30))).T.astype(np.float32) @ flat
        found = (told @ basis.T) @ basis + mean
        frames = found.reshape(len(test), *training.shape[1:])
        rows.append({"method": f"PCA floor, {count} components", **scored(test, ranges, frames)})
    return rows


def fitted(config: RunConfig, poses: TrainingPoses) -> tuple[dict[str, Any], float]:
    """Arrays of a model, and the CPU seconds of its fit."""
    started, fit = time.process_time(), DEFORMING[config.model.name].fit
    assert fit is not None
    return fit(config.model, poses), time.process_time() - started


def model_row(
    name: str, config: RunConfig, arrays: dict[str, Any], mesh: Mesh, test: Truth, ranges: np.ndarray, folder: Path
) -> dict[str, Any]:
    """Scores, size and speed of a model."""
    path = folder / "model.npz"
    save_deforming_model(path, config.model, arrays, mesh)
    model = load_deforming_model(path)
    frames = [model(positions) for positions in test.scene.receivers.frames()]
    positions = test.scene.receivers.frame(0)
    pose = model.pose(positions)
    _, normals = timed_on_both_clocks(lambda: model.pose(positions))
    _, network = timed_on_both_clocks(lambda: model.coefficients(pose), 9)
    times = {"normals_ms": 1e3 * normals.wall, "model_ms": 1e3 * network.wall, "model_cpu_ms": 1e3 * network.cpu}
    return {"method": name, **scored(test, ranges, frames), "bytes": path.stat().st_size, **times}


def bake_rows(test: Truth, ranges: np.ndarray) -> list[dict[str, Any]]:
    """Bakes of few rays on the first test frames."""
    rows, scene = [], test.scene
    meshes = list(posed_meshes(scene.animation, 0, BAKED))
    for rays in RAYS:
        started = time.process_time(), time.perf_counter()
        frames = [bake_pose(mesh, scene.rows, test.bands, rays, 1000 + number) for number, mesh in enumerate(meshes)]
        cpu, wall = (
            clock() - start for clock, start in zip((time.process_time, time.perf_counter), started, strict=True)
        )
        times = {"model_ms": 1e3 * wall / len(meshes), "model_cpu_ms": 1e3 * cpu / len(meshes)}
        rows.append({"method": f"bake, {rays} rays", **scored(test, ranges, frames), **times})
    return rows


def main(
    animation: Path | None,
    vertices: str,
    name: str,
    frames: int,
    test_frames: int,
    rays: int,
    test_rays: int,
    work: Path,
    output: Path | None,
) -> dict[str, Any]:
    """Fit and measure everything on one object."""
    path = generated(work) if animation is None else animation
    data = [f"data.animation={path}", f'data.vertices="{vertices}"', f"data.frames={frames}"]
    data += [f"data.test_frames={test_frames}", f"data.rays={rays}", f"data.test_rays={test_rays}"]
    linear, ours = load_config("momo-prt", data), load_config("deform", [*data, f"model.rank={max(RANKS)}"])
    split = split_animation(ours.data)
    truth, test = bake_truth(split.training, 4, rays), bake_truth(split.test, 4, test_rays)
    poses, mesh = TrainingPoses(split.training.receivers, truth.shards()), split.training.receivers.mesh
    ranges = coefficient_ranges(poses.shards)
    work.mkdir(parents=True, exist_ok=True)
    rows = floors(truth.coefficients(), test, ranges)
    arrays, seconds = fitted(linear, poses)
    rows.append({**model_row("momo-prt", linear, arrays, mesh, test, ranges, work), "fit_cpu_seconds": seconds})
    arrays, seconds = fitted(ours, poses)
    for rank in RANKS:
        cut = {**arrays, "basis": arrays["basis"][..., :rank], "weights": arrays["weights"][..., :rank]}
        row = model_row(f"deform, {rank} numbers", ours, cut, mesh, test, ranges, work)
        rows.append({**row, "fit_cpu_seconds": seconds})
    rows += bake_rows(test, ranges)
    arguments = {"frames": frames, "test_frames": test_frames, "rays": rays, "test_rays": test_rays, "bands": 4}
    baked = {"training": truth.cpu_seconds, "test": test.cpu_seconds}
    sizes = {"name": name, "vertices": len(mesh.vertices), "coefficient_bytes": 2 * len(mesh.vertices) * 16 * frames}
    result = {**provenance(seed=0, arguments=arguments), **sizes, "cpu_seconds_a_baked_frame": baked, "rows": rows}
    return saved(output, result)


if __name__ == "__main__":
    asked = parser(__doc__, "output")
    asked.add_argument("--animation", type=Path, help="blendshapes (.npz)")
    asked.add_argument("--vertices", default="", help="part of it, FIRST:LAST")
    asked.add_argument("--name", default="generated", help="what the object is called in the table")
    for option, count in (("frames", 450), ("test-frames", 50), ("rays", 256), ("test-rays", 4096)):
        asked.add_argument(f"--{option}", type=int, default=count)
    asked.add_argument("--work", type=Path, default=Path("runs/deforming"), help="folder for what is written meanwhile")
    main(**vars(asked.parse_args()))
