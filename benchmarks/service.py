"""`gash serve` from outside, over sockets: `.venv/bin/python -m benchmarks.service --output FILE.json`.

*Latency*: one connection that is kept alive, meshes of the sizes of the GNN paper's Table 5; a new mesh, a pose of it
and, in this process, `Model.predict` of the same mesh, in turn; medians, by the stages that the service itself reports.
Worth something only where nothing else runs.

*Load*: many clients at a time, one in ten of their requests malformed or cut off in the middle. Every good request must
be answered with the coefficients that the same network gives in this process, every bad one be refused, and the
service's memory must not grow.
"""

import http.client
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import parser, saved
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.provenance import provenance
from gash_jax.models.held import HeldMesh, warm_up
from gash_jax.models.model import Model, load_model
from gash_jax.shapes.primitives import bumpy_sphere

# GNN paper, Table 5: vertices, and milliseconds from end to end
PAPER = {"Bipolar": (3808, 68.10), "Focus": (8534, 121.85), "Coolseal": (9673, 146.47)}
PAPER |= {"Brain": (21966, 271.30), "Heart": (29661, 2730.27), "Anatomy": (33995, 4886.75)}
LOADED = 10  # resolution of the mesh that clients send
BAD_EVERY, NEW_EVERY = 10, 8  # requests; the first of so many is bad, or a new mesh in place of a pose


@contextmanager
def service(model: str) -> Iterator[tuple[subprocess.Popen, int]]:
    """`gash serve` as a process of its own, and its port; stopped in good order at the end."""
    command = [sys.executable, "-m", "gash_jax", "serve", "--port", "0", "--model", model]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        found = re.search(r"http://127\.0\.0\.1:(\d+) ", process.stdout.readline())
        if not found:
            raise RuntimeError("the service did not start")
        try:
            yield process, int(found[1])
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait()


def mesh_request(mesh: Mesh) -> tuple[str, bytes]:
    """Path and body of a new mesh."""
    path = f"/meshes?vertices={len(mesh.vertices)}&faces={len(mesh.faces)}"
    return path, b"".join(array.tobytes() for array in mesh)


def post(connection: http.client.HTTPConnection, path: str, body: bytes) -> tuple[http.client.HTTPResponse, bytes]:
    """Answer and its body."""
    connection.request("POST", path, body)
    answer = connection.getresponse()
    return answer, answer.read()


def milliseconds(connection: http.client.HTTPConnection, path: str, body: bytes) -> tuple[str, dict[str, float]]:
    """Where the mesh is held, and what a request took: in total, in the service's stages, and besides them."""
    started = time.perf_counter()
    answer, _ = post(connection, path, body)
    total = 1e3 * (time.perf_counter() - started)
    told = answer.headers["Server-Timing"] or ""
    stages = {name: float(value) for name, value in re.findall(r"(\w+);dur=([\d.]+)", told)}
    return answer.headers["Location"] or "", {**stages, "transfer": total - sum(stages.values()), "total": total}


def latency(port: int, model: Model, mesh: Mesh, repeats: int) -> dict[str, Any]:
    """Medians of a new mesh, of a pose of it, and of the prediction in this process."""
    connection, (path, body) = http.client.HTTPConnection("127.0.0.1", port), mesh_request(mesh)
    found: dict[str, list[dict[str, float]]] = {"new": [], "pose": []}
    alone = []
    for step in range(repeats + 1):  # the first is not counted
        name, new = milliseconds(connection, path, body)
        milliseconds(
            connection, f"{name}/poses", body[: mesh.vertices.nbytes]
        )  # the first one carries the normals along
        _, pose = milliseconds(connection, f"{name}/poses", body[: mesh.vertices.nbytes])
        started = time.perf_counter()
        model.predict(mesh)
        if step:
            alone.append(1e3 * (time.perf_counter() - started))
            found["new"].append(new)
            found["pose"].append(pose)
    connection.close()
    medians = {kind: {k: float(np.median([row[k] for row in rows])) for k in rows[0]} for kind, rows in found.items()}
    return {"vertices": len(mesh.vertices), **medians, "predict": float(np.median(alone))}


class Client:
    """One of the clients of the load test: a connection, a held mesh, and a count of what became of its requests."""

    def __init__(self, port: int, poses: list[tuple[bytes, np.ndarray]], mesh: Mesh, seed: int):
        self.port, self.poses, self.new = port, poses, mesh_request(mesh)
        self.random, self.counts, self.name = np.random.default_rng(seed), Counter(), ""
        self.connection = http.client.HTTPConnection("127.0.0.1", port, timeout=600)

    def run(self, requests: int, done: Callable[[], None]) -> None:
        """All requests, one after the other; a fault of the service is counted, not raised."""
        for number in range(requests):
            try:
                if number % BAD_EVERY == BAD_EVERY // 2:
                    self._bad()
                else:
                    self._good(not self.name or number % NEW_EVERY == 0)
            except (OSError, http.client.HTTPException):
                self.counts["lost"] += 1
                self.connection.close()
            done()
        self.connection.close()

    def _good(self, new: bool) -> None:
        pose = 0 if new else int(self.random.integers(len(self.poses)))
        body, expected = self.poses[pose]
        if new and self.name:
            self.connection.request("DELETE", self.name)
            self.connection.getresponse().read()
        answer, found = post(self.connection, *(self.new if new else (f"{self.name}/poses", body)))
        self.name = answer.headers["Location"] or self.name
        right = answer.status in (200, 201) and len(found) == expected.nbytes
        right = right and np.abs(np.frombuffer(found, "<f4") - expected.ravel()).max() < 1e-4
        self.counts["answered" if right else "lost"] += 1

    def _bad(self) -> None:
        """Malformed in one of several ways, or cut off in the middle of its body."""
        path, body = self.new
        if self.random.random() < 0.5:
            head = f"POST {path} HTTP/1.1\r\nHost: a\r\nContent-Length: {len(body)}\r\n\r\n".encode()
            with socket.create_connection(("127.0.0.1", self.port)) as raw:
                raw.sendall(head + body[: int(self.random.integers(len(body)))])
            self.counts["cut off"] += 1
            return
        index, nan = body[:-4] + b"\xff\xff\xff\x7f", b"\x00\x00\xc0\x7f" + body[4:]
        bad = [(path, nan), (path, index), (path, body[:-1]), ("/meshes?vertices=x", body), ("/meshes/0/poses", body)]
        answer, _ = post(self.connection, *bad[int(self.random.integers(len(bad)))])
        self.counts["refused" if 400 <= answer.status < 500 else "lost"] += 1


def memory_mib(pid: int) -> float:
    """Resident memory of a process (Linux)."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(re.findall(r"VmRSS:\s+(\d+)", status)[0]) / 1024


def load(process: subprocess.Popen, port: int, model: Model, clients: int, requests: int) -> dict[str, Any]:
    """What became of the requests of all clients, and the service's memory after each tenth of them."""
    mesh = bumpy_sphere(LOADED)
    held, grown = HeldMesh(model, mesh), [mesh.vertices * np.float32(1 + 0.1 * i) for i in range(4)]
    poses = [(pose.tobytes(), held.predict(pose).coefficients) for pose in grown]
    everyone = [Client(port, poses, mesh, seed) for seed in range(clients)]
    lock, done, memory = threading.Lock(), [0], []

    def count() -> None:
        with lock:
            done[0] += 1
            if done[0] % max(clients * requests // 10, 1) == 0:
                memory.append(memory_mib(process.pid))

    threads = [threading.Thread(target=client.run, args=(requests, count)) for client in everyone]
    started = time.perf_counter()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    seconds = time.perf_counter() - started
    counts = sum((client.counts for client in everyone), Counter())
    sizes = {"clients": clients, "requests": clients * requests, "vertices": len(mesh.vertices), "seconds": seconds}
    return {
        **sizes,
        **{name: counts[name] for name in ("answered", "refused", "cut off", "lost")},
        "memory_mib": memory,
    }


def main(output: Path | None, quick: bool, model: str, clients: int, requests: int, repeats: int) -> dict[str, Any]:
    network, rows = load_model(model), []
    warm_up(network)
    with service(model) as (process, port):
        for name, (vertices, paper) in list(PAPER.items())[: 1 if quick else None]:
            mesh = bumpy_sphere(5 if quick else round(((vertices - 2) / 10) ** 0.5))
            row = latency(port, network, mesh, repeats)
            rows.append({"paper_mesh": name, "paper_vertices": vertices, "paper_ms": paper, **row})
            print(rows[-1], flush=True)
        loaded = load(process, port, network, clients, requests)
        print(loaded, flush=True)
    arguments = {"model": Path(model).stem, "repeats": repeats, "exit_code": process.returncode}
    return saved(output, {**provenance(seed=0, arguments=arguments), "rows": rows, "load": loaded})


if __name__ == "__main__":
    command = parser(__doc__, "output", "quick", "model")
    command.add_argument("--clients", type=int, default=8)
    command.add_argument("--requests", type=int, default=200, help="of each client")
    command.add_argument("--repeats", type=int, default=15, help="of each latency")
    main(**vars(command.parse_args()))
