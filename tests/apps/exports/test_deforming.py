"""ONNX files of models of one object: all kinds equal JAX, in every pose, also where a frame has vanished."""

import json
from typing import Any

import numpy as np
import pytest

from gash_jax.files.settings import from_dict
from gash_jax.geometry.geometry_image import geometry_image
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.models.deep_prt import image_arrays, network_shapes
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import DeformingModel, as_stored
from gash_jax.models.pose_reader import POSE_SHAPES
from gash_jax.nn.unet import UNetConfig
from gash_jax.shapes.primitives import bumpy_sphere, plane

pytest.importorskip("onnx", reason="needs the extra onnx: pip install onnx")
ort = pytest.importorskip("onnxruntime", reason="needs onnxruntime to run what was exported")

from gash_jax.apps.exports.onnx_file import onnx_model, operators  # noqa: E402

MESH = bumpy_sphere(3)
SIZES = {"v": len(MESH.vertices), "k": 9, "r": 3, "p": 2, "s": 4, "d": 12, "q": 2, "t": 5, "w": 3}
ROWS = (SIZES["v"], 30, 30, 30, 30, 0, 0)  # of each level
SIZES |= {f"rows {level}": count for level, count in enumerate(ROWS)}
SIZES |= {f"patches {level}": count for level, count in enumerate((2, 1, 1, 1, 1, 0, 0))}


def model_of(name: str) -> DeformingModel:
    """With random arrays."""
    rng, config = np.random.default_rng(0), from_dict(DEFORMING[name].config, {"name": name, "bands": 3})
    shapes = {**POSE_SHAPES, **DEFORMING[name].shapes(config, 9)}
    arrays: dict[str, Any] = {
        key: rng.normal(0, 0.3, [SIZES[side] if isinstance(side, str) else side for side in shape])
        for key, shape in shapes.items()
    }
    arrays |= {"pose/sample": rng.integers(0, SIZES["v"], 4), "pose/low": -np.ones(2), "pose/high": np.ones(2)}
    arrays = as_stored(arrays)
    if name == "deform":
        arrays |= {"patch": np.arange(SIZES["v"]) >= 30, "neighbour": rng.integers(0, SIZES["v"], SIZES["v"])}
        arrays |= {"row": rng.permutation(SIZES["v"])}
        arrays |= {"lengths": ((arrays["poses"] @ arrays["relevance"]) ** 2).sum(axis=2)}
    return DeformingModel(config, arrays, MESH, {})


def run(proto: Any, pose: Any) -> np.ndarray:
    ready = ort.InferenceSession(proto.SerializeToString(), providers=["CPUExecutionProvider"])
    given = {"position": pose.vertices, "normal": pose.normals}
    return ready.run(None, {entry.name: given[entry.name] for entry in ready.get_inputs()})[0]


def image_model(mesh: Mesh, blocks: int = 1) -> DeformingModel:
    """`deep-prt` with random weights and running means."""
    config, rng = (
        UNetConfig("deep-prt", bands=2, size=16, channels=3, levels=2, blocks=blocks),
        np.random.default_rng(1),
    )
    arrays: dict[str, Any] = image_arrays(geometry_image(parameterise(mesh), config.size), mesh)
    for name, shape in network_shapes(config, 4).items():
        arrays[name] = rng.uniform(0.5, 2, shape) if name.endswith("/var") else rng.normal(0, 0.3, shape)
    pose = {"pose/sample": np.zeros(1), "pose/still": np.zeros((1, 3)), "pose/matrix": np.zeros((3, 1))}
    pose |= {"pose/low": np.zeros(1), "pose/high": np.zeros(1)}
    ranges = {"low": -np.arange(4.0), "high": 1 + np.arange(4.0)}
    return DeformingModel(config, {**pose, **arrays, **ranges}, mesh, {})


@pytest.mark.parametrize(("mesh", "blocks"), [(MESH, 2), (plane(1.0, 7), 1)])
def test_the_network_over_images_equals_jax(mesh: Mesh, blocks: int) -> None:
    """A closed mesh, which is cut, and an open one, whose vertices all stand in the image once."""
    model = image_model(mesh, blocks)
    proto = onnx_model(model.config, model.arrays, {})
    assert not {"Scatter", "ScatterND", "ScatterElements", "Loop", "Scan"} & set(operators(proto))
    assert proto.graph.output[0].type.tensor_type.shape.dim[0].dim_value == len(mesh.vertices)
    told = []
    for positions in (mesh.vertices, 0.5 * mesh.vertices[:, [1, 2, 0]] + 1, np.zeros_like(mesh.vertices)):
        pose = model.pose(positions)
        told.append(np.asarray(model.coefficients(pose)))
        np.testing.assert_allclose(run(proto, pose), told[-1], rtol=0, atol=1e-5 * np.abs(told[-1]).max())
    assert np.abs(told[1] - told[0]).max() > 1e-2, "the pose must matter, or any graph would pass"


def test_radiance_under_a_light_equals_jax() -> None:
    transfer, light = model_of("momo-prt"), np.arange(27.0).reshape(9, 3)
    colours = np.linspace(0.5, 2, 27, dtype=np.float32)
    wide = {"mean": np.repeat(transfer.arrays["mean"], 3, axis=-1) * colours[None]}
    wide["basis"] = np.repeat(transfer.arrays["basis"], 3, axis=-1) * colours[None, None]
    model = DeformingModel(transfer.config, {**transfer.arrays, **wide, "light": light}, MESH, {})
    proto = onnx_model(model.config, model.arrays, {})
    (output,) = proto.graph.output
    assert output.name == "radiance"
    assert [side.dim_value for side in output.type.tensor_type.shape.dim] == [SIZES["v"], 9, 3]
    (said,) = [entry.value for entry in proto.metadata_props if entry.key == "metadata"]
    np.testing.assert_array_equal(json.loads(said)["light"], light)
    pose = model.pose(0.5 * MESH.vertices)
    told = np.asarray(model.radiance(pose.vertices))
    np.testing.assert_allclose(run(proto, pose), told, rtol=0, atol=1e-5 * np.abs(told).max())


@pytest.mark.parametrize("name", ["momo-prt", "deform"])
def test_poses_equal_jax(name: str) -> None:
    model = model_of(name)
    proto = onnx_model(model.config, as_stored(model.arrays), {})
    assert not {"Scatter", "ScatterND", "ScatterElements", "Loop", "Scan"} & set(operators(proto))
    assert "Cast" in operators(proto), "the large arrays stay float16 in the file"
    assert proto.graph.output[0].type.tensor_type.shape.dim[0].dim_value == SIZES["v"]
    collapsed = MESH.vertices.copy()
    collapsed[:5] = collapsed[0]
    for positions in (MESH.vertices, 3 * MESH.vertices + 1, collapsed):
        pose = model.pose(positions)
        told = np.asarray(model.coefficients(pose))
        np.testing.assert_allclose(run(proto, pose), told, rtol=0, atol=1e-5 * np.abs(told).max())
