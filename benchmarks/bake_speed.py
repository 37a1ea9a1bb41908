"""Speed of the bake against raw embreex: `.venv/bin/python -m benchmarks.bake_speed MESH [--rays 256]`.

Three figures of one run, on all cores: (1) raw: embreex alone on the very rays of the plain bake, made beforehand,
scene built; (2) `bake_transfer` after one warm-up, BVH build included; (3) the whole process `gash bake`, imports,
compilation and file writing included. Medians of five, three for the process. Peak memory is that of the `gash bake`
process.
"""

import time
from pathlib import Path

import numpy as np

from benchmarks.bakes import gash_bake, raw_throughput
from benchmarks.options import parser, saved
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.visibility import visibility


def build_seconds(mesh: Mesh) -> float:
    """Seconds that embreex needs to copy the mesh and build its tree."""
    geometry = trace_geometry(mesh)
    started = time.perf_counter()
    visibility(geometry.vertices, geometry.faces)
    return time.perf_counter() - started


def bake_seconds(mesh: Mesh, rays: int) -> float:
    """Seconds of one `bake_transfer` with default replicates, BVH build included."""
    started = time.perf_counter()
    bake_transfer(mesh, rays=rays)
    return time.perf_counter() - started


def main(mesh: Path, rays: int, output: Path | None) -> None:
    loaded = load_mesh(mesh)
    bake_transfer(loaded, rays=rays)
    total = int(np.any(loaded.normals != 0, axis=1).sum()) * rays
    raw, built, bake = [], [], []
    for _ in range(5):  # in turn, so that a drifting machine meets both alike
        raw.append(total / raw_throughput(loaded, rays, most_rays=total))
        built.append(build_seconds(loaded))
        bake.append(bake_seconds(loaded, rays))
    processes = [gash_bake(mesh, rays) for _ in range(3)]
    raw_s, build_s, bake_s = (float(np.median(times)) for times in (raw, built, bake))
    process_s, memory = float(np.median([p[0] for p in processes])), max(p[1] for p in processes)
    print(f"{mesh.name}: {len(loaded.vertices)} vertices x {rays} rays = {total / 1e6:.1f} M rays")
    print(f"raw embreex        {raw_s:7.3f} s  {total / raw_s / 1e6:6.2f} M rays/s")
    print(f"raw, scene build   {build_s:7.3f} s")
    print(f"bake_transfer      {bake_s:7.3f} s  = {bake_s / raw_s:.2f} x raw (target <= 1.25)")
    print(f"                              = {bake_s / (raw_s + build_s):.2f} x raw with its scene build")
    print(f"gash bake, process {process_s:7.3f} s  = 1.6 x raw + {process_s - 1.6 * raw_s:.2f} s (target <= 4 s)")
    print(f"peak memory        {memory:7.0f} MiB (target <= 1536)")
    figures = {"raw_s": raw_s, "build_s": build_s, "bake_s": bake_s, "process_s": process_s, "peak_mib": memory}
    saved(output, provenance(mesh=mesh.name, rays=rays, **figures))


if __name__ == "__main__":
    command = parser(__doc__, "output")
    command.add_argument("mesh", type=Path)
    command.add_argument("--rays", type=int, default=256)
    main(**vars(command.parse_args()))
