"""How fast `local` is: stage by stage beside the two-stage network and a bake, up to a million vertices, and in motion.

    .venv-peers/bin/python -m experiments.local.speed --meshes FOLDER --animated FOLDER --output FILE.json

Times are worth something only where nothing else runs: medians after a warm-up. In an environment without PyTorch
Geometric its column stays empty; without FOLDER only meshes that the project generates are measured.
"""

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import parser, saved
from experiments.neural_gash import latency
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure import metrics
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, Reference, make_reference, score
from gash_jax.measure.timing import timed
from gash_jax.models.deforming import deforming_predictor
from gash_jax.models.families import labels_of
from gash_jax.models.model import Model, load_model
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere

# frequencies of the geodesic sphere: 10 f² + 2 vertices
RESOLUTIONS = (32, 100, 178, 316)
MOTIONS = ("cesium_man_walk", "cat_poses", "lion_poses", "cat_run_lowpoly")
FRAMES, RAYS = 12, 1024
# of the plain bake whose flicker stands beside the network's
FEW_RAYS = 64
ROOT = Path(__file__).parents[2]


def stages(models: dict[str, Model], mesh: Mesh, reference: Reference) -> dict[str, Any]:
    """Microseconds a vertex of `local` and, in the same run, of the two-stage network, its twin and plain bakes.

    `local` also with all the bands that it knows, and with all bounces. One of the bakes has as many rays as `local` is
    worth on this mesh (none where that is only bounded).
    """
    us = 1e6 / len(mesh.vertices)
    graph, building = timed(lambda: models["local"].graph(mesh))
    _, network = timed(lambda: models["local"](graph))
    _, whole = timed(lambda: models["local"].predict(mesh))
    row: dict[str, Any] = {"graph": building * us, "network": network * us, "predict": whole * us}
    row["all bands"] = timed(lambda: models["all bands"].predict(mesh))[1] * us
    if bounces := labels_of(models["local"].config)[1]:
        row["bounces"] = timed(lambda: models["local"].predict(mesh, bounces=bounces, albedo=0.5))[1] * us
    row["equivalent rays"] = score(models["local"].predict(mesh).coefficients, mesh, reference)["equivalent_rays"]
    bakes = {"bake 8": 8, "bake 16": 16}
    if isinstance(row["equivalent rays"], float):
        bakes["bake of equal error"] = round(row["equivalent rays"])
    for label, rays in bakes.items():
        _, seconds = timed(lambda n=rays: bake_transfer(mesh, rays=n, replicates=1), 5)
        row[label] = seconds * us
    other = latency.measure(mesh, models["two-stage"])
    twin = other["pyg"]
    row |= {"two-stage": ((other["stage1"] or 0) + (other["stage2"] or 0)) * us}
    return row | {"pyg": None if twin is None else twin * us}


def size(model: str, resolution: int) -> dict[str, Any]:
    """Seconds and peak memory of a prediction of one large mesh, in a process of its own."""
    command = [sys.executable, "-m", "experiments.local.speed", "--model", model, "--alone", str(resolution)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    vertices, first, second, memory = (float(word) for word in done.stdout.split()[-4:])
    return {"vertices": int(vertices), "seconds": second, "first_seconds": first, "peak_mib": memory}


def alone(model: str, resolution: int) -> None:
    """What `size` starts."""
    network, mesh = load_model(model), bumpy_sphere(resolution)
    seconds = []
    for _ in range(2):
        started = time.perf_counter()
        network.predict(mesh)
        seconds.append(time.perf_counter() - started)
    # of this program alone: what getrusage says a process starts with is its parent's peak
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    print(len(mesh.vertices), *seconds, int(status["VmHWM"].split()[0]) / 1024)


def _frames(folder: Path | None, quick: bool) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Positions (t, v, 3) and faces of every motion; the generated one is a bumpy sphere that breathes."""
    still = bumpy_sphere(12 if quick else 30)
    waves = 1 + 0.2 * np.sin(np.linspace(0, np.pi, FRAMES))[:, None, None] * np.sin(4 * still.vertices[None, :, :1])
    found = {"a breathing sphere": ((still.vertices * waves).astype(np.float32), still.faces)}
    for name in MOTIONS:
        path = folder / f"{name}.npz" if folder else None
        if path and path.exists():
            with np.load(path) as arrays:
                found[name] = (arrays["verts"][:FRAMES].astype(np.float32), arrays["faces"].astype(np.int32))
    return found


def motion(model: Model, positions: np.ndarray, faces: np.ndarray, rays: int) -> dict[str, Any]:
    """Time a frame of the compiled call, and skill and flicker.

    Beside it the closed form, a graph built anew for every frame, and a plain bake of few rays, whose directions are
    those of a vertex in every frame, and not those of the reference.
    """
    meshes = [prepare_mesh(frame, faces)[0] for frame in positions]
    started = time.perf_counter()
    predict = deforming_predictor(model, meshes[0])
    np.asarray(predict(positions[0])[0])
    ready = time.perf_counter() - started
    times, found = [], []
    for frame in positions:
        started = time.perf_counter()
        found.append(np.asarray(predict(frame)[0]))
        times.append(time.perf_counter() - started)
    bands = model.config.bands
    truth = np.stack([bake_transfer(mesh, bands, rays).coefficients for mesh in meshes])
    few = np.stack([bake_transfer(mesh, bands, FEW_RAYS, replicates=1, seed=1).coefficients for mesh in meshes])
    formula = np.stack([np.asarray(unshadowed_transfer(mesh.normals, bands)) for mesh in meshes])
    fresh = np.stack([model.predict(mesh).coefficients for mesh in meshes])
    mean = float(np.mean((formula - truth) ** 2))
    row: dict[str, Any] = {"vertices": positions.shape[1], "frames": len(positions), "ready_seconds": ready}
    row |= {"frame_ms": 1e3 * float(np.median(times)), "us": 1e6 * float(np.median(times)) / positions.shape[1]}
    kept = np.stack(found)
    estimates = {"closed form": formula, "plan kept": kept, "plan renewed": fresh, f"bake, {FEW_RAYS} rays": few}
    for name, estimate in estimates.items():
        skill = 1 - float(np.mean((estimate - truth) ** 2)) / mean
        row[name] = {"skill": skill, "flicker": metrics.flicker(estimate, truth)}
    return row


def main(model: str, meshes: Path | None, animated: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    network = load_model(model)
    models = {"local": network, "all bands": load_model(model, labels_of(network.config)[0])}
    models["two-stage"] = load_model("two-stage")
    rows = []
    for label, read in load_meshes(meshes, quick).items():
        mesh = read()
        reference = make_reference(mesh, rays=256 if quick else REFERENCE_RAYS)
        rows.append({"mesh": label, "vertices": len(mesh.vertices), **stages(models, mesh, reference)})
        print(rows[-1], flush=True)
    motions = {}
    for label, (positions, faces) in _frames(animated, quick).items():
        motions[label] = motion(models["local"], positions, faces, 64 if quick else RAYS)
        print(label, motions[label], flush=True)
    sizes = [size(model, resolution) for resolution in (RESOLUTIONS[:1] if quick else RESOLUTIONS)]
    arguments = {"model": Path(model).stem, "rays": 64 if quick else RAYS}
    return saved(output, {**provenance(seed=0, arguments=arguments), "rows": rows, "motions": motions, "sizes": sizes})


if __name__ == "__main__":
    command = parser(__doc__, "model", "meshes", "output", "quick")
    command.add_argument("--animated", type=Path, metavar="FOLDER", help="with animations (.npz)")
    command.add_argument("--alone", type=int, help=argparse.SUPPRESS)
    given = vars(command.parse_args())
    if resolution := given.pop("alone"):
        alone(given["model"], resolution)
    else:
        main(**given)
