"""Seconds and memory of `gash light` by the size of the map: `.venv/bin/python -m benchmarks.map_sizes --output FILE`.

Radiance .hdr maps, run-length coded as most are, from 8 x 4 to 16384 x 8192 pixels; three bands, whole processes.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.options import options, saved
from gash_jax.formats.hdr import write_hdr
from gash_jax.light.studio import studio_light
from gash_jax.measure.provenance import provenance

HEIGHTS = (4, 512, 2048, 8192)


def measure(height: int, folder: Path) -> dict:
    """One size; the peak of memory is that of the largest process so far, and sizes grow."""
    path, base = folder / "map.hdr", min(height, 512)
    write_hdr(path, np.repeat(np.repeat(studio_light(base), height // base, axis=0), height // base, axis=1))
    started = time.perf_counter()
    command = [sys.executable, "-m", "gash_jax", "light", str(path), "-o", str(folder / "light.npz"), "--quiet"]
    subprocess.run(command, check=True)
    seconds = time.perf_counter() - started
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    return {"height": height, "file_mib": path.stat().st_size / 2**20, "seconds": seconds, "peak_mib": peak}


def main(output: Path | None, quick: bool) -> dict:
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        measure(HEIGHTS[0], Path(folder))  # what is compiled and read the first time
        for height in HEIGHTS[: 2 if quick else None]:
            rows.append(measure(height, Path(folder)))
            print(rows[-1], flush=True)
    return saved(output, provenance(rows=rows))


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
