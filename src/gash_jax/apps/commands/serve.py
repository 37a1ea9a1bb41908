"""`gash serve`: transfer over HTTP, for engines and pages; docs/service.md says how it is spoken to."""

from pathlib import Path

import click

from gash_jax.apps.options import Command
from gash_jax.apps.printing import say
from gash_jax.apps.service.limits import Limits
from gash_jax.models.model import load_model

DEFAULT = Limits()


def _limit(name: str, default: int, help: str):
    return click.option(name, type=click.IntRange(1), default=default, show_default=True, help=help)


@click.command(cls=Command, epilog="gash serve --port 8017")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen at; 0.0.0.0 is open to all.")
@click.option("--port", type=click.IntRange(0, 65535), default=8017, show_default=True, help="0 for a free one.")
@click.option(
    "--model",
    "names",
    multiple=True,
    default=("local",),
    show_default=True,
    help="`local`, or weights or a run of its kind; repeatable.",
)
@click.option("--origin", "origins", multiple=True, help="A web page's origin that may call; repeatable.")
@_limit("--max-vertices", DEFAULT.vertices, "Vertices of a mesh.")
@_limit("--max-faces", DEFAULT.faces, "Faces of a mesh.")
@_limit("--max-meshes", DEFAULT.meshes, "Meshes held; the least recently used leaves.")
@_limit("--max-memory", DEFAULT.memory_mib, "MiB of the meshes held.")
@_limit("--max-requests", DEFAULT.requests, "Requests at a time; more are told to come again.")
@click.option(
    "--timeout",
    type=click.FloatRange(0.1, 3600),
    default=DEFAULT.seconds,
    show_default=True,
    help="Seconds for a body to arrive, and for an answer.",
)
def serve(
    host: str,
    port: int,
    names: tuple[str, ...],
    origins: tuple[str, ...],
    max_vertices: int,
    max_faces: int,
    max_meshes: int,
    max_memory: int,
    max_requests: int,
    timeout: float,
) -> None:
    """Answer meshes with their transfer over HTTP, by a network; meshes that deform send positions only."""
    try:
        from gash_jax.apps.service.server import listen, make_server, run_until_stopped
    except ModuleNotFoundError as error:
        raise click.ClickException(f"{error.name} is not installed: pip install 'gash-jax[serve]'") from None
    models = {Path(name).stem: load_model(name) for name in names}
    if len(models) < len(names):
        raise click.UsageError("two models have the same name: rename one of the files")
    limits = Limits(max_vertices, max_faces, max_meshes, max_memory, max_requests, timeout)
    with listen(host, port) as listening:
        server = make_server(models, limits, origins)
        shown = f"[{host}]" if ":" in host else host
        said = f"serving {', '.join(models)} at http://{shown}:{listening.getsockname()[1]} (Ctrl-C stops)"
        run_until_stopped(server, listening, lambda: say(said))
    say("stopped")
