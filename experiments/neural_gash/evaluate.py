"""Every trained variant on meshes it has never seen, with the paper's tables rebuilt.

    .venv/bin/python -m experiments.neural_gash.evaluate --meshes FOLDER --output FILE.json [--only local]

FOLDER holds .ply files; those named in TEST that are there are measured, besides two that the project generates.
Beside the networks stand maps that are linear in 25 traced visibilities (`linear.py`), and of networks that are told
visibilities the skill by where they come from (`stages.py`).
Times are medians of five after a warm-up, graphs built before unless said; only what the tables show in full is timed
(`variants.Run.shown`). What the stages take: `latency.py`. With --only the named models are measured, runs or what
ships, and FILE.json keeps what it says of the others.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import parser, saved
from experiments.neural_gash.linear import LinearMap, corpus, fit_all, predict
from experiments.neural_gash.stages import stage_two_skills
from experiments.neural_gash.variants import RUNS
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.methods import evaluate_mesh, visibility_score
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, Reference, make_reference, score
from gash_jax.measure.timing import timed
from gash_jax.models.ambient import ambient_refinement
from gash_jax.models.model import Model, load_model
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.procedural import make_shape

TEST = (
    *("alligator", "beetle", "brain_pial_right", "busted", "face_open", "fandisk", "fixed_top", "heart_coarse"),
    *(
        "heart_lowpoly",
        "igea",
        "igea_30k",
        "max_planck_decimated",
        "pbrt_prt_teapot",
        "plate_holes",
        "quadknot",
        "soup",
    ),
    *("spot", "stanford_bunny", "suture_phantom_simple", "suzanne", "teapot", "truck"),
)
GENERATED = {"generated 1": (11, 4), "generated 2": (11, 9)}  # seeds that no corpus has
PLAIN_RAYS = (4, 8, 16, 256)


def load_meshes(folder: Path | None, quick: bool) -> dict[str, Callable[[], Mesh]]:
    """Names and readers of the meshes to be measured."""
    size = (300, 400) if quick else (8000, 10000)
    found: dict[str, Callable[[], Mesh]] = {
        name: lambda s=seed: make_shape(*s, vertices=size)[1] for name, seed in GENERATED.items()
    }
    for name in TEST:
        path = folder / f"{name}.ply" if folder else None
        if path and path.exists():
            found[name] = lambda p=path: load_mesh(p)
    return found


def load_models(runs: Path) -> dict[str, Model]:
    """The finished runs, and the network that ships."""
    files = {name: runs / name / "model.npz" for name in RUNS}
    return {name: load_model(file) for name, file in files.items() if file.exists()} | {"local": load_model("local")}


def is_shown(name: str) -> bool:
    """Whether the tables show all of a model: what ships, and runs in their reading."""
    return name not in RUNS or RUNS[name].shown


def measure_model(name: str, model: Model, mesh: Mesh, reference: Reference) -> dict[str, Any]:
    """Scores of a model on one mesh, by stages where it has some; and times, if the tables show them."""
    skills = stage_two_skills(model, mesh, reference)
    if is_shown(name):
        return {**evaluate_mesh(model, mesh, reference), **skills}
    seen = visibility_score(model, mesh) if model.predicts_visibility else {}
    return {**score(model.predict(mesh).coefficients, mesh, reference), **seen, **skills}


def measure(mesh: Mesh, models: dict[str, Model], linear: list[LinearMap], reference: Reference) -> dict[str, Any]:
    """Scores and times of every method on one mesh; times in microseconds per vertex."""
    per_vertex = 1e6 / len(mesh.vertices)
    rows: dict[str, Any] = {}
    formula = np.asarray(unshadowed_transfer(mesh.normals, 3))
    rows["closed form"] = score(formula, mesh, reference)
    darkened, seconds = timed(lambda: ambient_refinement(mesh, formula))
    rows["closed form + AO"] = {**score(darkened, mesh, reference), "network_us": seconds * per_vertex}
    for rays in PLAIN_RAYS:
        transfer, seconds = timed(lambda n=rays: bake_transfer(mesh, rays=n, replicates=1), 3)
        rows[f"plain bake, {rays} rays"] = {
            **score(transfer.coefficients, mesh, reference),
            "network_us": seconds * per_vertex,
        }
    for fitted in linear:
        found, seconds = timed(lambda m=fitted: predict(m, mesh), 3)
        rows[fitted.name] = {**score(found, mesh, reference), "network_us": seconds * per_vertex}
    for name, model in models.items():
        rows[name] = measure_model(name, model, mesh, reference)
        if name.startswith("two-stage") and is_shown(name):
            predicted = model.predict(mesh).coefficients
            refined, seconds = timed(lambda p=predicted: ambient_refinement(mesh, p))
            rows[f"{name} + AO"] = {**score(refined, mesh, reference), "ambient_us": seconds * per_vertex}
    return rows


def main(runs: Path, meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    models, linear, rows = load_models(runs), fit_all(corpus(quick)[0]), []
    rays = 256 if quick else REFERENCE_RAYS
    for name, read in load_meshes(meshes, quick).items():
        mesh = read()
        reference = make_reference(mesh, rays=rays)
        methods = measure(mesh, models, linear, reference)
        rows.append({"mesh": name, "vertices": len(mesh.vertices), "methods": methods})
        skills = {n: m["skill"] for n, m in methods.items() if n in models}
        print(name, len(mesh.vertices), {n: round(s, 2) if isinstance(s, float) else s for n, s in skills.items()})
    runs_of = {name: model.metadata.get("run", {}) for name, model in models.items()}
    return saved(output, {**provenance(seed=0, arguments={"rays": rays}), "runs": runs_of, "rows": rows})


def renew(names: list[str], runs: Path, meshes: Path | None, output: Path, quick: bool) -> dict[str, Any]:
    """Measure some models again on the meshes of `output`, and put them in there in place of what that says of them."""
    results = json.loads(output.read_text())
    files = {name: runs / name / "model.npz" for name in names}
    models = {name: load_model(file if file.exists() else name) for name, file in files.items()}
    readers = load_meshes(meshes, quick)
    for row in results["rows"]:
        mesh = readers[row["mesh"]]()
        reference = make_reference(mesh, rays=results["arguments"]["rays"])
        found = {name: measure_model(name, model, mesh, reference) for name, model in models.items()}
        row["methods"] |= found
        print(row["mesh"], {name: scores["skill"] for name, scores in found.items()}, flush=True)
    results["runs"] |= {name: model.metadata.get("run", {}) for name, model in models.items()}
    results.setdefault("renewed", {}).update(dict.fromkeys(names, provenance(seed=0, arguments={"only": names})))
    return saved(output, results)


if __name__ == "__main__":
    command = parser(__doc__, "runs", "meshes", "output", "quick")
    command.add_argument("--only", nargs="+", metavar="MODEL", help="renew these models' part of --output")
    given = vars(command.parse_args())
    if only := given.pop("only"):
        renew(only, **given)
    else:
        main(**given)
