"""The service in a thread of this process, at a free port, with a tiny network; and requests to it over sockets."""

import asyncio
import http.client
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from gash_jax.apps.service.limits import Limits
from gash_jax.apps.service.server import listen, make_server
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.models.model import Model
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.bumpy import random_variables


def tiny_model(bands: int = 3) -> Model:
    """A surfel network of random weights that compiles in little time."""
    config = model_config("local", bands, channels=8, layers=1)
    variables = random_variables(build_model(config), model_graph(config, bumpy_sphere(3)), spread=0.1)
    return Model(config, variables["params"])


@contextmanager
def served(models: Mapping[str, Model], limits: Limits, origins: tuple[str, ...] = ()) -> Iterator[int]:
    """The port of a service that runs until the end of the context."""
    server = make_server(models, limits, origins)
    with listen("127.0.0.1", 0) as listening:
        thread = threading.Thread(target=lambda: asyncio.run(server.serve([listening])))
        thread.start()
        while not server.started:
            time.sleep(0.01)
        try:
            yield listening.getsockname()[1]
        finally:
            server.should_exit = True
            thread.join()


class Answer(NamedTuple):
    status: int
    headers: http.client.HTTPMessage
    body: bytes

    @property
    def numbers(self) -> np.ndarray:
        return np.frombuffer(self.body, "<f4")


def ask(port: int, method: str, path: str, body: bytes | None = None, **headers: str) -> Answer:
    """One request over a connection of its own."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    try:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return Answer(answer.status, answer.headers, answer.read())
    finally:
        connection.close()
