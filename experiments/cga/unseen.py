"""What the networks of sweep.toml do on meshes that none was trained on; stopped and started at will.

    .venv/bin/gash sweep experiments/cga/sweep.toml -o runs/cga
    .venv/bin/python experiments/cga/unseen.py --runs runs/cga --meshes FOLDER --output experiments/cga/results.json

FOLDER holds .ply files: the meshes of `neural_gash/evaluate.py` that are there, without the one that is there twice in
different resolution.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1] / "neural_gash"))

from evaluate import load_meshes

from gash_jax.apps.progress import progress_bar
from gash_jax.files.atomic import write_json
from gash_jax.measure.metrics import skill
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference
from gash_jax.models.model import load_model

TWICE = "igea"
# of the line that the sweep wrote
KEPT = ("id", "form", "encoding", "seed", "parameters", "steps", "skill", "commit")


def main(runs: Path, folder: Path | None, output: Path, quick: bool) -> dict[str, Any]:
    meshes = {name: read() for name, read in load_meshes(folder, quick).items() if name != TWICE}
    truth = {name: make_reference(mesh, rays=256 if quick else REFERENCE_RAYS) for name, mesh in meshes.items()}
    lines = [json.loads(line) for line in (runs / "results.jsonl").read_text().splitlines()]
    done = {row["id"]: row for row in json.loads(output.read_text())["rows"]} if output.exists() else {}
    results = {**provenance(arguments={"rays": next(iter(truth.values())).rays}), "rows": []}
    with progress_bar(f"{len(lines)} runs") as update:
        for step, line in enumerate(lines):
            row = done.get(line["id"])
            if row is None:
                model = load_model(runs / "runs" / line["id"] / "model.npz")
                found = {name: model.predict(mesh).coefficients for name, mesh in meshes.items()}
                skills = {name: skill(c, truth[name].coefficients, meshes[name].normals) for name, c in found.items()}
                row = {**{key: line[key] for key in KEPT}, "meshes": skills}
            results["rows"].append(row)
            write_json(output, results)
            update(step + 1, len(lines))
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=Path, default=Path("runs/cga"))
    parser.add_argument("--meshes", type=Path)
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "results.json")
    parser.add_argument("--quick", action="store_true", help="small generated meshes, few rays: to see that it runs")
    options = parser.parse_args()
    main(options.runs, options.meshes, options.output, options.quick)
