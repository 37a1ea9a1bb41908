"""The paper's Tables 3 and 5 rebuilt: what a bake, each stage of the two-stage network and its twin in PyG take.

    .venv-peers/bin/python -m experiments.neural_gash.latency --meshes FOLDER --output FILE.json

Apart from `evaluate.py`, because times are worth something only where nothing else runs. Medians after a warm-up. In an
environment without PyTorch Geometric its column stays empty.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import options, saved
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.provenance import provenance
from gash_jax.measure.timing import timed
from gash_jax.models.ambient import ambient_refinement
from gash_jax.models.model import Model, load_model
from gash_jax.prt.bake import bake_transfer

BAKE_RAYS, LARGE = 256, 50_000


def measure(mesh: Mesh, model: Model) -> dict[str, float | None]:
    """Seconds of every part."""
    repeats = 5 if len(mesh.vertices) < LARGE else 1
    _, bake = timed(lambda: bake_transfer(mesh, rays=BAKE_RAYS), min(repeats, 3))
    graph, building = timed(lambda: model.graph(mesh), repeats)
    _, stage1 = timed(lambda: model.visibility_logits(graph), repeats)
    coefficients, both = timed(lambda: model(graph), repeats)
    _, ambient = timed(lambda: ambient_refinement(mesh, np.asarray(coefficients)), repeats)
    row: dict[str, float | None] = {"bake": bake, "graph": building, "stage1": stage1, "stage2": both - stage1}
    row |= {"ambient": ambient, "pyg": None}
    try:
        from gash_jax.apps.frontier import pyg_two_stage
    except ImportError:
        return row
    network, nodes = pyg_two_stage.PygTwoStage(model.config, model.params), dict(graph.nodes)  # type: ignore[call-overload]
    motor = np.asarray(nodes["motor"])
    twin = lambda: pyg_two_stage.predict(network, motor, graph.senders, graph.receivers)  # noqa: E731
    return row | {"pyg": timed(twin, min(repeats, 3))[1]}


def main(model: str, meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    network, rows = load_model(model), []
    for label, read in load_meshes(meshes, quick).items():
        mesh = read()
        rows.append({"mesh": label, "vertices": len(mesh.vertices), **measure(mesh, network)})
        print(rows[-1], flush=True)
    arguments = {"model": Path(model).stem, "rays": BAKE_RAYS}
    return saved(output, {**provenance(seed=0, arguments=arguments), "rows": rows})


if __name__ == "__main__":
    main(**options(__doc__, "model", "meshes", "output", "quick", model="two-stage"))
