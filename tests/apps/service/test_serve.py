"""`gash serve` as a process: it says where it is, finishes what runs when it is stopped, and refuses in one line."""

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from benchmarks.service import mesh_request
from gash_jax.apps.cli import gash
from gash_jax.models.model import save_model
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.service import Answer, ask, tiny_model

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    model, path = tiny_model(), tmp_path_factory.mktemp("serve") / "tiny.npz"
    save_model(path, model.config, model.params)
    return path


def _start(*arguments: object) -> subprocess.Popen:
    """The service at a free port."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-m", "gash_jax", "serve", "--port", "0", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def _port(process: subprocess.Popen) -> int:
    assert process.stdout
    said = process.stdout.readline()
    found = re.fullmatch(r"serving tiny at http://127\.0\.0\.1:(\d+) \(Ctrl-C stops\)\n", said)
    assert found, said
    return int(found[1])


@pytest.mark.parametrize("name", [signal.SIGTERM, signal.SIGINT])
def test_a_stop_answers_what_runs(weights: Path, name: signal.Signals) -> None:
    process = _start("--model", weights, "--timeout", 300)
    port, answers = _port(process), []
    path, body = mesh_request(bumpy_sphere(60))
    asking = threading.Thread(target=lambda: answers.append(ask(port, "POST", path, body)))
    asking.start()
    while b'"requests":1' not in ask(port, "GET", "/health").body:
        time.sleep(0.005)
    process.send_signal(name)
    out, err = process.communicate(timeout=300)
    asking.join()
    (answer,) = answers
    assert isinstance(answer, Answer) and answer.status == 201 and len(answer.body) == 36 * 36_002
    assert (process.returncode, out, err) == (0, "stopped\n", "")


def test_a_port_in_use_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = str(taken.getsockname()[1])
        with pytest.raises(ValueError, match=f"cannot listen at 127.0.0.1:{port} .*choose another"):
            gash.main(["serve", "--port", port], standalone_mode=False)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--model", "mlp"], "model mlp has no path for deforming meshes: use local"),
        (["--model", "gpt"], "no model 'gpt'"),
        (["--model", "local", "--model", "local"], "two models have the same name"),
        (["--host", "no such host"], "cannot listen at"),
    ],
)
def test_what_cannot_be_served_is_refused(arguments: list[str], said: str) -> None:
    with pytest.raises(Exception, match=said):
        gash.main(["serve", "--port", "0", *arguments], standalone_mode=False)


def test_without_the_extra_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("gash_jax.apps.service.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    with pytest.raises(Exception, match=r"uvicorn is not installed: pip install 'gash-jax\[serve\]'"):
        gash.main(["serve"], standalone_mode=False)
