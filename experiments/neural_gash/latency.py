"""The paper's Tables 3 and 5 rebuilt: what a bake, each stage of the two-stage network and its twin in PyG take.

    .venv-peers/bin/python experiments/neural_gash/latency.py --meshes FOLDER --output FILE.json

Apart from `evaluate.py`, because times are worth something only where nothing else runs. Medians after a warm-up. In an
environment without PyTorch Geometric its column stays empty.
"""

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from evaluate import load_meshes

from gash_jax.files.atomic import write_json
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
        import pyg_two_stage  # pyright: ignore[reportMissingImports]
    except ImportError:
        return row
    network, nodes = pyg_two_stage.PygTwoStage(model.config, model.params), dict(graph.nodes)  # type: ignore[call-overload]
    motor = np.asarray(nodes["motor"])
    twin = lambda: pyg_two_stage.predict(network, motor, graph.senders, graph.receivers)  # noqa: E731
    return row | {"pyg": timed(twin, min(repeats, 3))[1]}


def main(name: str, folder: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    model, rows = load_model(name), []
    for label, read in load_meshes(folder, quick).items():
        mesh = read()
        rows.append({"mesh": label, "vertices": len(mesh.vertices), **measure(mesh, model)})
        print(rows[-1], flush=True)
    results = {**provenance(seed=0, arguments={"model": Path(name).stem, "rays": BAKE_RAYS}), "rows": rows}
    if output:
        write_json(output, results)
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="two-stage", help="a two-stage model: a shipped name, or a file")
    parser.add_argument("--meshes", type=Path)
    parser.add_argument("--output", type=Path)
    parser.add_argument("--quick", action="store_true", help="small generated meshes: to see that it runs")
    options = parser.parse_args()
    main(options.model, options.meshes, options.output, options.quick)
