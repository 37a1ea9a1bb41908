"""Throughput, time and memory of the plain bake as a mesh grows: `.venv/bin/python benchmarks/scaling.py MESH`.

The mesh is subdivided at its edges' midpoints (same surface, four times the faces) until --vertices are passed. For
each size: raw embreex on the plain bake's own rays, all cores, scene built, on up to 2^23 of them spread over the
mesh; the plain bake, with its scene build apart; both in turn, medians of three. Then one whole `gash bake --rays 32`
process of the largest mesh for its peak memory, and the exponent of time against vertices, fitted in log-log.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.files.cores import available_cores
from gash_jax.formats.meshes import load_mesh, save_mesh
from gash_jax.geometry.mesh import Mesh, subdivide_midpoint
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import visibility

CHUNK, MOST_RAYS = 1 << 17, 1 << 23


def raw_throughput(mesh: Mesh, rays: int) -> float:
    """Rays per second of embreex alone, all cores, on the rays of chunks spread evenly over the mesh."""
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces)
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    step = CHUNK // rays
    chunks = [active[i : i + step] for i in range(0, max(len(active) - step, 1), step)]
    chunks = chunks[:: max(1, -(-len(chunks) * CHUNK // MOST_RAYS))]
    shifts = np.random.default_rng(0).random((len(mesh.vertices), 1, 2), np.float32)
    work = []
    for chunk in chunks:
        frames = np.asarray(orthonormal_frame(mesh.normals[chunk]))
        origins, directions = sample_rays(geometry.origins[chunk], frames, shifts[chunk], rays)
        work.append((np.asarray(origins), np.asarray(directions)))
    with ThreadPoolExecutor(available_cores()) as pool:
        started = time.perf_counter()
        list(pool.map(lambda pair: visible(*pair), work))
        return sum(len(o) for o, _ in work) / (time.perf_counter() - started)


def measure(mesh: Mesh, rays: int) -> dict[str, float]:
    """Figures of one size."""
    bake_transfer(mesh, rays=rays, replicates=1)
    raw, trace, build = [], [], []
    for _ in range(3):
        raw.append(raw_throughput(mesh, rays))
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


def process_peak(mesh: Mesh) -> tuple[float, float]:
    """Seconds and peak memory (GiB) of a whole `gash bake --rays 32` process."""
    with tempfile.TemporaryDirectory() as folder:
        save_mesh(f"{folder}/mesh.ply", mesh)
        command = [sys.executable, "-m", "gash_jax", "bake", f"{folder}/mesh.ply", "-o", f"{folder}/t.npz"]
        started = time.perf_counter()
        subprocess.run([*command, "--rays", "32", "--quiet"], check=True)
        seconds = time.perf_counter() - started
    return seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--vertices", type=int, default=1_000_000, help="grow until there are as many")
    parser.add_argument("--rays", type=int, default=64)
    parser.add_argument("--output", type=Path, help="write the figures to this JSON file")
    arguments = parser.parse_args()
    mesh, rows = load_mesh(arguments.mesh), []
    while True:
        if len(mesh.vertices) >= 10_000:
            rows.append(measure(mesh, arguments.rays))
        if len(mesh.vertices) >= arguments.vertices:
            break
        mesh = subdivide_midpoint(mesh)
    total = [row["trace_s"] + row["build_s"] for row in rows]
    exponent = float(np.polyfit(np.log([row["vertices"] for row in rows]), np.log(total), 1)[0])
    seconds, peak = process_peak(mesh)
    print(f"time grows as vertices^{exponent:.2f}")
    print(f"gash bake --rays 32, {len(mesh.vertices)} vertices: {seconds:.1f} s, peak {peak:.2f} GiB (target < 4)")
    if arguments.output:
        figures = {"rows": rows, "exponent": exponent, "process_s": seconds, "peak_gib": peak}
        entry = provenance(mesh=arguments.mesh.name, rays=arguments.rays, **figures)
        arguments.output.write_text(json.dumps(entry, indent=1) + "\n")


if __name__ == "__main__":
    main()
