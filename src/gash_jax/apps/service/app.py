"""Addresses of the service, and what happens at each. docs/service.md is the specification.

Everything that computes runs in one worker thread, one request after the other, as each uses all cores; the event loop
stays free to read, to refuse and to say how things are. A request takes one of a limited number of places before its
body is read and gives it back whatever happens, so memory is bounded by what so many bodies take.

Every answer that is not 2xx is one line of text. A fault of ours is a 500, with what happened on the error stream; the
service goes on.
"""

import asyncio
import time
from collections.abc import AsyncIterator, Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager, contextmanager
from typing import Any, NamedTuple

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.cors import CORSMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from gash_jax.apps.service import wire
from gash_jax.apps.service.limits import Limits, Refusal
from gash_jax.apps.service.meshes import MIB, HeldMeshes
from gash_jax.files.settings import near_names
from gash_jax.geometry.mesh import MeshError
from gash_jax.models.held import HeldMesh, Prediction
from gash_jax.models.model import Model

BYTES = "application/octet-stream"


class Work(NamedTuple):
    """What the worker brings back: a result, and when it began and how long the checks took."""

    mesh: HeldMesh
    found: Prediction
    began: float
    check: float


class Service:
    """The models that are served, the meshes that are held, and the one thread that computes."""

    def __init__(self, models: Mapping[str, Model], limits: Limits):
        self.models, self.limits, self.meshes = models, limits, HeldMeshes(limits)
        self.worker = ThreadPoolExecutor(1, "gash-worker")
        self.running = 0

    async def new_mesh(self, request: Request) -> Response:
        """POST /meshes: hold a mesh, answer its coefficients."""
        wire.check_names(request.query_params, ("vertices", "faces", "model"))
        model = self._model(request.query_params.get("model"))
        vertices, faces = wire.mesh_counts(request.query_params, self.limits)

        def work(body: bytearray) -> Work:
            began = time.perf_counter()
            mesh = wire.mesh_of_body(body, vertices, faces)
            check = time.perf_counter() - began
            held = HeldMesh(model, mesh)
            return Work(held, held.first, began, check)

        done, seconds = await self._answer(request, wire.mesh_lengths(vertices, faces), work)
        location = {"Location": f"/meshes/{self.meshes.add(done.mesh)}"}
        return _coefficients(done.found, seconds, 201, location)

    async def new_pose(self, request: Request) -> Response:
        """POST /meshes/ID/poses: the coefficients of a held mesh in another pose."""
        wire.check_names(request.query_params, ())
        mesh = self.meshes.get(request.path_params["mesh"])

        def work(body: bytearray) -> Work:
            began = time.perf_counter()
            return Work(mesh, mesh.predict(wire.read_positions(body)), began, 0.0)

        done, seconds = await self._answer(request, (wire.ROW * len(mesh.mesh.vertices),), work)
        self.meshes.shrink()  # the first pose has added to what is kept
        return _coefficients(done.found, seconds, 200, {})

    async def delete_mesh(self, request: Request) -> Response:
        """DELETE /meshes/ID."""
        self.meshes.remove(request.path_params["mesh"])
        return Response(status_code=204)

    async def health(self, request: Request) -> Response:
        """GET /health: what is held and what runs."""
        held = {"meshes": len(self.meshes), "held_mib": round(self.meshes.nbytes / MIB, 1)}
        return JSONResponse({"status": "ok", **held, "requests": self.running})

    async def list_models(self, request: Request) -> Response:
        """GET /models: names, bands and limits; the first is the default."""
        models = [{"name": name, "bands": model.config.bands} for name, model in self.models.items()]
        return JSONResponse({"models": models, "limits": self.limits._asdict()})

    def _model(self, name: str | None) -> Model:
        if name is None:
            return next(iter(self.models.values()))
        if name not in self.models:
            near = near_names(name[:40], self.models)
            raise Refusal(404, f"no model {name[:40]!r} is served{near}; there is {', '.join(self.models)}")
        return self.models[name]

    async def _answer(
        self, request: Request, lengths: tuple[int, ...], work: Callable[[bytearray], Work]
    ) -> tuple[Work, dict[str, float]]:
        """What the worker makes of the body of a request, and the seconds of its stages."""
        with self._place():
            length = wire.check_length(request.headers.get("content-length"), lengths)
            started = time.perf_counter()
            body = await self._read(request, length)
            read = time.perf_counter()
            done = await self._run(work, body)
        waited = {"read": read - started, "wait": done.began - read, "check": done.check}
        return done, {**waited, **done.found.seconds}

    @contextmanager
    def _place(self) -> Iterator[None]:
        """One of the limited number of places."""
        if self.running >= self.limits.requests:
            raise Refusal(503, f"{self.running} requests are being served, no more are taken: come again in a second")
        self.running += 1
        try:
            yield
        finally:
            self.running -= 1

    async def _read(self, request: Request, length: int) -> bytearray:
        body, filled = bytearray(length), 0
        try:
            async with asyncio.timeout(self.limits.seconds):
                async for chunk in request.stream():
                    body[filled : filled + len(chunk)] = chunk
                    filled += len(chunk)
        except TimeoutError:
            raise Refusal(
                408, f"{filled} of {length} bytes came in {self.limits.seconds:g} s: send them faster"
            ) from None
        except ClientDisconnect:  # nobody hears this
            raise Refusal(400, f"the connection was cut off after {filled} of {length} bytes") from None
        return body

    async def _run(self, work: Callable[[bytearray], Work], body: bytearray) -> Work:
        """Run in the worker. What has not begun in time is dropped; what has goes on, but nobody waits for it."""
        future = asyncio.wrap_future(self.worker.submit(work, body))
        try:
            return await asyncio.wait_for(future, self.limits.seconds)
        except TimeoutError:
            raise Refusal(
                503, f"no answer within {self.limits.seconds:g} s: come again, or send fewer vertices"
            ) from None


def _coefficients(found: Prediction, seconds: dict[str, float], status: int, headers: dict[str, str]) -> Response:
    """Coefficients as v x k little-endian float32, with the milliseconds of each stage (Server-Timing)."""
    stages = ", ".join(f"{name};dur={1e3 * value:.2f}" for name, value in seconds.items())
    body = found.coefficients.astype("<f4", copy=False).tobytes()
    bands = str(round(found.coefficients.shape[1] ** 0.5))
    return Response(body, status, {**headers, "Bands": bands, "Server-Timing": stages}, BYTES)


def _line(status: int, text: str, headers: Mapping[str, str] | None = None) -> Response:
    return PlainTextResponse(f"error: {' '.join(text.split())}\n", status, headers)


def _refused(request: Request, error: Any) -> Response:
    return _line(error.status, error.text, {"Retry-After": "1"} if error.status == 503 else None)


def _bad_mesh(request: Request, error: Exception) -> Response:
    return _line(400, str(error))


def _no_address(request: Request, error: Any) -> Response:
    known = "POST /meshes, POST /meshes/ID/poses, DELETE /meshes/ID, GET /health, GET /models"
    text = f"{request.method} {request.url.path[:80]!r} is not served; there is {known}"
    return _line(error.status_code, text, error.headers)


def _fault(request: Request, error: Exception) -> Response:
    return _line(500, f"a fault of the service ({type(error).__name__}), which goes on; it has been written down")


def make_app(models: Mapping[str, Model], limits: Limits, origins: tuple[str, ...] = ()) -> Starlette:
    """The service as an ASGI application; `origins` are the web pages that may call it from a browser."""
    service = Service(models, limits)

    @asynccontextmanager
    async def lifespan(app: Starlette) -> AsyncIterator[None]:
        yield
        service.worker.shutdown(cancel_futures=True)

    routes = [
        Route("/meshes", service.new_mesh, methods=["POST"]),
        Route("/meshes/{mesh}/poses", service.new_pose, methods=["POST"]),
        Route("/meshes/{mesh}", service.delete_mesh, methods=["DELETE"]),
        Route("/health", service.health),
        Route("/models", service.list_models),
    ]
    handlers: Any = {Refusal: _refused, MeshError: _bad_mesh, HTTPException: _no_address, Exception: _fault}
    told: Any = {"allow_methods": ["GET", "POST", "DELETE"], "expose_headers": ["Location", "Bands", "Server-Timing"]}
    pages = [Middleware(CORSMiddleware, allow_origins=origins, **told)] if origins else []
    app = Starlette(routes=routes, middleware=pages, exception_handlers=handlers, lifespan=lifespan)
    app.router.redirect_slashes = False
    return app
