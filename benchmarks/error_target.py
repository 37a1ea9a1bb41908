"""Is the target met, and with how many rays: `.venv/bin/python -m benchmarks.error_target FOLDER [--output FILE]`.

Every mesh of a folder is baked to 0.1, 0.05 and 0.02 and held against a reference of 4096 rays (its own noise, from
its error bars, is taken out of the squared error) on at most 6000 of its vertices, drawn at random. `rays` is the
mean per vertex; `plain` what the uniform plain bake needs for the same true error, log-log interpolated over 4 to 1024
rays; the plan's prediction stands beside. Meshes without transfer are listed and left out.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import parser, saved
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import MeshError
from gash_jax.measure.metrics import calibration
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_target import bake_to_error
from gash_jax.prt.plan import plan_bake

ERRORS, PLAIN, REFERENCE = (0.1, 0.05, 0.02), (4, 8, 16, 32, 64, 128, 256, 512, 1024), 4096
MOST_JUDGED = 6000


def measure(path: Path) -> list[dict]:
    """Rows of one mesh, one for each target."""
    mesh = load_mesh(path)
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    judged = np.random.default_rng(0).permutation(active)[:MOST_JUDGED]
    normals = np.zeros_like(mesh.normals)
    normals[judged] = mesh.normals[judged]
    some = mesh._replace(normals=normals)  # the whole mesh, but rays from the judged vertices only
    baked = bake_transfer(some, rays=REFERENCE, seed=1234)
    assert baked.standard_error is not None
    reference = baked.coefficients[judged]
    energy = float(np.sum(reference.astype(np.float64) ** 2))
    if energy == 0:
        print(f"{path.stem}: no transfer")
        return []
    share = reference[:, 0] / 0.28209479
    partly = (share > 1e-3) & (share < 1 - 1e-3)
    noise = float(np.sum(baked.standard_error[judged][partly].astype(np.float64) ** 2))

    def true_error(found: np.ndarray) -> float:
        squared = float(np.sum((found.astype(np.float64) - reference) ** 2))
        return float(np.sqrt(max(squared - noise, 0.0) / energy))

    plain = [bake_transfer(some, rays=n, replicates=1, seed=5).coefficients[judged] for n in PLAIN]
    errors = [true_error(found) for found in plain]
    curve = np.minimum.accumulate(np.maximum(errors, 1e-9))
    rows = []
    for error in ERRORS:
        plan = plan_bake(mesh, error)
        found = bake_to_error(mesh, error)
        assert found.standard_error is not None
        true = true_error(found.coefficients[judged])
        rays = found.metadata["rays_total"] / len(active)
        needed = float(np.exp(np.interp(-np.log(max(true, 1e-9)), -np.log(curve), np.log(PLAIN))))
        score, coverage = (
            calibration((found.coefficients[judged] - reference)[partly], found.standard_error[judged][partly])
            if partly.any()
            else (None, None)
        )
        rows.append(
            {
                "mesh": path.stem,
                "error": error,
                "true": true,
                "estimated": found.metadata["estimated_error"],
                "rays": rays,
                "plain": needed,
                "ratio": rays / needed,
                "planned_rays": plan.rays_per_vertex,
                "planned_s": plan.seconds,
                "seconds": found.metadata["seconds"]["total"],
                "z": score,
                "coverage": coverage,
            }
        )
        print(
            f"{path.stem:22s} {error:5.2f}  true/target {true / error:.2f}  rays {rays:7.1f}  plain {needed:7.1f}  "
            f"ratio {rays / needed:.2f}  planned {plan.rays_per_vertex:7.1f}",
            flush=True,
        )
    return rows


def main(folder: Path, output: Path | None) -> None:
    rows = []
    for path in sorted(folder.glob("*.ply")):
        try:
            rows += measure(path)
        except MeshError as reason:
            print(f"{path.stem}: {reason}")
    for error in ERRORS:
        part = [row for row in rows if row["error"] == error]
        ratio, true = np.array([row["ratio"] for row in part]), np.array([row["true"] / error for row in part])
        plan = np.array([row["planned_rays"] / row["rays"] for row in part])
        print(
            f"{error:5.2f}: {len(part)} meshes, ratio median {np.median(ratio):.3f} largest {ratio.max():.2f}, "
            f"true/target largest {true.max():.2f}, planned/spent {plan.min():.2f} to {plan.max():.2f}"
        )
    saved(output, provenance(seed=0, rows=rows))


if __name__ == "__main__":
    command = parser(__doc__, "output")
    command.add_argument("folder", type=Path)
    main(**vars(command.parse_args()))
