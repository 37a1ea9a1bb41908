"""What `gash info` says of ONNX files: ours, those of others, damaged ones, and without the extra."""

import json
import sys
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

from gash_jax.apps.cli import gash
from gash_jax.files.atomic import FileError
from gash_jax.models.model import load_model

ARRAY = "  coefficients: float32 (vertices, 9) transfer coefficients of each vertex, k = l*l + l + m"
onnx = pytest.importorskip("onnx", reason="needs the extra onnx: pip install onnx")


def told(capsys: pytest.CaptureFixture, path: Path) -> tuple[dict[str, Any], str]:
    """What `gash info` says to programs and to people."""
    capsys.readouterr()
    gash.main(["info", str(path), "--json"], standalone_mode=False)
    values = json.loads(capsys.readouterr().out)
    gash.main(["info", str(path)], standalone_mode=False)
    return values, capsys.readouterr().out


@pytest.fixture
def exported(tmp_path: Path) -> Path:
    path = tmp_path / "mlp.onnx"
    gash.main(["export", "mlp", "-o", str(path), "--quiet"], standalone_mode=False)
    return path


def foreign(path: Path, **metadata: str) -> Path:
    """A file of another program: y = x + 1, x of any length, in two dimensions of which one has no name."""
    one = onnx.numpy_helper.from_array(np.ones(1, np.float64), "one")
    x, y = (onnx.helper.make_tensor_value_info(name, onnx.TensorProto.DOUBLE, ["n", None]) for name in "xy")
    graph = onnx.helper.make_graph([onnx.helper.make_node("Add", ["x", "one"], ["y"])], "g", [x], [y], [one])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 13)], ir_version=8)
    onnx.helper.set_model_props(model, metadata)
    path.write_bytes(model.SerializeToString())
    return path


def test_a_network_of_ours(exported: Path, capsys: pytest.CaptureFixture) -> None:
    values, text = told(capsys, exported)
    network = load_model("mlp")
    assert (values["kind"], values["family"], values["opset"]) == ("onnx model", "mlp", {"ai.onnx": 15})
    assert values["name"] == network.metadata["name"] and values["bytes"] == exported.stat().st_size
    assert values["inputs"]["motor"]["shape"] == ["vertices", 32]
    assert values["inputs"]["motor"]["type"] == values["outputs"]["coefficients"]["type"] == "float32"
    assert values["outputs"]["coefficients"]["shape"] == ["vertices", 9] and "MatMul" in values["operators"]
    assert values["model"] == network.config.to_dict() and values["conventions"]
    assert values["parameters"] >= sum(np.size(leaf) for leaf in network.params["head"].values())
    for line in ("kind: onnx model", "family: mlp", "  ai.onnx: 15", ARRAY, "  MatMul"):
        assert line in text.split("\n")


@pytest.mark.parametrize(
    "metadata", [{}, {"metadata": "no JSON"}, {"metadata": "[1]"}, {"metadata": '{"format": "x"}'}]
)
def test_a_file_of_another_program(metadata: dict[str, str], tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    values, _ = told(capsys, foreign(tmp_path / "other.onnx", **metadata))
    assert values["inputs"]["x"] == {"type": "float64", "shape": ["n", "?"]}
    assert values["operators"] == ["Add"] and values["opset"] == {"ai.onnx": 13} and values["parameters"] == 1
    assert "family" not in values and "model" not in values


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.9, 0.999])
def test_truncated_files_are_refused(kept: float, exported: Path) -> None:
    whole = exported.read_bytes()
    exported.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(FileError, match=r"mlp.onnx is no whole ONNX file \(.*\): export it again"):
        gash.main(["info", str(exported)], standalone_mode=False)


def test_other_bytes_are_refused(tmp_path: Path) -> None:
    (tmp_path / "m.onnx").write_bytes(np.random.default_rng(0).bytes(1000))
    with pytest.raises(FileError, match=r"is no whole ONNX file \([^\n]*\): export it again$"):
        gash.main(["info", str(tmp_path / "m.onnx")], standalone_mode=False)


def test_without_the_extra(exported: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("gash_jax.apps.exports.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.delattr("gash_jax.apps.exports.onnx_reader", raising=False)
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(click.ClickException, match=r"onnx is not installed: pip install 'gash-jax\[onnx\]'"):
        gash.main(["info", str(exported)], standalone_mode=False)
