"""What the networks of the three sweeps do on meshes that none was trained on; stopped and started at will.

    .venv/bin/gash sweep experiments/cga/published.toml -o runs/cga
    .venv/bin/gash sweep experiments/cga/ours.toml -o runs/cga
    .venv/bin/gash sweep experiments/cga/versor.toml -o runs/cga
    .venv/bin/python -m experiments.cga.unseen --runs runs/cga --meshes FOLDER --output experiments/cga/results.json

FOLDER holds .ply files: the meshes of `experiments/neural_gash/evaluate.py` that are there, without the one that is
there twice in different resolution.
"""

import json
from pathlib import Path
from typing import Any

from benchmarks.options import options
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.apps.progress import progress_bar
from gash_jax.files.atomic import write_json
from gash_jax.measure.metrics import skill
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference
from gash_jax.models.model import load_model
from gash_jax.train.sweep import run_folder

TWICE = "igea"
# of the line that a sweep wrote
KEPT = ("id", "form", "encoding", "seed", "parameters", "steps", "skill", "commit")


def main(runs: Path, meshes: Path | None, output: Path, quick: bool) -> dict[str, Any]:
    loaded = {name: read() for name, read in load_meshes(meshes, quick).items() if name != TWICE}
    truth = {name: make_reference(mesh, rays=256 if quick else REFERENCE_RAYS) for name, mesh in loaded.items()}
    lines = [json.loads(line) for line in (runs / "results.jsonl").read_text().splitlines()]
    done = {row["id"]: row for row in json.loads(output.read_text())["rows"]} if output.exists() else {}
    results = {**provenance(arguments={"rays": next(iter(truth.values())).rays}), "rows": []}
    with progress_bar(f"{len(lines)} runs") as update:
        for step, line in enumerate(lines):
            row = done.get(line["id"])
            if row is None:
                model = load_model(run_folder(runs / "runs", line["id"]) / "model.npz")
                found = {name: model.predict(mesh).coefficients for name, mesh in loaded.items()}
                skills = {name: skill(c, truth[name].coefficients, loaded[name].normals) for name, c in found.items()}
                row = {**{key: line[key] for key in KEPT}, "meshes": skills}
            results["rows"].append(row)
            write_json(output, results)
            update(step + 1, len(lines))
    return results


if __name__ == "__main__":
    results = Path(__file__).parent / "results.json"
    main(**options(__doc__, "runs", "meshes", "output", "quick", runs="runs/cga", output=results))
