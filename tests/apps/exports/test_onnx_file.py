"""ONNX files say what JAX says, on meshes of any size, and hold no operator that engines lack."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flax.traverse_util import flatten_dict

from gash_jax.apps.cli import gash
from gash_jax.apps.frontier.runtimes import onnx_calls
from gash_jax.files.atomic import FileError
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.surfel_graph import with_surfels
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.families import FAMILIES, build_model, model_config, model_graph
from gash_jax.models.model import Model, load_model, shipped_models
from gash_jax.nn.config import ModelConfig
from gash_jax.nn.inputs import VERTEX_ENCODINGS
from tests.helpers.bumpy import bumpy_mesh, random_variables
from tests.helpers.shared_data import shared_file
from tests.helpers.small_networks import ENDS, MESHES, NETS
from tests.helpers.small_networks import written as written_file

pytest.importorskip("onnx", reason="needs the extra onnx: pip install onnx")
ort = pytest.importorskip("onnxruntime", reason="needs onnxruntime to run what was exported")

from gash_jax.apps.exports.onnx_file import WRITERS, onnx_model  # noqa: E402

FORBIDDEN = ("Scatter", "Loop", "Scan", "If", "NonZero", "Compress")
ENCODED = [("gnn", name) for name in (*VERTEX_ENCODINGS[1:], "relative-motor")]
ENCODED += [("rings", name) for name in (*VERTEX_ENCODINGS, "relative-motor")]


def random_model(config: ModelConfig) -> Model:
    return Model(config, random_variables(build_model(config), model_graph(config, bumpy_mesh(30)))["params"])


def written(model: Model) -> Any:
    arrays: Any = flatten_dict(model.params, sep="/")
    return onnx_model(model.config, arrays, {"name": "test"})


def session(model: Any) -> Any:
    return ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])


def fed(config: Any, graph: Any) -> dict[str, np.ndarray]:
    """Inputs by name, of what a network reads of a mesh that has all vertices in one call."""
    rows, count = len(graph.nodes["motor"]), getattr(config, "neighbours", 0)
    inputs = {**graph.nodes, "neighbours": graph.senders.reshape(rows, count)}
    edges = {"relative": "edges", "motor": "edge_motor"}
    return inputs | {edges[name]: array.reshape(rows, count, -1) for name, array in graph.edges.items()}


def filled(graph: Any) -> dict[str, np.ndarray]:
    """The parts of a surfel graph as one, all lists filled up to the longest."""
    parts = [with_surfels(part, graph.records) for part in graph.parts if len(part["normal"])]
    longest = max(part["weight"].shape[1] for part in parts)
    for part in parts:
        missing = longest - part["weight"].shape[1]
        part["weight"] = np.pad(part["weight"], ((0, 0), (0, missing)))
        part["surfel"] = np.pad(part["surfel"], ((0, 0), (0, missing), (0, 0)))
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def called(ready: Any, given: dict[str, np.ndarray]) -> list[np.ndarray]:
    return ready.run(None, {entry.name: np.asarray(given[entry.name]) for entry in ready.get_inputs()})


def run(ready: Any, config: Any, graph: Any) -> list[np.ndarray]:
    calls, place = onnx_calls(config, graph) if config.name == "local" else ([fed(config, graph)], slice(None))
    return [np.concatenate(parts)[place] for parts in zip(*(called(ready, given) for given in calls), strict=True)]


def assert_says_the_same(model: Model, ready: Any, mesh: Mesh) -> None:
    graph = model.graph(mesh)
    assert_equal(run(ready, model.config, graph), model, graph)


def assert_equal(found: list[np.ndarray], model: Model, graph: Any) -> None:
    told = [np.asarray(each) for each in model.with_error(graph) if each is not None]
    assert len(found) == len(told)
    for mine, theirs in zip(found, told, strict=True):
        assert mine.dtype == np.float32 and mine.shape == theirs.shape
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-5 * np.abs(theirs).max())


@pytest.mark.parametrize("net", NETS)
def test_one_file_equals_jax_on_meshes_of_two_sizes(net: str) -> None:
    model = random_model(NETS[net])
    proto = written(model)
    assert len({len(mesh.vertices) for mesh in MESHES.values()}) == 2
    for mesh in MESHES.values():
        assert_says_the_same(model, session(proto), mesh)


@pytest.mark.parametrize(("net", "frame", "residual"), ENDS)
def test_every_frame_and_residual(net: str, frame: str, residual: bool) -> None:
    config: Any = replace(NETS[net], layers=1, frame=frame, residual=residual)  # type: ignore[call-arg]
    model = random_model(config)
    assert_says_the_same(model, session(written(model)), MESHES["odd"])


@pytest.mark.parametrize(("net", "encoding"), ENCODED)
def test_every_encoding(net: str, encoding: str) -> None:
    config: Any = replace(NETS[net], layers=1, encoding=encoding)  # type: ignore[call-arg]
    model = random_model(config)
    assert_says_the_same(model, session(written(model)), MESHES["odd"])


@pytest.mark.parametrize("bands", [1, 3, 6])
def test_any_bands_that_a_surfel_network_knows(bands: int, tmp_path: Path) -> None:
    config = model_config("local", channels=8, known_bands=6, known_bounces=2)
    path = written_file(config, tmp_path / "m.npz")
    gash.main(["export", f"{path}", "-o", f"{tmp_path / 'm.onnx'}", "--bands", f"{bands}"], standalone_mode=False)
    ready = ort.InferenceSession(str(tmp_path / "m.onnx"), providers=["CPUExecutionProvider"])
    for mesh in MESHES.values():
        assert_says_the_same(load_model(path, bands), ready, mesh)


def test_lists_may_be_filled_up() -> None:
    model = random_model(model_config("local", 4, channels=8))
    ready, graph = session(written(model)), model.graph(MESHES["generated"])
    assert sum(len(part["normal"]) > 0 for part in graph.parts) > 2
    assert_equal([each[graph.slot] for each in called(ready, filled(graph))], model, graph)
    shapes = {entry.name: entry.shape for entry in ready.get_inputs()}
    assert shapes["surfel"] == ["vertices", "surfels", 20] and shapes["weight"] == ["vertices", "surfels"]


def test_no_vertex_knows_of_another() -> None:
    """A caller may run any vertices, in any order: rows follow the inputs."""
    model = random_model(NETS["local"])
    ready, given = session(written(model)), filled(model.graph(MESHES["odd"]))
    whole, some = called(ready, given), np.array([5, 3, 60])
    for mine, theirs in zip(called(ready, {name: a[some] for name, a in given.items()}), whole, strict=True):
        np.testing.assert_allclose(mine, theirs[some], rtol=0, atol=1e-5 * np.abs(theirs).max())


@pytest.mark.parametrize("net", NETS)
def test_operators_and_free_axes(net: str) -> None:
    proto = written(random_model(NETS[net]))
    said = json.loads(next(entry.value for entry in proto.metadata_props if entry.key == "metadata"))
    used = {node.op_type for node in proto.graph.node}
    assert said["operators"] == sorted(used) and said["opset"] == proto.opset_import[0].version == 15
    assert not [name for name in used if name.startswith(FORBIDDEN)]
    assert said["model"] == NETS[net].to_dict() and said["format"] == "gash-onnx" and said["name"] == "test"
    for entry in (*proto.graph.input, *proto.graph.output):
        assert entry.type.tensor_type.shape.dim[0].dim_param == "vertices" and entry.doc_string


@pytest.mark.parametrize("name", shipped_models())
def test_shipped_weights_on_a_real_mesh(name: str) -> None:
    model = load_model(name)
    assert_says_the_same(model, session(written(model)), load_mesh(shared_file("meshes/suzanne.ply")))


def test_a_mistake_would_show() -> None:
    """The comparison is one that a wrong graph fails: neighbours in another order change nothing, other ones do."""
    model, mesh = random_model(NETS["gnn"]), MESHES["generated"]
    graph, ready = model.graph(mesh), session(written(random_model(NETS["gnn"])))
    table = np.asarray(graph.senders).reshape(len(mesh.vertices), -1)
    right = run(ready, model.config, graph)[0]
    turned = run(ready, model.config, graph._replace(senders=table[:, ::-1].reshape(-1)))[0]
    wrong = run(ready, model.config, graph._replace(senders=np.roll(table, 1, axis=0).reshape(-1)))[0]
    np.testing.assert_allclose(turned, right, atol=1e-5 * np.abs(right).max())
    assert np.abs(wrong - right).max() > 1e-2


def test_every_family_has_a_writer_and_others_are_refused() -> None:
    assert set(FAMILIES) | set(DEFORMING) == set(WRITERS)
    with pytest.raises(FileError, match="nothing has no ONNX graph"):
        onnx_model(ModelConfig("nothing"), {}, {})
