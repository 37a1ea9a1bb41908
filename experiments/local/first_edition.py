"""What the first edition of `local` did, to be held against what it does now.

    .venv/bin/python -m experiments.local.first_edition --meshes FOLDER --output FILE.json

Its published figures come out of git, from the results of its last commit; what nobody measured then, jumps and errors
relative to what arrives, is measured of what its own source predicts, unpacked into a temporary folder. That needs the
whole history.
"""

import argparse
import io
import json
import os
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import parser, saved
from experiments.local.measures import jumps, relative_error
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference
from gash_jax.models.model import load_model

# the last commit in which vertices shared lists of surfels
COMMIT = "7921029"
ROOT = Path(__file__).parents[2]
SCORES = ("skill", "relrmse", "equivalent_rays")


def from_git(*command: str) -> bytes:
    """What git says of the repository."""
    return subprocess.run(["git", *command], cwd=ROOT, stdout=subprocess.PIPE, check=True).stdout


def published() -> dict[str, Any]:
    """Its figures, as they stood in the results: by mesh, and the flicker of meshes that deform."""
    results = {
        name: json.loads(from_git("show", f"{COMMIT}:docs/results/{name}.json"))
        for name in ("neural_gash", "local_trust", "local_speed")
    }
    meshes: dict[str, Any] = {}
    for row in results["neural_gash"]["rows"]:
        meshes[row["mesh"]] = {key: row["methods"]["local"][key] for key in SCORES}
    for row in results["local_trust"]["calibration"]["meshes"]:
        meshes[row["mesh"]] |= {"said": row["said"], "found": row["found"]}
    for row in results["local_speed"]["rows"]:
        meshes[row["mesh"]]["predict"] = row["predict"]
    motions = {name: row["plan renewed"] for name, row in results["local_speed"]["motions"].items()}
    origins = {name: {key: result[key] for key in ("machine", "commit")} for name, result in results.items()}
    return {"meshes": meshes, "motions": motions, "origins": origins}


def alone(meshes: Path | None, quick: bool, folder: Path) -> None:
    """Write what the edition that is imported predicts, mesh by mesh."""
    model = load_model("local")
    for label, read in load_meshes(meshes, quick).items():
        np.save(folder / f"{label}.npy", model.predict(read()).coefficients)


def predictions(meshes: Path | None, quick: bool) -> dict[str, np.ndarray]:
    """What `alone` predicts when it runs on the source of the first edition."""
    with tempfile.TemporaryDirectory() as folder:
        with tarfile.open(fileobj=io.BytesIO(from_git("archive", COMMIT, "src"))) as archive:
            archive.extractall(folder, filter="data")
        command = [sys.executable, "-m", "experiments.local.first_edition", "--alone", folder]
        command += ["--meshes", str(meshes)] if meshes else []
        command += ["--quick"] if quick else []
        subprocess.run(command, cwd=ROOT, env=os.environ | {"PYTHONPATH": str(Path(folder) / "src")}, check=True)
        return {path.stem: np.load(path) for path in sorted(Path(folder).glob("*.npy"))}


def main(meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    known, rays = published(), 64 if quick else REFERENCE_RAYS
    readers = load_meshes(meshes, quick)
    for label, estimate in predictions(meshes, quick).items():
        mesh = readers[label]()
        truth = make_reference(mesh, rays=rays).coefficients
        found = {"jumps": jumps(mesh, estimate, truth), "relative": relative_error(mesh, estimate, truth)}
        known["meshes"].setdefault(label, {}).update(found)
        print(label, found, flush=True)
    return saved(output, {**provenance(seed=0, arguments={"commit": COMMIT, "rays": rays}), **known})


if __name__ == "__main__":
    command = parser(__doc__, "meshes", "output", "quick")
    command.add_argument("--alone", type=Path, help=argparse.SUPPRESS)
    given = vars(command.parse_args())
    if folder := given.pop("alone"):
        alone(given["meshes"], given["quick"], folder)
    else:
        main(**given)
