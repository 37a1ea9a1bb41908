"""What of `local` can be relied on: does it turn with the mesh, is it exact on convex bodies, does it know its error?

    .venv/bin/python -m experiments.local.trust --meshes FOLDER --output FILE.json

FOLDER holds .ply files: the meshes of `experiments/neural_gash/evaluate.py` that are there are measured, besides
those that the project generates.
"""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.options import options, saved
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.motors import compose, inverse, motor
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph.surfel_graph import normalised, plan_surfels, planned_graph
from gash_jax.graph.surfels import surfel_records
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference
from gash_jax.models.model import Model, load_model
from gash_jax.shapes.primitives import box, icosphere

SCALE, SHIFT = 2.5, (3.0, -1.0, 2.0)
DECILES = 10


def rotation(seed: int) -> np.ndarray:
    """A random rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def _predict(model: Model, mesh: Mesh, positions: np.ndarray, plan: Any) -> np.ndarray:
    """Prediction of a mesh whose surfels, blocks and tables are given."""
    records = surfel_records(plan.tree, positions, plan.faces)
    return np.asarray(model(planned_graph(plan, records, positions, mesh.normals, np.zeros(3), 1.0)))


def equivariance(model: Model, mesh: Mesh, seed: int) -> dict[str, float]:
    """Prediction of the moved mesh against the moved prediction, with the same table and with its own."""
    turn = rotation(seed)
    positions = normalised(mesh)[0]
    plan, _ = plan_surfels(mesh, positions, model.config.neighbours)
    expected = np.asarray(rotate_coefficients(_predict(model, mesh, positions, plan), jnp.asarray(turn, jnp.float32)))
    moved = transform(mesh, turn, np.array(SHIFT), SCALE)
    same = _predict(model, moved, (positions.astype(np.float64) @ turn.T).astype(np.float32), plan)
    rebuilt = model.predict(moved).coefficients
    rms = lambda found: float(np.sqrt(np.mean((found - expected) ** 2)))  # noqa: E731
    return {
        "same_rms": rms(same),
        "same_max": float(np.abs(same - expected).max()),
        "rebuilt_rms": rms(rebuilt),
        "rebuilt_max": float(np.abs(rebuilt - expected).max()),
    }


def relative_motors(mesh: Mesh, seed: int) -> dict[str, float]:
    """Largest change of M_i^-1 M_j over the mesh's edges when the mesh is moved, and when it is turned.

    M as in the paper, from the rotor of the normal alone; of both signs of a motor the nearer counts.
    """
    first, second = mesh.faces[:, 0], mesh.faces[:, 1]
    positions = normalised(mesh)[0]

    @jax.jit
    def relative(positions: Any, normals: Any) -> Any:
        m = motor(positions, normals)
        return compose(inverse(m[first]), m[second])

    turn = rotation(seed)
    base = np.asarray(relative(positions, mesh.normals.astype(np.float32)))
    moved = np.asarray(relative(positions + np.float32(0.5), mesh.normals.astype(np.float32)))
    turned = np.asarray(relative(*((a @ turn.T).astype(np.float32) for a in (positions, mesh.normals))))
    change = lambda a: float(np.minimum(np.abs(a - base).max(1), np.abs(a + base).max(1)).max())  # noqa: E731
    return {"moved": change(moved), "turned": change(turned)}


def convex(model: Model) -> dict[str, float]:
    """Largest difference to the closed form on convex bodies."""
    bodies = {"sphere": icosphere(4), "box": box((1.0, 2.0, 0.5), 12)}
    return {
        name: float(np.abs(model.predict(body).coefficients - unshadowed_transfer(body.normals, 3)).max())
        for name, body in bodies.items()
    }


def calibration(model: Model, meshes: dict[str, Any], rays: int) -> dict[str, Any]:
    """RMS error that was said and that there is: by mesh, and in tenths of all vertices by what was said."""
    rows, said, found = [], [], []
    for name, read in meshes.items():
        mesh = read()
        truth = make_reference(mesh, rays=rays).coefficients
        transfer = model.predict(mesh)
        assert transfer.predicted_error is not None
        usable = np.any(mesh.normals != 0, axis=1)
        square = np.mean((transfer.coefficients - truth)[usable] ** 2, axis=1)
        expected = np.mean(transfer.predicted_error[usable] ** 2, axis=1)
        ranks = [np.argsort(np.argsort(values)) for values in (square, expected)]
        rows.append(
            {
                "mesh": name,
                "said": float(np.sqrt(expected.mean())),
                "found": float(np.sqrt(square.mean())),
                "rank_correlation": float(np.corrcoef(ranks[0], ranks[1])[0, 1]),
            }
        )
        # every mesh counts alike, however many vertices it has
        chosen = np.random.default_rng(0).choice(len(square), 2000)
        said.append(expected[chosen])
        found.append(square[chosen])
    order = np.argsort(np.concatenate(said), kind="stable")
    tenths = [
        [float(np.sqrt(part.mean())) for part in np.array_split(np.concatenate(values)[order], DECILES)]
        for values in (said, found)
    ]
    return {"meshes": rows, "tenths": {"said": tenths[0], "found": tenths[1]}}


def main(model: str, meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    network, readers = load_model(model), load_meshes(meshes, quick)
    rays = 256 if quick else REFERENCE_RAYS
    rows = []
    for label, read in readers.items():
        mesh = read()
        rows.append({"mesh": label, **equivariance(network, mesh, 1), "rotor": relative_motors(mesh, 1)})
        print(rows[-1], flush=True)
    results = {
        **provenance(seed=1, arguments={"model": Path(model).stem, "rays": rays}),
        "equivariance": rows,
        "convex": convex(network),
        "calibration": calibration(network, readers, rays),
    }
    return saved(output, results)


if __name__ == "__main__":
    main(**options(__doc__, "model", "meshes", "output", "quick"))
