"""Seconds and memory of `gash light` by the size of the map: `.venv/bin/python -m benchmarks.map_sizes --output FILE`.

Radiance .hdr maps, run-length coded as most are, from 8 x 4 to 16384 x 8192 pixels; three bands, whole processes.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.options import options, saved
from gash_jax.formats.rgbe import encode
from gash_jax.light.studio import studio_light
from gash_jax.measure.provenance import provenance

HEIGHTS = (4, 512, 2048, 8192)


# the peak of a process that `wait` tells is at least that of the one that started it, so the process says its own
COMMAND = """
from pathlib import Path
from gash_jax.apps.cli import main
main()
print(next(line.split()[1] for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")))
"""


def measure(height: int, folder: Path) -> dict:
    """Seconds and peak memory of a whole process, by the height of its map."""
    path, base = folder / "map.hdr", min(height, 512)
    wider = height // base
    with open(path, "wb") as file:  # a line at a time: the whole picture would take many times its file
        file.write(f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {2 * height}\n".encode())
        for row in studio_light(base).astype(np.float64):
            file.write(encode(np.repeat(row[None], wider, axis=1)) * wider)
    started = time.perf_counter()
    command = [sys.executable, "-c", COMMAND, "light", str(path), "-o", str(folder / "light.npz"), "--quiet"]
    found = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds = time.perf_counter() - started
    size = path.stat().st_size / 2**20
    return {"height": height, "file_mib": size, "seconds": seconds, "peak_mib": int(found.stdout) / 1024}


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
