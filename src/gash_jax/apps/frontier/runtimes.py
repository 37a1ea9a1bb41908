"""The same weights outside JAX: by NumPy alone, by ONNX Runtime, by PyTorch Geometric.

Each function makes what runs a model on a mesh, and raises `Unavailable` where that cannot be. What is made once for a
model (a session, a copy of the weights) is no part of the timed call.
"""

import importlib.util
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import jax
import numpy as np
from flax.traverse_util import flatten_dict

from gash_jax.apps.frontier.traced import Unavailable
from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.surfel_graph import with_surfels
from gash_jax.measure.frontier import Outcome
from gash_jax.models.model import Model, save_model
from gash_jax.nn.inputs import node_arrays
from gash_jax.nn.output import world_coefficients

TOGETHER = 1024  # vertices of the surfel network in a call
NUMPY_RUNTIME = Path(__file__).parents[4] / "runtimes" / "gash_numpy.py"


@cache
def _numpy_runtime() -> ModuleType:
    """The file that predicts without JAX; it stands beside the package in a checkout, and is no part of it."""
    spec = importlib.util.spec_from_file_location("gash_numpy", NUMPY_RUNTIME) if NUMPY_RUNTIME.is_file() else None
    if spec is None or spec.loader is None:
        raise Unavailable("runtimes/gash_numpy.py is not beside the package: run from a checkout of the project")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def numpy_run(mesh: Mesh, model: Model) -> Callable[[int], Outcome]:
    """Prediction by NumPy; it does not tell the time of the graph apart."""
    runtime = _numpy_runtime()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "weights.npz"
        save_model(path, model.config, model.params)
        weights = runtime.load_model(str(path))
    return lambda seed: Outcome(runtime.predict(weights, *mesh, seed=seed), 0.0)


def onnx_run(mesh: Mesh, model: Model) -> Callable[[int], Outcome]:
    """Prediction by ONNX Runtime of what `gash export` writes; the graph is ours."""
    try:
        import onnxruntime

        from gash_jax.apps.exports.onnx_file import onnx_model
    except ImportError as error:
        raise Unavailable(f"{error.name} is not installed: pip install 'gash-jax[onnx]' onnxruntime") from None
    arrays: Any = flatten_dict(model.params, sep="/")
    written = onnx_model(model.config, arrays, {}).SerializeToString()
    session = onnxruntime.InferenceSession(written, providers=onnxruntime.get_available_providers())
    wanted = [entry.name for entry in session.get_inputs()]

    def run(seed: int) -> Outcome:
        started = time.perf_counter()
        graph = model.graph(mesh, seed)
        built = time.perf_counter() - started
        calls, place = onnx_calls(model.config, graph)
        inputs = [{name: np.asarray(given[name]) for name in wanted} for given in calls]
        found = np.concatenate([np.asarray(session.run(None, given)[0]) for given in inputs])[place]
        usable = np.any(mesh.normals != 0, axis=1)[:, None]
        return Outcome(np.where(usable, found, np.float32(0)), built)

    return run


def onnx_calls(config: Any, graph: Any) -> tuple[list[dict[str, Any]], Any]:
    """The inputs by name (docs/model_file.md) of each call of a network's file, and which row of the results in turn
    is each vertex of the mesh."""
    if config.name == "local":  # lists of one length together, and no more of them than memory can take
        some = [
            {name: array[start : start + TOGETHER] for name, array in part.items()}
            for part in graph.parts
            for start in range(0, len(part["normal"]), TOGETHER)
        ]
        return [with_surfels(part, graph.records) for part in some], graph.slot
    table = graph.senders.reshape(len(graph.nodes["motor"]), getattr(config, "neighbours", 0))
    return [{**graph.nodes, "neighbours": table}], slice(None)


def pyg_run(mesh: Mesh, model: Model) -> Callable[[int], Outcome]:
    """The two-stage network by PyTorch Geometric; the graph is ours."""
    try:
        from gash_jax.apps.frontier import pyg_two_stage
    except ImportError as error:
        raise Unavailable(f"{error.name} is not installed: pip install 'gash-jax[peers]'") from None
    network = pyg_two_stage.PygTwoStage(model.config, model.params)
    finish = jax.jit(world_coefficients, static_argnums=(2, 3))
    frame, residual = model.config.frame, model.config.residual

    def run(seed: int) -> Outcome:
        started = time.perf_counter()
        graph = model.graph(mesh, seed)
        built = time.perf_counter() - started
        nodes = node_arrays(graph)
        said = pyg_two_stage.predict(network, np.asarray(nodes["motor"]), graph.senders, graph.receivers)
        return Outcome(np.asarray(finish(said, nodes, frame, residual)), built)

    return run
