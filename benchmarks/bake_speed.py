"""Speed of the bake against raw embreex: `.venv/bin/python benchmarks/bake_speed.py MESH [--rays 256]`.

Three figures of one run, on all cores: (1) raw: embreex alone on the very rays of the plain bake, made beforehand,
one thread per core, scene built; (2) `bake_transfer` after one warm-up, BVH build included; (3) the whole process
`gash bake`, imports, compilation and file writing included. Medians of five, three for the process. Peak memory is
that of the `gash bake` process.
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
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import visibility


def raw_seconds(mesh: Mesh, rays: int, chunk_rays: int = 1 << 17) -> float:
    """Seconds that embreex needs for every vertex's rays, all cores busy."""
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces)
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    shifts = np.random.default_rng(0).random((len(mesh.vertices), 1, 2), np.float32)
    step = max(1, chunk_rays // rays)
    chunks = [active[i : i + step] for i in range(0, len(active) // step * step, step)]
    frames = np.asarray(orthonormal_frame(mesh.normals))
    rays_of = [sample_rays(geometry.origins[c], frames[c], shifts[c], rays) for c in chunks]
    work = [(np.asarray(o), np.asarray(d)) for o, d in rays_of]
    traced = sum(len(o) for o, _ in work)
    cores = available_cores()
    started = time.perf_counter()
    with ThreadPoolExecutor(cores) as pool:
        list(pool.map(lambda w: visible(*w), work))
    return (time.perf_counter() - started) * len(active) * rays / traced


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


def process_seconds(path: Path, rays: int) -> tuple[float, float]:
    """Wall seconds of a `gash bake` process, and the largest peak memory of such processes so far (MiB)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gash_jax", "bake", str(path), "-o", f"{folder}/t.npz", "--rays", str(rays)]
        started = time.perf_counter()
        subprocess.run([*command, "--quiet"], check=True)
        seconds = time.perf_counter() - started
    return seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--rays", type=int, default=256)
    parser.add_argument("--output", type=Path, help="write the figures to this JSON file")
    arguments = parser.parse_args()
    mesh = load_mesh(arguments.mesh)
    bake_transfer(mesh, rays=arguments.rays)
    raw, built, bake = [], [], []
    for _ in range(5):  # in turn, so that a drifting machine meets both alike
        raw.append(raw_seconds(mesh, arguments.rays))
        built.append(build_seconds(mesh))
        bake.append(bake_seconds(mesh, arguments.rays))
    processes = [process_seconds(arguments.mesh, arguments.rays) for _ in range(3)]
    raw_s, build_s, bake_s = (float(np.median(times)) for times in (raw, built, bake))
    process_s, memory = float(np.median([p[0] for p in processes])), max(p[1] for p in processes)
    total = len(mesh.vertices) * arguments.rays
    print(f"{arguments.mesh.name}: {len(mesh.vertices)} vertices x {arguments.rays} rays = {total / 1e6:.1f} M rays")
    print(f"raw embreex        {raw_s:7.3f} s  {total / raw_s / 1e6:6.2f} M rays/s")
    print(f"raw, scene build   {build_s:7.3f} s")
    print(f"bake_transfer      {bake_s:7.3f} s  = {bake_s / raw_s:.2f} x raw (target <= 1.25)")
    print(f"                              = {bake_s / (raw_s + build_s):.2f} x raw with its scene build")
    print(f"gash bake, process {process_s:7.3f} s  = 1.6 x raw + {process_s - 1.6 * raw_s:.2f} s (target <= 4 s)")
    print(f"peak memory        {memory:7.0f} MiB (target <= 1536)")
    if arguments.output:
        figures = {"raw_s": raw_s, "build_s": build_s, "bake_s": bake_s, "process_s": process_s, "peak_mib": memory}
        result = provenance(mesh=arguments.mesh.name, rays=arguments.rays, **figures)
        arguments.output.write_text(json.dumps(result, indent=1) + "\n")


if __name__ == "__main__":
    main()
