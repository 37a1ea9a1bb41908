"""True error against seconds: plain, default and error-targeted bake, and other ray tracers under the plain bake.

    .venv/bin/python -m benchmarks.error_seconds MESH... --output docs/results/error_seconds.json

For each mesh: a reference of 8192 rays; then every method at a range of budgets, each warm (compiled before), in
turn, median of three. Scene build is included. A peer is the plain bake with our rays and our integration and that
library's tracer, so its error is the plain bake's and only its seconds are its own; it is timed at
64 rays per vertex. The figure goes beside the JSON as a PNG.
"""

from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import LogLocator, NullFormatter

from benchmarks.options import parser, saved
from benchmarks.peers import installed_peers
from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.metrics import relrmse
from gash_jax.measure.provenance import provenance
from gash_jax.measure.timing import timed
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_target import bake_to_error
from gash_jax.prt.integrands import integrate_rays, to_world
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import sample_rays

RAYS = (8, 16, 32, 64, 128, 256, 512)
ERRORS = (0.2, 0.1, 0.05, 0.03, 0.02, 0.01)
REFERENCE = 8192
VERTICES_AT_ONCE = 1 << 14


def plain_with(build: Callable, mesh: Mesh, rays: int, seed: int) -> np.ndarray:
    """The plain bake with another tracer, in batches as large as those libraries like."""
    geometry = trace_geometry(mesh)
    free = build(geometry.vertices, geometry.faces)
    shifts = np.random.default_rng(seed).random((len(mesh.vertices), 1, 2), np.float32)
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    frames = np.asarray(orthonormal_frame(mesh.normals))
    coefficients = np.zeros((len(mesh.vertices), 9), np.float32)
    for start in range(0, len(active), VERTICES_AT_ONCE):
        some = active[start : start + VERTICES_AT_ONCE]
        origins, directions = (
            np.asarray(a) for a in sample_rays(geometry.origins[some], frames[some], shifts[some], rays)
        )
        seen = free(origins, directions).reshape(len(some), 1, rays)
        local = integrate_rays(seen, np.zeros(len(some), np.float32), shifts[some], 3)
        coefficients[some] = np.asarray(to_world(local, frames[some]))[:, 0]
    return coefficients


def measure(mesh: Mesh) -> list[dict]:
    """Rows of (method, budget, seconds, rays per vertex, relrmse) for one mesh."""
    reference = bake_transfer(mesh, rays=REFERENCE, seed=99).coefficients
    active = int(np.any(mesh.normals != 0, axis=1).sum())
    rows = []

    def add(method: str, budget: float, run: Callable[[], np.ndarray], rays: float | None = None) -> None:
        found, seconds = timed(run, 3)
        error = relrmse(found, reference)
        rows.append({"method": method, "budget": budget, "seconds": seconds, "rays": rays, "relrmse": error})
        print(f"  {method:12s} {budget:8g}  {seconds:8.3f} s  relrmse {error:.4f}", flush=True)

    for rays in RAYS:
        add("plain", rays, lambda n=rays: bake_transfer(mesh, rays=n, replicates=1).coefficients, rays)
    for rays in RAYS[1:]:
        add("default", rays, lambda n=rays: bake_transfer(mesh, rays=n).coefficients, rays)
    for error in ERRORS:
        spent = bake_to_error(mesh, error).metadata["rays_total"] / active
        add("error", error, lambda e=error: bake_to_error(mesh, e).coefficients, spent)
    for name, build in installed_peers().items():
        add(name, 64, lambda b=build: plain_with(b, mesh, 64, 0), 64)
    return rows


def draw(results: dict[str, list[dict]], path: Path) -> None:
    """One panel a mesh, error against seconds, both logarithmic."""
    figure, axes = plt.subplots(1, len(results), figsize=(3.6 * len(results), 3.8), sharey=True, squeeze=False)
    for axis, (name, rows) in zip(axes[0], results.items(), strict=True):
        for method, marker in (("plain", "o"), ("default", "s"), ("error", "^")):
            own = [row for row in rows if row["method"] == method]
            label = {"plain": "plain bake", "default": "default bake", "error": "bake to an error"}[method]
            axis.loglog([r["seconds"] for r in own], [r["relrmse"] for r in own], marker=marker, ms=4, label=label)
        for row in rows:
            if row["method"] not in ("plain", "default", "error"):
                axis.loglog(row["seconds"], row["relrmse"], "x", ms=7, label=f"{row['method']}, 64 rays")
        axis.set_title(name, fontsize=10)
        axis.set_xlabel("seconds")
        axis.grid(True, which="both", lw=0.3, alpha=0.6)
        axis.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
        axis.xaxis.set_major_formatter("{x:g}")
        axis.xaxis.set_minor_formatter(NullFormatter())
    axes[0][0].set_ylabel("relative RMS error")
    axes[0][-1].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(path, dpi=130)


def main(meshes: list[Path], output: Path | None) -> None:
    results = {}
    for path in meshes:
        mesh = load_mesh(path)
        print(f"{path.stem}: {len(mesh.vertices)} vertices", flush=True)
        results[path.stem] = measure(mesh)
    saved(output, provenance(seed=0, reference_rays=REFERENCE, meshes=results))
    if output:
        draw(results, output.with_suffix(".png"))


if __name__ == "__main__":
    command = parser(__doc__, "output")
    command.add_argument("meshes", type=Path, nargs="+")
    main(**vars(command.parse_args()))
