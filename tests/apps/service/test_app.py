"""The service over sockets: right coefficients, one line for everything else, limits, and that it goes on."""

import http.client
import json
import socket
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from benchmarks.service import mesh_request
from gash_jax.apps.service import wire
from gash_jax.apps.service.limits import Limits
from gash_jax.models.held import HeldMesh
from gash_jax.models.model import Model
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.service import ask, served, tiny_model

MESH = bumpy_sphere(6)
BENT = (MESH.vertices * (1 + 0.3 * MESH.vertices[:, :1])).astype(np.float32)
LIMITS = Limits(vertices=1000, faces=2000, meshes=3, requests=2, seconds=2)
ORIGIN = "https://page.example"


@pytest.fixture(scope="module")
def models() -> dict[str, Model]:
    return {"tiny": tiny_model(), "flat": tiny_model(2)}


@pytest.fixture(scope="module")
def port(models: dict[str, Model]) -> Iterator[int]:
    with served(models, LIMITS, (ORIGIN,)) as number:
        yield number


def _idle(port: int) -> dict:
    """What /health says once nothing runs any more."""
    said = {}
    for _ in range(500):
        said = json.loads(ask(port, "GET", "/health").body)
        if said["requests"] == 0:
            return said
        time.sleep(0.01)
    raise AssertionError(f"requests never end: {said}")


def test_a_mesh_and_its_poses_get_their_coefficients(port: int, models: dict[str, Model]) -> None:
    expected = HeldMesh(models["tiny"], MESH)
    connection = http.client.HTTPConnection("127.0.0.1", port)  # one for all: it is kept alive
    path, body = mesh_request(MESH)
    connection.request("POST", path, body)
    answer = connection.getresponse()
    name, used = answer.headers["Location"], connection.sock
    found = np.frombuffer(answer.read(), "<f4").reshape(-1, int(answer.headers["Bands"]) ** 2)
    assert answer.status == 201 and answer.headers["Content-Type"] == "application/octet-stream"
    np.testing.assert_allclose(found, expected.first.coefficients, atol=1e-6)
    for pose in (BENT, MESH.vertices):
        connection.request("POST", f"{name}/poses", pose.tobytes())
        answer = connection.getresponse()
        found = np.frombuffer(answer.read(), "<f4").reshape(-1, 9)
        assert answer.status == 200 and connection.sock is used
        np.testing.assert_allclose(found, expected.predict(pose).coefficients, atol=1e-6)
    stages = [entry.split(";dur=") for entry in answer.headers["Server-Timing"].split(", ")]
    assert [stage for stage, _ in stages] == ["read", "wait", "check", "graph", "network"]
    assert all(float(value) >= 0 for _, value in stages)
    connection.close()
    assert ask(port, "DELETE", name).status == 204
    assert ask(port, "POST", f"{name}/poses", BENT.tobytes()).status == 404


def test_another_model_is_chosen_by_name(port: int, models: dict[str, Model]) -> None:
    path, body = mesh_request(MESH)
    answer = ask(port, "POST", f"{path}&model=flat", body)
    assert answer.headers["Bands"] == "2"
    expected = models["flat"].predict(MESH).coefficients
    np.testing.assert_allclose(answer.numbers.reshape(-1, 4), expected, atol=1e-6)


def test_it_says_what_it_serves(port: int) -> None:
    said = json.loads(ask(port, "GET", "/models").body)
    assert said["models"] == [{"name": "tiny", "bands": 3}, {"name": "flat", "bands": 2}]
    assert said["limits"]["vertices"] == LIMITS.vertices
    assert set(_idle(port)) == {"status", "meshes", "held_mib", "requests"}


GOOD, BODY = mesh_request(MESH)
NAN = MESH.vertices.copy()
NAN[5] = np.nan
BAD: dict[str, tuple[str, str, bytes, int, str]] = {
    "nan": ("POST", GOOD, NAN.tobytes() + BODY[NAN.nbytes :], 400, "1 of 362 vertices are not finite (first: 5)"),
    "index": ("POST", GOOD, BODY[:-4] + b"\xff\xff\xff\x7f", 400, "name a vertex that does not exist"),
    "short": ("POST", GOOD, BODY[:-4], 400, "bytes: so many vertices and faces have"),
    "long": ("POST", GOOD, BODY + b"0", 400, "bytes: so many vertices and faces have"),
    "empty": ("POST", GOOD, b"", 400, "the body has 0 bytes"),
    "no counts": ("POST", "/meshes", BODY, 400, "say how many vertices"),
    "too many": ("POST", "/meshes?vertices=1001&faces=1", BODY, 413, "more than this service takes (1000)"),
    "parameter": ("POST", f"{GOOD}&modle=tiny", BODY, 400, "did you mean 'model'?"),
    "model": ("POST", f"{GOOD}&model=../../etc/passwd", BODY, 404, "no model '../../etc/passwd' is served"),
    "mesh": ("POST", "/meshes/0123/poses", BODY, 404, "no mesh '0123' is held"),
    "path": ("GET", "/../etc/passwd", b"", 404, "is not served; there is POST /meshes"),
    "slash": ("POST", GOOD.replace("?", "/?"), BODY, 404, "is not served"),
    "method": ("PUT", "/meshes", BODY, 405, "is not served"),
    "delete": ("DELETE", "/meshes/0123", b"", 404, "no mesh"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_requests_get_one_line(port: int, name: str) -> None:
    method, path, body, status, said = BAD[name]
    answer = ask(port, method, path, body)
    text = answer.body.decode()
    assert answer.status == status and said in text, text
    assert text.startswith("error: ") and text.count("\n") == 1 and text.endswith("\n") and "Traceback" not in text


def test_a_body_of_unknown_length_is_refused(port: int) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", port)
    connection.request("POST", GOOD, iter([BODY]), encode_chunked=True, headers={"Transfer-Encoding": "chunked"})
    assert connection.getresponse().status == 411
    connection.close()


def test_cut_off_and_garbled_requests_leave_nothing_behind(port: int) -> None:
    head = f"POST {GOOD} HTTP/1.1\r\nHost: a\r\nContent-Length: {len(BODY)}\r\n\r\n".encode()
    for sent in (head + BODY[:-1], head[:-10], head, b"\x00\xff" * 50, b"GET / HTTP/9.9\r\n\r\n", b""):
        with socket.create_connection(("127.0.0.1", port)) as raw:
            raw.sendall(sent)
    _idle(port)
    assert ask(port, "POST", GOOD, BODY).status == 201


def test_the_least_recently_used_mesh_leaves(port: int) -> None:
    first, second, third = (ask(port, "POST", GOOD, BODY).headers["Location"] for _ in range(3))
    assert ask(port, "POST", f"{first}/poses", BENT.tobytes()).status == 200
    ask(port, "POST", GOOD, BODY)
    found = [ask(port, "POST", f"{name}/poses", BENT.tobytes()).status for name in (first, second, third)]
    assert found == [200, 404, 200] and _idle(port)["meshes"] == LIMITS.meshes


def test_slow_bodies_end_and_take_limited_places(port: int) -> None:
    """Two bodies that never come hold both places: a third request is told to come again, the two to be faster."""
    head = f"POST {GOOD} HTTP/1.1\r\nHost: a\r\nContent-Length: {len(BODY)}\r\n\r\n".encode()
    slow = [socket.create_connection(("127.0.0.1", port)) for _ in range(LIMITS.requests)]
    for raw in slow:
        raw.sendall(head)
    while json.loads(ask(port, "GET", "/health").body)["requests"] < LIMITS.requests:
        time.sleep(0.01)
    answer = ask(port, "POST", GOOD, BODY)
    assert answer.status == 503 and answer.headers["Retry-After"] == "1" and b"come again" in answer.body
    for raw in slow:
        assert b"408" in raw.recv(20)
        raw.close()
    _idle(port)
    assert ask(port, "POST", GOOD, BODY).status == 201


def test_connections_that_say_nothing_are_closed(models: dict[str, Model], monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is silent, one that never ends its head, one that never asks again."""
    monkeypatch.setattr("gash_jax.apps.service.server.IDLE_SECONDS", 1)
    health = b"GET /health HTTP/1.1\r\nHost: a\r\n\r\n"
    with served({"tiny": models["tiny"]}, LIMITS) as port:
        for sent in (b"", health[:-2], health, health + health[:-2]):
            with socket.create_connection(("127.0.0.1", port), timeout=60) as raw:
                raw.sendall(sent)
                said = b"".join(iter(lambda: raw.recv(1 << 16), b""))  # ends where the service closes
                assert said.count(b'"status":"ok"') == (health in sent)


def test_work_that_takes_too_long_is_not_waited_for(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    release = threading.Event()
    monkeypatch.setattr(wire, "mesh_of_body", lambda *_: release.wait(60) and None)
    try:
        answers = [ask(port, "POST", GOOD, BODY) for _ in range(2)]  # the second has not begun when its time is up
        assert [answer.status for answer in answers] == [503, 503] and b"no answer within 2 s" in answers[0].body
        assert _idle(port)["status"] == "ok"
    finally:
        release.set()
    monkeypatch.undo()
    assert ask(port, "POST", GOOD, BODY).status == 201


def test_a_fault_of_ours_is_a_line_and_the_service_goes_on(
    port: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(wire, "mesh_of_body", lambda *_: 1 / 0)
    answer = ask(port, "POST", GOOD, BODY)
    assert answer.status == 500 and answer.body.startswith(b"error: a fault of the service (ZeroDivisionError)")
    monkeypatch.undo()
    assert ask(port, "POST", GOOD, BODY).status == 201 and _idle(port)["requests"] == 0
    assert "ZeroDivisionError: division by zero" in caplog.text


def test_only_the_pages_that_were_named_may_call_from_a_browser(port: int) -> None:
    answers = [ask(port, "GET", "/models", Origin=origin) for origin in (ORIGIN, "https://other.example")]
    assert [answer.headers.get("Access-Control-Allow-Origin") for answer in answers] == [ORIGIN, None]
    assert "Location" in answers[0].headers["Access-Control-Expose-Headers"]
