"""One network in one runtime in one process, so that its memory is its own: started by benchmarks.runtimes.

    python -m benchmarks.runtime_process jax|onnx|numpy MODEL ARRAYS.npz OUT.npy REPEATS

Nothing is imported that the runtime does not need itself. Prints JSON: medians in milliseconds of wall time and of CPU
time of all threads, and the peak of resident memory in MiB (Linux). `jax` and `numpy` start from the mesh; `onnx`
starts from what the package has made of it, so what that costs is not among its numbers.
"""

import json
import re
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

# seconds of the graph, 0 where it came ready or is not told apart, and coefficients
Prediction = Callable[[], tuple[float, np.ndarray]]


def in_jax(model: str, arrays: dict[str, np.ndarray]) -> Prediction:
    """The package."""
    from gash_jax.geometry.mesh import Mesh
    from gash_jax.models.model import load_model

    network, mesh = load_model(model), Mesh(arrays["vertices"], arrays["normals"], arrays["faces"])

    def predict() -> tuple[float, np.ndarray]:
        started = time.perf_counter()
        graph = network.graph(mesh)
        return time.perf_counter() - started, np.asarray(network(graph))

    return predict


def in_onnx(model: str, arrays: dict[str, np.ndarray]) -> Prediction:
    """ONNX Runtime on the CPU; some networks are run part by part (`benchmarks.runtimes.onnx_arrays`)."""
    import onnxruntime

    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    count = sum(name.endswith("/normal") for name in arrays)
    calls = [{entry.name: arrays[f"{i}/{entry.name}"] for entry in session.get_inputs()} for i in range(count)]

    def predict() -> tuple[float, np.ndarray]:
        said = [np.asarray(session.run(["coefficients"], given)[0]) for given in calls]
        return 0.0, np.concatenate(said)[arrays["place"]]

    return predict


def in_numpy(model: str, arrays: dict[str, np.ndarray]) -> Prediction:
    """runtimes/gash_numpy.py, which makes the graph as it goes."""
    from runtimes import gash_numpy

    network = gash_numpy.load_model(model)
    return lambda: (0.0, gash_numpy.predict(network, arrays["vertices"], arrays["normals"], arrays["faces"]))


RUNTIMES = {"jax": in_jax, "onnx": in_onnx, "numpy": in_numpy}


def peak_mib() -> float:
    """Peak of this process alone: what `getrusage` says begins with that of the process which started it."""
    return int(re.findall(r"VmHWM:\s+(\d+)", Path("/proc/self/status").read_text())[0]) / 1024


def main(runtime: str, model: str, arrays: str, output: str, repeats: int) -> dict[str, float]:
    """Predict once to warm up, then `repeats` times."""
    with np.load(arrays) as archive:
        predict = RUNTIMES[runtime](model, dict(archive))
    _, coefficients = predict()
    rows = []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), time.process_time()
        graph, coefficients = predict()
        rows.append((graph, time.perf_counter() - wall, time.process_time() - cpu))
    np.save(output, coefficients)
    graph, total, cpu = (1e3 * float(value) for value in np.median(rows, axis=0))
    return {"graph_ms": graph, "total_ms": total, "cpu_ms": cpu, "peak_mib": peak_mib()}


if __name__ == "__main__":
    print(json.dumps(main(*sys.argv[1:5], repeats=int(sys.argv[5]))))
