"""What bakes are held against: embreex alone on the very rays of the plain bake, and a whole `gash bake` process."""

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
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import visibility

CHUNK_RAYS = 1 << 17


def raw_throughput(mesh: Mesh, rays: int, most_rays: int) -> float:
    """Rays per second of embreex alone: all cores, scene built, rays made beforehand.

    Traced are whole chunks of rays spread evenly over the mesh, about `most_rays` where that is less than all.
    """
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces)
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    step = max(1, CHUNK_RAYS // rays)
    chunks = [active[i : i + step] for i in range(0, max(len(active) - step, 1), step)]
    chunks = chunks[:: max(1, -(-len(chunks) * CHUNK_RAYS // most_rays))]
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


def gash_bake(path: Path, rays: int) -> tuple[float, float]:
    """Wall seconds of a `gash bake` process, and the largest peak memory of such processes so far (MiB)."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "gash_jax", "bake", str(path), "-o", f"{folder}/t.npz", "--rays", str(rays)]
        started = time.perf_counter()
        subprocess.run([*command, "--quiet"], check=True)
        seconds = time.perf_counter() - started
    return seconds, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
