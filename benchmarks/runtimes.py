"""Networks in three runtimes, speed and memory: `.venv/bin/python -m benchmarks.runtimes --output FILE.json`.

Each network, number of vertices and runtime has a process of its own (benchmarks.runtime_process): JAX as the package
uses it, ONNX Runtime on what `gash export -o m.onnx` wrote, NumPy alone by runtimes/gash_numpy.py. All use every core
that they would use anyway. Beside the milliseconds stands how far coefficients are from JAX's, over their largest.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from flax.traverse_util import flatten_dict

from benchmarks.options import parser, saved
from benchmarks.runtime_process import RUNTIMES
from gash_jax.apps.exports.onnx_file import onnx_model, save_onnx
from gash_jax.apps.frontier.runtimes import onnx_calls
from gash_jax.measure.provenance import provenance
from gash_jax.models.model import Model, load_model, model_file
from gash_jax.shapes.primitives import bumpy_sphere

NETWORKS = ("mlp", "two-stage", "local")
RESOLUTIONS = (10, 31)  # of spheres of 1002 and 9612 vertices
QUICK = ("mlp", "local"), (4,)


def onnx_arrays(model: Model, graph: Any) -> dict[str, np.ndarray]:
    """Inputs of each call of the ONNX file as "number/name", and where the vertices are in its results, "place"."""
    calls, place = onnx_calls(model.config, graph)
    given = {f"{i}/{name}": np.asarray(array) for i, call in enumerate(calls) for name, array in call.items()}
    rows = sum(len(call["normal"]) for call in calls)
    return {**given, "place": np.arange(rows)[place]}


def write_files(name: str, resolution: int, folder: Path) -> tuple[dict[str, Path], Path, int]:
    """The files of a network by runtime, that of the arrays of a mesh, and the number of its vertices."""
    model, mesh = load_model(name), bumpy_sphere(resolution)
    weights: Any = flatten_dict(model.params, sep="/")
    arrays = {key: np.asarray(leaf, np.float32) for key, leaf in weights.items()}
    save_onnx(folder / "model.onnx", onnx_model(model.config, arrays, {}))
    every: dict[str, Any] = {**mesh._asdict(), **onnx_arrays(model, model.graph(mesh))}
    np.savez(folder / "arrays.npz", **every)
    files = {"jax": model_file(name), "onnx": folder / "model.onnx", "numpy": model_file(name)}
    return files, folder / "arrays.npz", len(mesh.vertices)


def measure(runtime: str, model: Path, arrays: Path, output: Path, repeats: int) -> dict[str, float]:
    """What the process of one runtime says."""
    words = [sys.executable, "-m", "benchmarks.runtime_process", runtime, *map(str, (model, arrays, output, repeats))]
    done = subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True)
    return json.loads(done.stdout)


def rows_of(name: str, resolution: int, repeats: int) -> list[dict[str, Any]]:
    """One network on one mesh in all runtimes."""
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        files, arrays, vertices = write_files(name, resolution, Path(folder))
        found = {}
        for runtime in RUNTIMES:
            output = Path(folder) / f"{runtime}.npy"
            told = measure(runtime, files[runtime], arrays, output, repeats)
            found[runtime] = np.load(output)
            difference = float(np.abs(found[runtime] - found["jax"]).max() / np.abs(found["jax"]).max())
            size = files[runtime].stat().st_size
            rows.append({"network": name, "vertices": vertices, "runtime": runtime, "file_bytes": size, **told})
            rows[-1]["difference"] = difference
    return rows


def main(output: Path | None, quick: bool, repeats: int) -> dict[str, Any]:
    """All networks on all meshes."""
    networks, resolutions = QUICK if quick else (NETWORKS, RESOLUTIONS)
    rows = []
    for name in networks:
        for resolution in resolutions:
            rows += rows_of(name, resolution, repeats)
            print(*rows[-len(RUNTIMES) :], sep="\n", flush=True)
    return saved(output, {**provenance(seed=0, arguments={"repeats": repeats}), "rows": rows})


if __name__ == "__main__":
    command = parser(__doc__, "output", "quick")
    command.add_argument("--repeats", type=int, default=9, help="of each prediction")
    main(**vars(command.parse_args()))
