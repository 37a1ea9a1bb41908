"""A model as an ONNX file that holds all of its prediction: what a network reads of a mesh in, coefficients out.

The graphs are written by hand, family by family, so that they hold no operator that engines lack: neighbours are
gathered and nothing is scattered, nothing loops, and the number of vertices is free. The mesh's own preparation
(motors, neighbours, surfels) stays outside; docs/model_file.md says how each input is made.

Beside the conventions the file says, in its metadata: the config of the network, the operators and their version.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from onnx import checker, helper  # type: ignore[import-not-found]

from gash_jax.apps.exports.deforming import write_deform, write_momo
from gash_jax.apps.exports.graph import IR_VERSION, OPSET, Axis, Graph, Value
from gash_jax.apps.exports.image_net import write_deep_prt
from gash_jax.apps.exports.inputs import VERTICES
from gash_jax.apps.exports.motor_nets import write_gnn, write_mlp, write_teacher, write_two_stage
from gash_jax.apps.exports.ring_net import write_ring_net
from gash_jax.apps.exports.surfel_net import write_surfel_net
from gash_jax.apps.exports.versor_net import write_versor_net
from gash_jax.files.atomic import FileError, whole_file
from gash_jax.models.deforming_model import LIGHT
from gash_jax.nn.config import ModelConfig
from gash_jax.prt.transfer import CONVENTIONS

FORMAT, FORMAT_VERSION = "gash-onnx", 1
# what a family's file gives: coefficients, and of some how far they are expected to be off
Written = Value | tuple[Value, Value]
WRITERS: dict[str, Callable[[Graph, Any], Written]] = {
    "mlp": write_mlp,
    "gnn": write_gnn,
    "teacher": write_teacher,
    "two-stage": write_two_stage,
    "rings": write_ring_net,
    "versor": write_versor_net,
    "local": write_surfel_net,
    "momo-prt": write_momo,
    "deform": write_deform,
    "deep-prt": write_deep_prt,
}
MEANINGS = {
    "coefficients": "transfer coefficients of each vertex, k = l*l + l + m",
    "predicted_error": "RMS error to expect of each coefficient",
}
RADIANCE = "radiance that arrives at each vertex under the light of the metadata, k = l*l + l + m, linear RGB"
# weights of models of one object that have a row for each of its vertices
PER_VERTEX = ("mean", "image/texels")


def onnx_model(config: ModelConfig, arrays: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> Any:
    """The ONNX model of a network and its arrays by name, with `metadata` beside what it says itself.

    Raises FileError for a family that has no writer.
    """
    if config.name not in WRITERS:
        raise FileError(f"{config.name} has no ONNX graph: export it as .npz, or add a writer to apps/exports")
    graph = Graph(arrays)
    written = WRITERS[config.name](graph, config)
    rows: Axis = next((len(arrays[name]) for name in PER_VERTEX if name in arrays), VERTICES)
    said = {**metadata, "format": FORMAT, "version": FORMAT_VERSION, "model": config.to_dict()}
    if LIGHT in arrays:
        assert isinstance(written, Value)
        shape = (config.bands**2, 3)
        graph.output("radiance", written.reshape(-1, *shape), (rows, *shape), RADIANCE)
        said["light"] = arrays[LIGHT].tolist()
    else:
        values = written if isinstance(written, tuple) else (written,)
        for (name, meaning), value in zip(MEANINGS.items(), values, strict=False):
            graph.output(name, value, (rows, config.bands**2), meaning)
    proto = helper.make_graph(graph.nodes, config.name, graph.inputs, graph.outputs, graph.initializers)
    imports = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(proto, opset_imports=imports, ir_version=IR_VERSION, producer_name="gash_jax")
    said |= {"conventions": CONVENTIONS, "opset": OPSET, "operators": graph.operators()}
    helper.set_model_props(model, {"metadata": json.dumps(said)})
    checker.check_model(model, full_check=True)
    return model


def operators(model: Any) -> list[str]:
    """The operators that a model is made of, sorted."""
    return sorted({node.op_type for node in model.graph.node})


def save_onnx(path: str | Path, model: Any) -> None:
    """Write a model whole."""
    with whole_file(path) as temporary:
        temporary.write_bytes(model.SerializeToString(deterministic=True))
