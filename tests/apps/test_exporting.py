"""`gash export`: what it takes, what it writes, what it refuses in one line."""

import json
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

from gash_jax.apps.cli import gash
from gash_jax.files.atomic import FileError
from gash_jax.measure.half_weights import rounded, rounding_error
from gash_jax.models.model import load_model, save_model
from runtimes import gash_numpy
from tests.helpers.small_networks import MESHES, NETS, written


def run(*arguments: Any) -> None:
    gash.main(["export", *map(str, arguments)], standalone_mode=False)


def test_a_file_and_a_name_that_ships_are_exported(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = written(NETS["mlp"], tmp_path / "model.npz")
    run(path, "-o", tmp_path / "again.npz")
    assert "format in docs/model_file.md" in capsys.readouterr().out
    with np.load(path) as first, np.load(tmp_path / "again.npz") as second:
        assert {name: first[name].tobytes() for name in first} == {name: second[name].tobytes() for name in second}
    run("mlp", "-o", tmp_path / "shipped.npz", "--quiet")
    assert capsys.readouterr().out == "" and load_model(tmp_path / "shipped.npz").metadata["name"] == "mlp"


@pytest.mark.parametrize("name", ["model", "model.pt", "model.onnx.gz", "model.npy"])
def test_another_suffix_is_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(click.UsageError, match=r"give a name that ends in .npz or .onnx"):
        run("mlp", "-o", tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_without_the_extra_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("gash_jax.apps.exports.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr("gash_jax.apps.exports.onnx_file", raising=False)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(click.ClickException, match=r"onnx is not installed: pip install 'gash-jax\[onnx\]'"):
        run("mlp", "-o", tmp_path / "m.onnx")
    assert not list(tmp_path.iterdir())


def test_the_input_is_not_written_over(tmp_path: Path) -> None:
    path = written(NETS["mlp"], tmp_path / "model.npz")
    for source in (path, tmp_path):
        with pytest.raises(FileError, match="it is the input"):
            run(source, "-o", path)


def test_half_weights_are_measured_and_read_by_both(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    path = written(NETS["mlp"], tmp_path / "model.npz")
    run(path, "-o", tmp_path / "half.npz", "--half")
    said = capsys.readouterr().out
    model, exact = load_model(tmp_path / "half.npz"), load_model(path)
    error = model.metadata["half_weights"]
    assert f"weights in float16: relrmse {error['relrmse_median']:.4g} at the median of 6 meshes" in said
    assert 1e-6 < error["relrmse_median"] <= error["relrmse_worst"] < 1e-2
    assert error == rounding_error(exact, rounded(exact))
    with np.load(tmp_path / "half.npz") as archive:
        assert {archive[name].dtype for name in archive if name != "metadata"} == {np.dtype(np.float16)}
    mesh = MESHES["generated"]
    truth = np.asarray(model(mesh))
    assert truth.dtype == np.float32
    found = gash_numpy.predict(gash_numpy.load_model(str(tmp_path / "half.npz")), *mesh)
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-5 * np.abs(truth).max())
    np.testing.assert_allclose(found, exact(mesh), rtol=0, atol=1e-2 * np.abs(truth).max())


def test_weights_beyond_float16_are_refused(tmp_path: Path) -> None:
    model = load_model(written(NETS["mlp"], tmp_path / "model.npz"))
    model.params["head"]["bias"] = np.full(9, 1e5, np.float32)
    save_model(tmp_path / "model.npz", model.config, model.params)
    with pytest.raises(FileError, match="beyond float16"):
        run(tmp_path / "model.npz", "-o", tmp_path / "half.npz", "--half")
    assert not (tmp_path / "half.npz").exists()


def test_onnx_files_say_their_operators(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    onnx = pytest.importorskip("onnx", reason="needs the extra onnx: pip install onnx")
    ort = pytest.importorskip("onnxruntime", reason="needs onnxruntime to run what was exported")
    path = written(NETS["mlp"], tmp_path / "model.npz")
    run(path, "-o", tmp_path / "m.onnx", "--half")
    said = capsys.readouterr().out
    proto = onnx.load(str(tmp_path / "m.onnx"))
    metadata = json.loads(proto.metadata_props[0].value)
    assert f"ONNX opset 15; operators: {', '.join(metadata['operators'])}\n" in said
    assert metadata["half_weights"]["meshes"] == 6 and metadata["model"]["name"] == "mlp"
    model, mesh = load_model(path), MESHES["odd"]
    nodes = model.graph(mesh).nodes
    session = ort.InferenceSession(str(tmp_path / "m.onnx"), providers=["CPUExecutionProvider"])
    (found,) = session.run(None, {"motor": nodes["motor"], "normal": nodes["normal"]})
    truth = np.asarray(rounded(model)(mesh))
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-5 * np.abs(truth).max())
