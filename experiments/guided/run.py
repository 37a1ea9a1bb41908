"""What the guided bake is worth: its error beside that of the plain bake and of its own rays, and what it says of it.

    .venv/bin/python -m experiments.guided.run --meshes FOLDER --output experiments/guided/results.json

FOLDER holds .ply files: those of the networks' trial. Beside them stand generated shapes that the network was not
trained on. Mean square errors are means over the seeds; `score` is the root mean square of error over predicted error,
over all coefficients where the latter is above 1e-4.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import options, saved
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.apps.progress import progress_bar
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.provenance import provenance
from gash_jax.models.guided import GuidedBake, rebuild
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.few_rays import LARGEST_ROW
from gash_jax.prt.integrands import to_world
from gash_jax.shapes.procedural import make_shape

RAYS = (8, 16, 32, 64)
SHAPES, SHAPE_SEED = 12, 61
SEEDS, REFERENCE = 8, 4096


def measure(mesh: Mesh, rays: int, seeds: int, reference: np.ndarray) -> dict[str, Any]:
    """Mean square errors of the plain bake, of the rays of the guided bake, and of the guided bake; its score."""
    errors, scores = {"plain": 0.0, "own": 0.0, "guided": 0.0}, []
    for seed in range(seeds):
        bake = GuidedBake(mesh, 3, min(rays, LARGEST_ROW), rays, seed, "embree", [])
        few, surface = bake.first()
        few = bake.add(few, np.full(len(bake.active), rays))
        rebuilt, truth = rebuild(few, surface), reference[bake.active]
        own = np.asarray(to_world(few.local[:, None], bake.rows.frames))[:, 0]
        plain = bake_transfer(mesh, rays=rays, replicates=1, seed=1000 + seed).coefficients[bake.active]
        for name, found in (("plain", plain), ("own", own), ("guided", rebuilt.coefficients)):
            errors[name] += float(np.mean((found - truth) ** 2)) / seeds
        said = np.sqrt(rebuilt.variance)
        scores.append(np.mean(((rebuilt.coefficients - truth)[said > 1e-4] / said[said > 1e-4]) ** 2))
    return {"rays": rays, **errors, "score": float(np.sqrt(np.mean(scores)))}


def main(meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    loaded = {
        f"generated {index} ({kind})": mesh
        for index in range(2 if quick else SHAPES)
        for kind, mesh in [make_shape(SHAPE_SEED, index, (300, 600) if quick or index % 2 else (4000, 8000))]
    }
    if meshes:
        loaded |= {
            name: read() for name, read in load_meshes(meshes, quick).items() if not name.startswith("generated")
        }
    results: dict[str, Any] = {**provenance(seed=SHAPE_SEED), "seeds": 2 if quick else SEEDS, "rows": []}
    with progress_bar(f"{len(loaded)} meshes") as update:
        for step, (name, mesh) in enumerate(loaded.items()):
            reference = bake_transfer(mesh, rays=256 if quick else REFERENCE, seed=77).coefficients
            for rays in RAYS[:1] if quick else RAYS:
                row = measure(mesh, rays, results["seeds"], reference)
                if row["own"] > 1e-9:  # else nothing is hidden, and nothing to compare
                    results["rows"].append({"mesh": name, "vertices": len(mesh.vertices), **row})
            saved(output, results)
            update(step + 1, len(loaded))
    for rays in sorted({row["rays"] for row in results["rows"]}):
        rows = [row for row in results["rows"] if row["rays"] == rays]
        ratio, own = ([row["guided"] / row[name] for row in rows] for name in ("plain", "own"))
        print(f"{rays} rays: {np.median(ratio):.2f} of the plain error, at most {max(own):.2f} of its own rays'")
    return results


if __name__ == "__main__":
    main(**options(__doc__, "meshes", "output", "quick"))
