"""The process around the service: a socket, models compiled ahead, and an end in good order.

SIGTERM or Ctrl-C: no new connection is taken, what is being computed is answered, then the process ends with code 0. A
second Ctrl-C ends it at once.
"""

import asyncio
import math
import signal
import socket
from collections.abc import Callable, Mapping

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from gash_jax.apps.service.app import make_app
from gash_jax.apps.service.limits import Limits
from gash_jax.models.held import warm_up
from gash_jax.models.model import Model

CONNECTIONS = 4  # that may be open at a time, for each request that may run: most only wait for their next request
IDLE_SECONDS = 60  # after which a connection without a request is closed


class Patient(H11Protocol):
    """HTTP/1.1 that closes connections too that have never sent a whole head, which uvicorn leaves open for ever."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """A client has come."""
        super().connection_made(transport)
        self._expect_head()

    def data_received(self, data: bytes) -> None:
        """It has sent something."""
        super().data_received(data)
        self._expect_head()

    def _expect_head(self) -> None:
        answered = self.cycle is None or self.cycle.response_complete
        if answered and self.timeout_keep_alive_task is None:
            close = self.timeout_keep_alive_handler
            self.timeout_keep_alive_task = self.loop.call_later(self.timeout_keep_alive, close)


def listen(host: str, port: int) -> socket.socket:
    """A socket that listens, at a free port for 0. Raises ValueError where that cannot be."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise ValueError(
            f"cannot listen at {host}:{port} ({error.strerror}): choose another --host or --port"
        ) from None


def make_server(models: Mapping[str, Model], limits: Limits, origins: tuple[str, ...] = ()) -> uvicorn.Server:
    """The web server of these models; every program that they need is compiled before it returns."""
    for model in models.values():
        warm_up(model)
    config = uvicorn.Config(
        make_app(models, limits, origins),
        log_config=None,
        log_level="error",
        access_log=False,
        server_header=False,
        http=Patient,
        ws="none",
        limit_concurrency=CONNECTIONS * limits.requests,
        timeout_keep_alive=IDLE_SECONDS,
        timeout_graceful_shutdown=math.ceil(limits.seconds),
    )
    return uvicorn.Server(config)


def run_until_stopped(server: uvicorn.Server, listening: socket.socket, ready: Callable[[], None]) -> None:
    """Serve until SIGTERM or Ctrl-C; `ready` is called when the first request can come."""

    def stop(*_: object) -> None:  # before uvicorn listens to signals, and when it raises them again at its end
        server.should_exit = True

    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, stop)
    ready()
    asyncio.run(server.serve([listening]))
