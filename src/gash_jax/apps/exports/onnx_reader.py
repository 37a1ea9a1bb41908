"""What an ONNX file says of itself, of ours and of others: for `gash info`. Nothing in it is run."""

import json
from math import prod
from pathlib import Path
from typing import Any

import onnx  # type: ignore[import-not-found]

from gash_jax.apps.exports.onnx_file import FORMAT, operators
from gash_jax.files.atomic import FileError

ANY = "?"  # the length of an axis that the file neither says nor names


def describe_onnx(path: Path) -> dict[str, Any]:
    """Bytes, opset, inputs, outputs and operators of a file, and of one of ours what it says of its network.

    A shape is a list of numbers and, for axes of any length, names. Raises FileError where the file is no whole model.
    """
    try:
        model = onnx.load_model(str(path), load_external_data=False)
        onnx.checker.check_model(str(path))
    except Exception as error:  # protobuf and the checker have errors of their own, which they share with nobody
        first = f"{error}".strip().split("\n")[0]
        raise FileError(f"{path} is no whole ONNX file ({first}): export it again") from None
    said = _ours(model)
    values: dict[str, Any] = {"kind": "onnx model"}
    if said:
        values |= {"family": said["model"]["name"], **({"name": said["name"]} if "name" in said else {})}
    values |= {"bytes": path.stat().st_size, "parameters": sum(prod(a.dims) for a in model.graph.initializer)}
    values |= {"opset": {entry.domain or "ai.onnx": entry.version for entry in model.opset_import}}
    given = {array.name for array in model.graph.initializer}  # which old files list among the inputs
    values["inputs"] = {entry.name: _tensor(entry) for entry in model.graph.input if entry.name not in given}
    values["outputs"] = {entry.name: _tensor(entry) for entry in model.graph.output}
    values["operators"] = operators(model)
    return {**values, **{name: entry for name, entry in said.items() if name not in values}}


def _ours(model: Any) -> dict[str, Any]:
    """The metadata that `gash export` wrote; nothing of another program's file."""
    text = next((entry.value for entry in model.metadata_props if entry.key == "metadata"), "")
    try:
        said = json.loads(text)
    except ValueError:
        return {}
    return said if isinstance(said, dict) and said.get("format") == FORMAT else {}


def _tensor(entry: Any) -> dict[str, Any]:
    """Type, shape and meaning of an input or an output."""
    kind = entry.type.tensor_type
    numbers = onnx.TensorProto.DataType.Name(kind.elem_type).lower()
    shape = [axis.dim_value if axis.HasField("dim_value") else axis.dim_param or ANY for axis in kind.shape.dim]
    named = {"float": "float32", "double": "float64"}
    values = {"type": named.get(numbers, numbers), "shape": shape}
    return values | ({"meaning": entry.doc_string} if entry.doc_string else {})
