"""The NumPy runtime predicts what the package predicts, from the file alone."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.mesh_graph import build_graph
from gash_jax.models.families import FAMILIES, build_model, model_config, model_graph, traced_visibility
from gash_jax.models.model import Model, load_model, shipped_models
from gash_jax.prt.transfer import load_transfer
from runtimes import gash_numpy
from tests.helpers.bumpy import bumpy_mesh, network_inputs
from tests.helpers.small_networks import ENDS, MESHES, NETS, written

ROOT = Path(__file__).parents[2]
KNOWN = {net: config for net, config in NETS.items() if config.name != "versor"}


def _assert_equal(found: np.ndarray, truth: np.ndarray) -> None:
    """Within 1e-5 of the largest."""
    assert (np.abs(found - truth) / np.abs(truth).max()).max() <= 1e-5


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("net", KNOWN)
def test_every_model_equals_the_package(net: str, mesh: Mesh, tmp_path: Path) -> None:
    path = written(NETS[net], tmp_path / "model.npz")
    _assert_predicts_as_the_package(NETS[net], path, mesh)


@pytest.mark.parametrize(("net", "frame", "residual"), ENDS)
def test_every_frame_and_residual_equals_the_package(net: str, frame: str, residual: bool, tmp_path: Path) -> None:
    config: Any = replace(NETS[net], layers=1, frame=frame, residual=residual)  # type: ignore[call-arg]
    _assert_predicts_as_the_package(config, written(config, tmp_path / "model.npz"), MESHES["odd"])


def _assert_predicts_as_the_package(config: Any, path: Path, mesh: Mesh) -> None:
    told = traced_visibility(config, mesh) if config.name == "teacher" else None
    truth = load_model(path).predict(mesh).coefficients
    found = gash_numpy.predict(gash_numpy.load_model(str(path)), *mesh, visibility=told)
    assert found.dtype == np.float32 and found.shape == truth.shape
    _assert_equal(found, truth)


def test_only_surfels_predicts_its_error(tmp_path: Path) -> None:
    model = gash_numpy.load_model(str(written(NETS["mlp"], tmp_path / "m.npz")))
    with pytest.raises(ValueError, match="mlp does not predict its error"):
        gash_numpy.predict_with_error(model, *MESHES["odd"])


@pytest.mark.optimised
@pytest.mark.parametrize("name", shipped_models())
def test_shipped_weights(name: str) -> None:
    model, mesh = load_model(name), MESHES["generated"]
    found = gash_numpy.predict(gash_numpy.load_model(str(shipped_models()[name])), *mesh)
    _assert_equal(found, model.predict(mesh).coefficients)


def test_versor_is_refused_with_what_runs_it(tmp_path: Path) -> None:
    model = gash_numpy.load_model(str(written(NETS["versor"], tmp_path / "m.npz")))
    with pytest.raises(ValueError, match="versor is not among .* run its ONNX file"):
        gash_numpy.predict(model, *MESHES["odd"])


def test_the_seed_of_rings(tmp_path: Path) -> None:
    path, mesh = written(NETS["rings"], tmp_path / "model.npz"), MESHES["generated"]
    found = gash_numpy.predict(gash_numpy.load_model(str(path)), *mesh, seed=3)
    truth, other = (load_model(path).predict(mesh, seed=seed).coefficients for seed in (3, 4))
    _assert_equal(found, truth)
    assert np.abs(other - truth).max() > 1e-4  # the seed matters, so agreeing on it says something


def test_parts_by_hand() -> None:
    up = gash_numpy.motors(np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]]))[0]
    assert up[0] == 1 and np.count_nonzero(up) == 1
    moved = gash_numpy.motors(np.array([[2.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]))[0]
    assert moved[gash_numpy.E1P] == moved[gash_numpy.E1M] == -1.0
    table = gash_numpy.nearest(np.array([[0.0], [1.0], [3.0]]), np.arange(3), 4)
    assert table.tolist() == [[1, 2, 1, 2], [0, 2, 0, 2], [1, 0, 1, 0]]
    graph = build_graph(MESHES["odd"], "knn", 4)
    used = np.unique(MESHES["odd"].faces)
    mine = gash_numpy.nearest(MESHES["odd"].vertices.astype(float), used, 4)
    np.testing.assert_array_equal(mine.reshape(-1), graph.senders)


def test_it_loads_nothing_but_numpy() -> None:
    code = "import sys, gash_numpy; print(*sys.modules)"
    folder = Path(gash_numpy.__file__).parent
    out = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    loaded = set(out.stdout.split())
    assert "numpy" in loaded and not {"jax", "flax", "scipy", "gash_jax"} & loaded


@pytest.mark.parametrize("net", ["gnn", "local"])
def test_the_command_line_writes_a_transfer_file(net: str, tmp_path: Path) -> None:
    model, mesh, out = written(NETS[net], tmp_path / "m.npz"), tmp_path / "mesh.npz", tmp_path / "out.npz"
    np.savez(mesh, **MESHES["generated"]._asdict())
    assert gash_numpy.main([str(model), str(mesh), str(out)]) == 0
    found, truth = load_transfer(out), load_model(model).predict(MESHES["generated"])
    _assert_equal(found.coefficients, np.asarray(truth.coefficients))
    for name in Mesh._fields:
        np.testing.assert_array_equal(getattr(found, name), getattr(truth, name))
        assert getattr(found, name).dtype == getattr(truth, name).dtype
    assert (found.predicted_error is None) == (truth.predicted_error is None)
    same = ("format", "version", "bands", "conventions", "method", "parameters", "rays_total")
    assert {name: found.metadata[name] for name in same} == {name: truth.metadata[name] for name in same}
    assert found.metadata["seconds"]["total"] > 0 and "numpy" in found.metadata["software"]
    assert [path.name for path in tmp_path.glob("out*")] == ["out.npz"]


BROKEN = {
    "give \\(v, 3\\) of both": {"normals": np.zeros((2, 3))},
    "not finite": {"vertices": np.full_like(MESHES["odd"].vertices, np.nan)},
    "give at least one": {"faces": np.zeros((0, 3), int)},
    "integers": {"faces": np.zeros((2, 3))},
    "do not exist": {"faces": np.array([[0, 1, 92]])},
}


@pytest.mark.parametrize("message", BROKEN)
def test_arrays_that_are_no_mesh_are_refused(message: str) -> None:
    with pytest.raises(ValueError, match=message):
        gash_numpy.check_mesh(*MESHES["odd"]._replace(**BROKEN[message]))


def test_a_file_that_was_there_outlives_a_failure(tmp_path: Path) -> None:
    (tmp_path / "out.npz").write_bytes(b"kept")
    with pytest.raises(TypeError):
        gash_numpy.write_transfer(str(tmp_path / "out.npz"), {"file": np.zeros(3)})
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"kept"]


@pytest.mark.parametrize("content", [b"", b"nonsense", None])
def test_bad_files_are_one_line(content: bytes | None, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = tmp_path / "bad.npz"
    if content is None:
        np.savez(path, a=np.zeros(3))
    else:
        path.write_bytes(content)
    assert gash_numpy.main([str(path), str(path), str(tmp_path / "out.npz")]) == 2
    said = capsys.readouterr().err
    assert said.startswith("error: ") and said.count("\n") == 1
    assert not (tmp_path / "out.npz").exists()


def test_a_teacher_without_visibility_is_told_so(tmp_path: Path) -> None:
    model = gash_numpy.load_model(str(written(NETS["teacher"], tmp_path / "m.npz")))
    with pytest.raises(ValueError, match="visibility"):
        gash_numpy.predict(model, *MESHES["odd"])


def test_an_encoding_it_does_not_know_is_refused(tmp_path: Path) -> None:
    model = gash_numpy.load_model(str(written(NETS["gnn"], tmp_path / "m.npz")))
    with pytest.raises(ValueError, match="gnn with the encoding motor-7: this file knows motor only"):
        gash_numpy.predict(model._replace(config={**model.config, "encoding": "motor-7"}), *MESHES["odd"])


def test_a_frame_it_does_not_know_is_refused(tmp_path: Path) -> None:
    model = gash_numpy.load_model(str(written(NETS["gnn"], tmp_path / "m.npz")))
    with pytest.raises(ValueError, match="gnn with the frame camera: this file knows mixed, world, vertex"):
        gash_numpy.predict(model._replace(config={**model.config, "frame": "camera"}), *MESHES["odd"])


def test_files_without_frame_and_residual_mean_the_first_reading(tmp_path: Path) -> None:
    model, mesh = gash_numpy.load_model(str(written(NETS["two-stage"], tmp_path / "m.npz"))), MESHES["odd"]
    old = model._replace(config={k: v for k, v in model.config.items() if k not in ("frame", "residual")})
    np.testing.assert_array_equal(gash_numpy.predict(old, *mesh), gash_numpy.predict(model, *mesh))
    other = model._replace(config={**model.config, "frame": "vertex"})
    assert np.abs(gash_numpy.predict(other, *mesh) - gash_numpy.predict(model, *mesh)).max() > 1e-2


def _documented() -> dict[str, dict[str, str]]:
    """Arrays by model: the rows of the tables of docs/model_file.md, as name -> shape."""
    tables, model = {}, ""
    for line in (ROOT / "docs" / "model_file.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("#"):
            model = line.removeprefix("### ").strip("` ")
        cells = [cell.strip().strip("`") for cell in line.strip("|").split("|")]
        if model in FAMILIES and line.startswith("| `") and "/" in cells[0]:
            tables.setdefault(model, {})[cells[0]] = cells[1]
    return tables


@pytest.mark.parametrize("name", FAMILIES)
def test_the_document_names_every_array_and_its_shape(name: str) -> None:
    # networks have arrays for what they know, whatever they say
    config: Any = model_config(name, **({"known_bands": 6, "known_bounces": 2} if name == "local" else {}))
    graph = network_inputs(model_graph(config, bumpy_mesh(30)))
    shapes = jax.eval_shape(build_model(config).init, jax.random.key(0), graph)["params"]
    letters = {"B": "bands", "C": "channels", "H": "heads", "U": "visibility_channels", "N": "visibility_directions"}
    letters |= {"L": "learnt_bands", "J": "known_bounces"}
    values = {letter: getattr(config, key) for letter, key in letters.items() if hasattr(config, key)}
    values |= {"K": min(3, values.get("L", 0))}
    documented = {}
    for pattern, shape in _documented()[name].items():
        size = tuple(eval(part, {}, values) for part in shape.strip("()").split(",") if part.strip())
        layers = config.visibility_layers if pattern.startswith("visibility/") else config.layers
        for i in range(layers) if "{i}" in pattern else [0]:
            documented[pattern.replace("{i}", str(i))] = size
    actual = {"/".join(str(key.key) for key in path): leaf.shape for path, leaf in jax.tree.leaves_with_path(shapes)}
    # the first hidden layer of the MLP reads the motor, the others the layer before
    documented |= {"dense_0/kernel": (32, config.channels)} if name == "mlp" else {}
    assert documented == actual


def test_the_model_class_is_what_the_file_holds(tmp_path: Path) -> None:
    path = written(NETS["gnn"], tmp_path / "m.npz")
    model = load_model(path)
    assert isinstance(model, Model) and gash_numpy.load_model(str(path)).config == model.config.to_dict()
