"""Models of a face within the poses that they were fitted to, and leaving them, as in figure 6 of DeepPRT.

    .venv/bin/python -m experiments.deforming.leaving --animation ict_face_expressions.npz --vertices 0:11248 \
        --images 600 --output docs/results/leaving.json --figure docs/results/leaving.png

*To a plane*: shapes between the rest and a flat sheet, its map to the square; all models are fitted to some of them,
and tested on others. *A shape left out*: fitted to the random expressions that do not have it, tested from the rest
to twice the shape. `--images` is the training of the U-Net on each, in CPU seconds of each core; 0 leaves it
out.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from benchmarks.options import parser, saved
from experiments.deforming.objects import object_file
from experiments.deforming.run import BANDS
from experiments.deforming.yardstick import Frames, frames_of
from gash_jax.geometry.animation import Animation, Blend, blend_rows
from gash_jax.geometry.geometry_image import geometry_image
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.measure.deforming import SequenceScores, coefficient_ranges
from gash_jax.measure.provenance import provenance
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import DeformingModel
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import moving_scene
from gash_jax.train.config import load_config
from gash_jax.train.deforming_run import split_animation
from gash_jax.train.image_training import fit_deep_prt
from gash_jax.train.truth import bake_truth

STEPS, BETWEEN, TEXELS = 11, 60, 256


def flat_sheet(rest: Mesh) -> np.ndarray:
    """The rest's map to the square as a sheet that faces +z, as wide as the rest is high, about its middle."""
    image = geometry_image(parameterise(rest), TEXELS)
    rows, columns = np.mgrid[:TEXELS, :TEXELS] / (TEXELS - 1) - 0.5
    place = np.asarray(image.from_image(np.stack([columns, rows, 0 * rows], axis=-1).astype(np.float32)))
    low, high = rest.vertices.min(axis=0), rest.vertices.max(axis=0)
    return (place * (high - low)[1] + (low + high) / 2).astype(np.float32)


def to_plane(rest: Mesh, parts: np.ndarray) -> Animation:
    """Shapes that are so far from the rest (0) to the sheet (1)."""
    deltas = (flat_sheet(rest) - rest.vertices)[None]
    motion = Blend(rest.vertices, deltas, np.zeros((len(rest.vertices), 0)))
    return Animation(rest, blend_rows(parts[:, None], np.zeros((len(parts), 0, 3, 4))), ("plane",), motion)


def without_shape(poses: TrainingPoses, number: int) -> TrainingPoses:
    """The training frames that do not have a shape."""
    kept = poses.animation.parameters[:, number] == 0
    coefficients = np.concatenate([np.asarray(shard) for shard in poses.shards])[kept]
    return TrainingPoses(poses.animation._replace(parameters=poses.animation.parameters[kept]), [coefficients])


def fitted_models(poses: TrainingPoses, images: float, folder: Path) -> dict[str, DeformingModel]:
    """Every model, fitted to the same poses."""
    names = ["momo-prt", "deform", *(["deep-prt-small"] if images else [])]
    found, mesh = {}, poses.animation.mesh
    for name in names:
        config = load_config(name, [f"train.seconds={images}"] if name == "deep-prt-small" else [])
        fit = DEFORMING[config.model.name].fit
        arrays = fit(config.model, poses) if fit else fit_deep_prt(config, poses, folder, lambda part: None)
        found[name] = DeformingModel(config.model, arrays, mesh, {})
    return found


def errors_along(
    models: dict[str, DeformingModel], mean: Any, ranges: np.ndarray, test: Frames
) -> list[dict[str, Any]]:
    """relrmse and accuracy of every test frame by every model, and by the mean of the training frames."""
    rows = []
    for name in ("mean", *models):
        frames = []
        for mesh, reference in zip(*test, strict=True):
            said = mean if name == "mean" else np.asarray(models[name].coefficients(mesh))
            sums = SequenceScores(ranges)
            sums.add(said, reference, mesh.normals)
            frames.append(sums.scores())
        rows.append({"method": name, **{key: [frame[key] for frame in frames] for key in ("relrmse", "accuracy")}})
    return rows


def journey(poses: TrainingPoses, test: Animation, rays: int, images: float, folder: Path) -> dict[str, Any]:
    """All models on the way from the rest to the end of `test`."""
    folder.mkdir(parents=True, exist_ok=True)
    mean = np.mean([np.asarray(shard, np.float32).mean(axis=0) for shard in poses.shards], axis=0)
    held = frames_of(bake_truth(moving_scene(test), BANDS, rays))
    models = fitted_models(poses, images, folder)
    rows = errors_along(models, mean, coefficient_ranges(poses.shards), held)
    return {"training_frames": len(poses.animation), "rows": rows}


def draw(result: dict[str, Any], path: Path) -> None:
    """Error against the distance from the rest, a panel for each journey."""
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    panels = figure.subplots(1, len(result["journeys"]))
    for axes, (name, told) in zip(panels, result["journeys"].items(), strict=True):
        for row in told["rows"]:
            axes.plot(told["distance"], row["relrmse"], marker="o", markersize=3, label=row["method"])
        axes.set(title=name, xlabel=told["from_to"], ylabel="relrmse", yscale="log")
        axes.grid(alpha=0.3)
    panels[-1].legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=120)


def main(
    animation: Path | None,
    vertices: str,
    shape: str,
    frames: int,
    rays: int,
    test_rays: int,
    images: float,
    work: Path,
    output: Path | None,
    figure: Path | None,
) -> dict[str, Any]:
    """Both journeys of one face."""
    file = object_file("bumps" if animation is None else "face", animation, work)
    data = [f"data.animation={file}", f'data.vertices="{vertices}"', f"data.frames={frames}"]
    scene = split_animation(load_config("deform", data).data).training
    moving, along = scene.receivers, np.linspace(0, 1, STEPS)
    number = moving.names.index(shape)
    random = TrainingPoses(moving, bake_truth(scene, BANDS, rays).shards())
    weights = np.zeros((STEPS, len(moving.names)))
    weights[:, number] = 2 * along
    further = moving._replace(parameters=blend_rows(weights, np.zeros((STEPS, 0, 3, 4))), seconds=None)
    between = to_plane(moving.mesh, np.random.default_rng(0).uniform(0, 1, min(BETWEEN, frames)))
    flat = TrainingPoses(between, bake_truth(moving_scene(between), BANDS, rays).shards())
    ways = {
        "to a plane": (flat, to_plane(moving.mesh, along), "rest (0) to plane (1)", along),
        f"{shape} left out": (without_shape(random, number), further, "weight of the shape", 2 * along),
    }
    journeys = {}
    for name, (poses, test, told, distance) in ways.items():
        found = journey(poses, test, test_rays, images, work / name.replace(" ", "_"))
        journeys[name] = {"from_to": told, "distance": distance.tolist(), **found}
    arguments = {"rays": rays, "test_rays": test_rays, "images": images, "bands": BANDS}
    result = {**provenance(seed=0, arguments=arguments), "journeys": journeys}
    if figure:
        draw(result, figure)
    return saved(output, result)


if __name__ == "__main__":
    asked = parser(__doc__, "output")
    asked.add_argument("--animation", type=Path, help="blendshapes; without it a generated body")
    asked.add_argument("--vertices", default="", help="part of it, FIRST:LAST")
    asked.add_argument("--shape", default="jawOpen", help="the shape that is left out")
    for option, count in (("frames", 450), ("rays", 256), ("test-rays", 4096)):
        asked.add_argument(f"--{option}", type=int, default=count)
    asked.add_argument(
        "--images", type=float, default=600.0, help="CPU seconds of each core, of the U-Net; 0: without it"
    )
    asked.add_argument("--work", type=Path, default=Path("runs/leaving"), help="folder for what is written meanwhile")
    asked.add_argument("--figure", type=Path, help="draw the errors")
    main(**vars(asked.parse_args()))
