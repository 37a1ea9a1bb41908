"""All methods on one mesh: reference, best counts of the plain bake, rounds; and all meshes together.

What was measured of a mesh is kept in a file of `pieces` as soon as it is done, under the hash of all that determines
it, so that an interrupted command goes on where it was.
"""

import hashlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gash_jax.apps.frontier.methods import ERRORS, METHODS, Task, settings_of
from gash_jax.apps.frontier.moving import joined_reference
from gash_jax.apps.pictures.frontier import timed_vertices
from gash_jax.apps.pictures.views import cast_view, shade_view
from gash_jax.files.atomic import write_json
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.shading import shade
from gash_jax.measure.best_count import compare_targets, fewest_rays, plain_error, pooled_targets
from gash_jax.measure.frontier import first_calls, measure_in_turn, pooled, relative_noise
from gash_jax.measure.metrics import image_scores
from gash_jax.measure.reference import Reference, make_reference
from gash_jax.prt.tracing import ProgressFn

PICTURE_VIEWS, PICTURE_SIZE = ("front", "back"), 256
# which part of the time of a mesh the stages take, about: first calls, reference, best counts, rounds
STAGES = (0.2, 0.1, 0.1, 0.6)
RESOLUTION = 1000  # of the progress of a mesh


class Choice(NamedTuple):
    """What is measured on every mesh: methods by name, rays of the reference, rounds, light by its coefficients."""

    methods: Sequence[str]
    rays: int
    rounds: int
    light: np.ndarray | None


def measure_mesh(task: Task, choice: Choice, progress: ProgressFn | None = None) -> dict[str, Any]:
    """Everything about one mesh, ready for JSON. `progress(done, total)` counts shares of the expected time.

    Raises ValueError where none of the methods can be run.
    """
    settings, skipped = settings_of(task, choice.methods)
    if not settings:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in skipped.items()) or "of other kinds of mesh"
        raise ValueError(f"none of the methods can be run, choose others with --methods ({reasons})")
    first = first_calls(settings, _part(progress, 0))  # before anything else compiles what they share with it
    reference = _reference(task, choice.rays, _part(progress, 1))
    best: dict[float, int | None] = {}
    if {"plain", "error"} <= set(choice.methods) and not task.bounces and not task.frames:
        best = fewest_rays(lambda rays: plain_error(task.mesh, reference, rays), ERRORS, progress=_part(progress, 2))
    counts = [count for count in best.values() if count is not None]
    settings, _ = settings_of(task._replace(plain_counts=counts), choice.methods)
    found = {
        "vertices": len(task.mesh.vertices),
        "faces": len(task.mesh.faces),
        "frames": len(task.frames),
        "bounces": task.bounces,
        "reference_relrmse": relative_noise(reference),
        "skipped": skipped,
    }
    score = None
    if choice.light is not None and not task.frames:
        score = picture_score(task.mesh, reference, choice.light)
    rows = measure_in_turn(settings, reference, first, choice.rounds, score, _part(progress, 3))
    for row in rows:
        row["label"] = METHODS[row["method"]].label
    return {**found, "rows": rows, "targets": compare_targets(rows, best)}


def _reference(task: Task, rays: int, progress: ProgressFn | None) -> Reference:
    """The reference of a mesh, or of all frames."""
    light: dict[str, Any] = {"bounces": task.bounces, "albedo": task.albedo}
    if not task.frames:
        return make_reference(task.mesh, task.bands, rays, progress, **light)
    found = []
    for step, frame in enumerate(task.frames):
        found.append(make_reference(frame, task.bands, rays, **light))
        if progress:
            progress(step + 1, len(task.frames))
    return joined_reference(found)


def _part(progress: ProgressFn | None, stage: int) -> ProgressFn | None:
    """The progress of one stage of a mesh."""
    start, share = sum(STAGES[:stage]), STAGES[stage]
    return progress and (lambda done, total: progress(round(RESOLUTION * (start + share * done / total)), RESOLUTION))


def picture_score(mesh: Mesh, reference: Reference, light: np.ndarray) -> Callable[[np.ndarray], float] | None:
    """PSNR (dB) of coefficients, over linear pictures from the front and the back; None where these are black."""
    hits = [cast_view(mesh, view, PICTURE_SIZE) for view in PICTURE_VIEWS]

    def pictures(coefficients: np.ndarray) -> np.ndarray:
        radiance = np.asarray(shade(coefficients, light))
        return np.concatenate([shade_view(hit, radiance)[0] for hit in hits])

    truth = pictures(reference.coefficients)
    if truth.max() <= 0:
        return None
    return lambda coefficients: image_scores(pictures(coefficients), truth)["psnr"]


def pool(meshes: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """All meshes together and all animations together, for each number of bounces apart."""
    found = []
    for moving, bounces in dict.fromkeys((mesh["frames"] > 0, mesh["bounces"]) for mesh in meshes):
        held = [mesh for mesh in meshes if (mesh["frames"] > 0, mesh["bounces"]) == (moving, bounces)]
        rows = [{**row, "mesh": mesh["mesh"]} for mesh in held for row in mesh["rows"]]
        of = [timed_vertices(mesh) for mesh in held for _ in mesh["rows"]]
        together = pooled(rows, of)
        for row in together:
            row["label"] = METHODS[row["method"]].label
        targets = pooled_targets([mesh["targets"] for mesh in held])
        named = {"moving": moving, "bounces": bounces, "meshes": len(held)}
        found.append({**named, "rows": together, "targets": targets})
    return found


def key_of(frames: Sequence[Mesh], *rest: Any) -> str:
    """The hash of all that determines what is measured of a mesh; arrays and bytes count by what they hold."""
    digest = hashlib.sha256()
    for array in (array for mesh in frames for array in mesh):
        digest.update(np.ascontiguousarray(array).tobytes())
    for value in rest:
        digest.update(value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode())
    return digest.hexdigest()


def read_piece(path: Path, key: str) -> dict[str, Any] | None:
    """What was measured of a mesh before; None where it is absent, damaged or of something else."""
    try:
        held = json.loads(path.read_text(encoding="utf-8"))
        return held["values"] if held["of"] == key and held["sha256"] == _hash(held["values"]) else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def write_piece(path: Path, key: str, values: dict[str, Any]) -> None:
    """Keep what was measured of a mesh."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {"of": key, "values": values, "sha256": _hash(values)})


def _hash(values: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
