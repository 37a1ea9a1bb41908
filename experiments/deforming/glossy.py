"""Models of the radiance that arrives at a glossy object under a light, beside bakes of it: error, bytes, milliseconds.

    gash train momo-prt data.animation=cloth.npz data.poses=between data.light=studio -o runs/linear
    gash train deep-prt-small data.animation=cloth.npz data.poses=between data.light=studio -o runs/images
    .venv/bin/python -m experiments.deforming.glossy --run momo-prt=runs/linear --run deep-prt-small=runs/images \
        --output docs/results/deforming_glossy.json

All runs have the same frames and the same light. What is said of a vertex is M L of `light.gloss`, three colours of 16
coefficients; *mean* is the mean of the training frames.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.options import parser, saved
from gash_jax.files.settings import ConfigError
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.deforming import SequenceScores
from gash_jax.measure.provenance import provenance
from gash_jax.measure.timing import timed_on_both_clocks
from gash_jax.models.deforming_model import DeformingModel, load_deforming_model
from gash_jax.prt.sequence import bake_frame, posed_meshes
from gash_jax.train.config import load_config
from gash_jax.train.deforming_run import rays_of_frames, score_model, split_animation
from gash_jax.train.target import flat_radiance, target_frames, target_shards
from gash_jax.train.truth import bake_truth

RAYS = (64, 256)


def scored(
    estimates: Sequence[np.ndarray], references: Sequence[np.ndarray], meshes: Sequence[Mesh], ranges: np.ndarray
) -> dict[str, float]:
    """The measures of estimates of all test frames."""
    sums = SequenceScores(ranges)
    for estimate, reference, mesh in zip(estimates, references, meshes, strict=True):
        sums.add(estimate, reference, mesh.normals)
    return sums.scores()


def bake_row(
    rays: int, scene: Any, model: DeformingModel, references: Sequence[np.ndarray], meshes: Sequence[Mesh]
) -> dict[str, Any]:
    """A glossy bake of every test frame with few rays, and its radiance."""
    light: Float[np.ndarray, "k 3"] = model.light  # type: ignore[assignment]
    started, found = time.perf_counter(), []
    for number, mesh in enumerate(posed_meshes(scene.animation)):
        baked = bake_frame(mesh, scene.rows, model.config.bands, rays, 1000 + number, glossy=True)
        found.append(flat_radiance(baked["visibility"], light))
    taken = 1e3 * (time.perf_counter() - started) / len(found)
    scores = scored(found, references, meshes, np.array(model.metadata["ranges"]))
    return {"method": f"glossy bake, {rays} rays", **scores, "model_ms": taken}


def main(run: Sequence[str], output: Path | None) -> dict[str, Any]:
    """Measure trained runs, NAME=FOLDER each. Raises ConfigError where there is none."""
    if not run:
        raise ConfigError("give a trained run, --run NAME=FOLDER")
    named = [(text.partition("=")[0], Path(text.partition("=")[2])) for text in run]
    config = load_config(named[0][1] / "config.json")
    data, bands, models = config.data, config.model.bands, [load_deforming_model(folder) for _, folder in named]
    split, light = split_animation(data), models[0].light
    few = rays_of_frames(data, len(split.training.animation))
    truth, test = (
        bake_truth(scene, bands, rays, glossy=True)
        for scene, rays in ((split.training, few), (split.test, data.test_rays))
    )
    references, meshes = list(target_frames(test, light)), list(posed_meshes(split.test.receivers))
    ranges = np.array(models[0].metadata["ranges"])
    shards = target_shards(truth, light)
    mean = np.asarray(np.mean(np.concatenate(shards), axis=0, dtype=np.float64), np.float32)
    rows = [{"method": "mean", **scored([mean] * len(meshes), references, meshes, ranges)}]
    for (name, folder), model in zip(named, models, strict=True):
        _, spent = timed_on_both_clocks(lambda model=model: model.outputs(meshes[0]), 9)
        size, fit = (folder / "model.npz").stat().st_size, model.metadata["fit_seconds"]["cpu"]
        row = {"method": name, **score_model(model, test), "bytes": size, "fit_cpu_seconds": fit}
        rows.append({**row, "model_ms": 1e3 * spent.wall})
    rows += [bake_row(rays, split.test, models[0], references, meshes) for rays in RAYS]
    arguments = {"rays": few, "test_rays": data.test_rays, "bands": bands, "light": data.light}
    seconds = {"training": truth.cpu_seconds, "test": test.cpu_seconds}
    told = {"animation": Path(data.animation).stem, "frames": len(truth), "test_frames": len(test)}
    return saved(
        output,
        {**provenance(seed=0, arguments=arguments), **told, "cpu_seconds_a_baked_frame": seconds, "rows": rows},
    )


if __name__ == "__main__":
    asked = parser(__doc__, "output")
    asked.add_argument("--run", action="append", default=[], metavar="NAME=FOLDER", help="a run that was trained")
    main(**vars(asked.parse_args()))
