"""ONNX files of models of one object: both kinds equal JAX, in every pose, also where a frame has vanished."""

from typing import Any

import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.settings import from_dict
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import HALVES, DeformingModel
from gash_jax.models.pose_reader import POSE_SHAPES
from gash_jax.shapes.primitives import bumpy_sphere

pytest.importorskip("onnx", reason="needs the extra onnx: pip install onnx")
ort = pytest.importorskip("onnxruntime", reason="needs onnxruntime to run what was exported")

from gash_jax.apps.exports.onnx_file import onnx_model, operators  # noqa: E402

MESH = bumpy_sphere(3)
SIZES = {"v": len(MESH.vertices), "k": 9, "r": 3, "p": 2, "s": 4, "d": 12, "q": 2, "t": 5}


def model_of(name: str) -> DeformingModel:
    """With random arrays."""
    rng, config = np.random.default_rng(0), from_dict(DEFORMING[name].config, {"name": name, "bands": 3})
    shapes = {**POSE_SHAPES, **DEFORMING[name].shapes(config)}
    arrays: dict[str, Any] = {
        key: rng.normal(0, 0.3, [SIZES.get(str(side)) or int(side) for side in shape]) for key, shape in shapes.items()
    }
    arrays |= {"pose/sample": rng.integers(0, SIZES["v"], 4), "pose/low": -np.ones(2), "pose/high": np.ones(2)}
    arrays |= {key: arrays[key].astype(np.float16) for key in HALVES}
    if name == "deform":
        arrays |= {"patch": rng.integers(0, 2, SIZES["v"]), "neighbour": rng.integers(0, SIZES["v"], SIZES["v"])}
    return DeformingModel(config, arrays, MESH, {})


def run(proto: Any, pose: Any) -> np.ndarray:
    ready = ort.InferenceSession(proto.SerializeToString(), providers=["CPUExecutionProvider"])
    given = {"position": pose.vertices, "normal": pose.normals}
    return ready.run(None, {entry.name: given[entry.name] for entry in ready.get_inputs()})[0]


def test_the_network_over_images_is_refused() -> None:
    config = from_dict(DEFORMING["deep-prt"].config, {"name": "deep-prt"})
    with pytest.raises(FileError, match="deep-prt has no ONNX graph"):
        onnx_model(config, {}, {})


@pytest.mark.parametrize("name", ["momo-prt", "deform"])
def test_poses_equal_jax(name: str) -> None:
    model = model_of(name)
    arrays = {key: a.astype(np.float16) if key in HALVES else a for key, a in model.arrays.items()}
    proto = onnx_model(model.config, arrays, {})
    assert not {"Scatter", "ScatterND", "ScatterElements", "Loop", "Scan"} & set(operators(proto))
    assert "Cast" in operators(proto), "the large arrays stay float16 in the file"
    assert proto.graph.output[0].type.tensor_type.shape.dim[0].dim_value == SIZES["v"]
    collapsed = MESH.vertices.copy()
    collapsed[:5] = collapsed[0]
    for positions in (MESH.vertices, 3 * MESH.vertices + 1, collapsed):
        pose = model.pose(positions)
        told = np.asarray(model.coefficients(pose))
        np.testing.assert_allclose(run(proto, pose), told, rtol=0, atol=1e-5 * np.abs(told).max())
