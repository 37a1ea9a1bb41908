"""Throughput, time and memory of the plain bake as a mesh grows: `.venv/bin/python -m benchmarks.scaling MESH`.

The mesh is subdivided at its edges' midpoints (same surface, four times the faces) until --vertices are passed. For
each size: raw embreex on the plain bake's own rays, all cores, scene built, on up to 2^23 of them spread over the
mesh; the plain bake, with its scene build apart; both in turn, medians of three. Then one whole `gash bake --rays 32`
process of the largest mesh for its peak memory, and the exponent of time against vertices, fitted in log-log.
"""

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.bakes import gash_bake, raw_throughput
from benchmarks.options import parser, saved
from gash_jax.formats.meshes import load_mesh, save_mesh
from gash_jax.geometry.mesh import Mesh, subdivide_midpoint
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer

MOST_RAYS = 1 << 23


def measure(mesh: Mesh, rays: int) -> dict[str, float]:
    """Figures of one size."""
    metadata = bake_transfer(mesh, rays=rays, replicates=1).metadata
    raw, trace, build = [], [], []
    for _ in range(3):
        raw.append(raw_throughput(mesh, rays, MOST_RAYS))
        metadata = bake_transfer(mesh, rays=rays, replicates=1).metadata
        trace.append(metadata["seconds"]["trace"])
        build.append(metadata["seconds"]["build"])
    seconds = float(np.median(trace))
    throughput = metadata["rays_total"] / seconds
    raw_rate = float(np.median(raw))
    row = {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "raw": raw_rate,
        "bake": throughput,
        "share": throughput / raw_rate,
        "trace_s": seconds,
        "build_s": float(np.median(build)),
    }
    print(
        f"{row['vertices']:8d} vertices  raw {raw_rate / 1e6:6.2f}  bake {throughput / 1e6:6.2f} M rays/s  "
        f"share {row['share']:.2f}  trace {seconds:.2f} s  build {row['build_s']:.2f} s",
        flush=True,
    )
    return row


def main(mesh: Path, vertices: int, rays: int, output: Path | None) -> None:
    grown, rows = load_mesh(mesh), []
    while True:
        if len(grown.vertices) >= 10_000:
            rows.append(measure(grown, rays))
        if len(grown.vertices) >= vertices:
            break
        grown = subdivide_midpoint(grown)
    total = [row["trace_s"] + row["build_s"] for row in rows]
    exponent = float(np.polyfit(np.log([row["vertices"] for row in rows]), np.log(total), 1)[0])
    with tempfile.TemporaryDirectory() as folder:
        save_mesh(f"{folder}/mesh.ply", grown)
        seconds, peak = gash_bake(Path(folder) / "mesh.ply", 32)
    print(f"time grows as vertices^{exponent:.2f}")
    peak_gib = peak / 1024
    print(f"gash bake --rays 32, {len(grown.vertices)} vertices: {seconds:.1f} s, peak {peak_gib:.2f} GiB (target < 4)")
    figures = {"rows": rows, "exponent": exponent, "process_s": seconds, "peak_gib": peak_gib}
    saved(output, provenance(mesh=mesh.name, rays=rays, **figures))


if __name__ == "__main__":
    command = parser(__doc__, "output")
    command.add_argument("mesh", type=Path)
    command.add_argument("--vertices", type=int, default=1_000_000, help="grow until there are as many")
    command.add_argument("--rays", type=int, default=64)
    main(**vars(command.parse_args()))
