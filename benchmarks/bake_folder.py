"""Bake every mesh of a folder with the command line: `.venv/bin/python -m benchmarks.bake_folder FOLDER [--rays 256]`.

For each mesh: exit code, vertices, seconds of the bake, whether all coefficients are finite, and the health report.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.options import parser
from gash_jax.prt.transfer import load_transfer


def main(folder: Path, rays: int) -> int:
    bad = []
    meshes = sorted(p for p in folder.iterdir() if p.suffix in {".ply", ".obj", ".stl", ".off", ".glb"})
    for path in meshes:
        with tempfile.TemporaryDirectory() as scratch:
            output = Path(scratch) / "t.npz"
            command = [sys.executable, "-m", "gash_jax", "bake", str(path), "-o", str(output)]
            run = subprocess.run([*command, "--rays", str(rays)], capture_output=True, text=True)
            fine = run.returncode == 0 and output.exists()
            if fine:
                transfer = load_transfer(output)
                fine = bool(np.isfinite(transfer.coefficients).all())
                seconds = transfer.metadata["seconds"]["total"]
                lit = transfer.coefficients[:, 0].mean() / 0.28209479
                print(f"{path.name}: {len(transfer.vertices)} vertices, {seconds:.2f} s, mean openness {lit:.3f}")
            else:
                print(f"{path.name}: FAILED with exit code {run.returncode}: {run.stderr.strip()}")
        for line in run.stdout.splitlines():
            if line.startswith("  "):
                print("    " + line.strip())
        if not fine:
            bad.append(path.name)
    print(
        f"{len(meshes) - len(bad)} of {len(meshes)} meshes baked, all coefficients finite" + f"; bad: {bad}" * bool(bad)
    )
    return int(bool(bad))


if __name__ == "__main__":
    command = parser(__doc__)
    command.add_argument("folder", type=Path)
    command.add_argument("--rays", type=int, default=256)
    sys.exit(main(**vars(command.parse_args())))
