"""ONNX files of models of one object: all kinds equal JAX, in every pose, also where a frame has vanished."""

import json
from typing import Any

import numpy as np
import pytest

from gash_jax.geometry.geometry_image import geometry_image
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.models.deep_prt import change_arrays, image_arrays, network_shapes
from gash_jax.models.deforming_model import DeformingModel, as_stored
from gash_jax.nn.unet import UNetConfig
from gash_jax.shapes.primitives import bumpy_sphere, plane
from tests.helpers.one_object import random_model

numpy_helper = pytest.importorskip("onnx", reason="needs the extra onnx: pip install onnx").numpy_helper
ort = pytest.importorskip("onnxruntime", reason="needs onnxruntime to run what was exported")

from gash_jax.apps.exports.onnx_file import onnx_model, operators  # noqa: E402

MESH = bumpy_sphere(3)


def run(proto: Any, pose: Any) -> np.ndarray:
    ready = ort.InferenceSession(proto.SerializeToString(), providers=["CPUExecutionProvider"])
    given = {"position": pose.vertices, "normal": pose.normals}
    return ready.run(None, {entry.name: given[entry.name] for entry in ready.get_inputs()})[0]


def image_model(mesh: Mesh, **settings: Any) -> DeformingModel:
    """`deep-prt` with random weights and running means."""
    config, rng = (
        UNetConfig("deep-prt", bands=2, size=16, channels=3, levels=2, **settings),
        np.random.default_rng(1),
    )
    arrays: dict[str, Any] = image_arrays(geometry_image(parameterise(mesh), config.size), mesh)
    for name, shape in network_shapes(config, 4).items():
        arrays[name] = rng.uniform(0.5, 2, shape) if name.endswith("/var") else rng.normal(0, 0.3, shape)
    pose = {"pose/sample": np.zeros(1), "pose/still": np.zeros((1, 3)), "pose/matrix": np.zeros((3, 1))}
    pose |= {"pose/low": np.zeros(1), "pose/high": np.zeros(1)}
    ranges = {"low": -np.arange(4.0), "high": 1 + np.arange(4.0)}
    if config.changes:
        seen = [mesh, mesh._replace(vertices=1.5 * mesh.vertices[:, [2, 0, 1]], normals=mesh.normals[:, [2, 0, 1]])]
        arrays |= change_arrays(arrays, seen, rng.normal(size=(2, len(mesh.vertices), 4)))
    return DeformingModel(config, as_stored({**pose, **arrays, **ranges}), mesh, {})


@pytest.mark.parametrize(
    ("mesh", "settings"),
    [
        (MESH, {"blocks": 2}),
        (plane(1.0, 7), {}),
        (MESH, {"fold": 2}),
        (MESH, {"changes": True}),
        (plane(1.0, 7), {"fold": 2, "changes": True}),
    ],
)
def test_the_network_over_images_equals_jax(mesh: Mesh, settings: dict[str, Any]) -> None:
    """A closed mesh, which is cut, and an open one, whose vertices all stand in the image once."""
    model = image_model(mesh, **settings)
    proto = onnx_model(model.config, as_stored(model.arrays), {})
    assert ({"SpaceToDepth", "DepthToSpace"} <= set(operators(proto))) == ("fold" in settings)
    assert not {"Scatter", "ScatterND", "ScatterElements", "Loop", "Scan"} & set(operators(proto))
    assert proto.graph.output[0].type.tensor_type.shape.dim[0].dim_value == len(mesh.vertices)
    told = []
    for positions in (mesh.vertices, 0.5 * mesh.vertices[:, [1, 2, 0]] + 1, np.zeros_like(mesh.vertices)):
        pose = model.pose(positions)
        told.append(np.asarray(model.coefficients(pose)))
        np.testing.assert_allclose(run(proto, pose), told[-1], rtol=0, atol=1e-5 * np.abs(told[-1]).max())
    assert np.abs(told[1] - told[0]).max() > 1e-2, "the pose must matter, or any graph would pass"


def test_radiance_under_a_light_equals_jax() -> None:
    transfer, light = random_model("momo-prt", MESH), np.arange(27.0).reshape(9, 3)
    colours = np.linspace(0.5, 2, 27, dtype=np.float32)
    wide = {"mean": np.repeat(transfer.arrays["mean"], 3, axis=-1) * colours[None]}
    wide["basis"] = np.repeat(transfer.arrays["basis"], 3, axis=-1) * colours[None, None]
    model = DeformingModel(transfer.config, {**transfer.arrays, **wide, "light": light}, MESH, {})
    proto = onnx_model(model.config, model.arrays, {})
    (output,) = proto.graph.output
    assert output.name == "radiance"
    assert [side.dim_value for side in output.type.tensor_type.shape.dim] == [len(MESH.vertices), 9, 3]
    (said,) = [entry.value for entry in proto.metadata_props if entry.key == "metadata"]
    np.testing.assert_array_equal(json.loads(said)["light"], light)
    pose = model.pose(0.5 * MESH.vertices)
    told = np.asarray(model.radiance(pose.vertices))
    np.testing.assert_allclose(run(proto, pose), told, rtol=0, atol=1e-5 * np.abs(told).max())


@pytest.mark.parametrize("name", ["momo-prt", "deform"])
def test_poses_equal_jax(name: str) -> None:
    model = random_model(name, MESH)
    proto = onnx_model(model.config, as_stored(model.arrays), {})
    assert not {"Scatter", "ScatterND", "ScatterElements", "Loop", "Scan"} & set(operators(proto))
    assert "Cast" in operators(proto), "the large arrays stay as small in the file as they are"
    stored = {entry.name: numpy_helper.to_array(entry) for entry in proto.graph.initializer}
    assert stored["mean"].dtype == np.float16
    if name == "deform":
        assert stored["directions/0"].dtype == np.int8
        assert not {"pose/matrix", "pose/sample"} & set(stored), "what tells poses outside of training is not needed"
    assert proto.graph.output[0].type.tensor_type.shape.dim[0].dim_value == len(MESH.vertices)
    collapsed = MESH.vertices.copy()
    collapsed[:5] = collapsed[0]
    turned, told = 0.5 * MESH.vertices[:, [1, 2, 0]] + 1, []
    for positions in (MESH.vertices, turned, 3 * MESH.vertices + 1, collapsed, np.zeros_like(collapsed)):
        pose = model.pose(positions)
        told.append(np.asarray(model.coefficients(pose)))
        np.testing.assert_allclose(run(proto, pose), told[-1], rtol=0, atol=1e-5 * np.abs(told[-1]).max())
    assert np.abs(told[1] - told[0]).max() > 1e-2, "the pose must matter, or any graph would pass"
