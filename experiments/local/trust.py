"""What of `local` can be relied on: does it turn with the mesh, is it exact where nothing is hidden, is it continuous,
does it know its error?

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
from experiments.local.measures import jumps
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.motors import compose, inverse, motor
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph.repeated_vertices import first_of_repeated
from gash_jax.graph.surfel_graph import normalised, plan_surfels, planned_graph
from gash_jax.graph.surfels import surfel_records
from gash_jax.measure.metrics import partly_hidden
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, Reference, make_reference
from gash_jax.models.model import Model, load_model
from gash_jax.prt.transfer import Transfer
from gash_jax.shapes.primitives import box, icosphere
from gash_jax.train.error_bound import rms_by_vertex

SCALE, SHIFT = 2.5, (3.0, -1.0, 2.0)
TENTHS, DRAWS = 10, 2000
# largest difference to the closed form of a reference that no ray says is hidden
UNHIDDEN = 1e-6


def rotation(seed: int) -> np.ndarray:
    """A random rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def _predict(model: Model, mesh: Mesh, positions: np.ndarray, plan: Any) -> np.ndarray:
    """Prediction of a mesh whose tree of surfels and lists are given."""
    records = surfel_records(plan.tree, positions, plan.faces)
    return np.asarray(model(planned_graph(plan, records, positions, mesh.normals, np.zeros(3), 1.0)))


def equivariance(model: Model, mesh: Mesh, seed: int) -> dict[str, float]:
    """Prediction of the moved mesh against the moved prediction, with the same lists and with its own."""
    turn = rotation(seed)
    positions = normalised(mesh)[0]
    plan, _ = plan_surfels(mesh, positions)
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


def convex(model: Model) -> dict[str, dict[str, float]]:
    """On convex bodies, where nothing is hidden: the largest difference to the closed form, and expected error."""
    bodies = {"sphere": icosphere(4), "box": box((1.0, 2.0, 0.5), 12)}
    found = {}
    for name, body in bodies.items():
        transfer = model.predict(body)
        formula = np.asarray(unshadowed_transfer(body.normals, model.config.bands))
        assert transfer.predicted_error is not None
        found[name] = {
            "difference": float(np.abs(transfer.coefficients - formula).max()),
            "expected": float(transfer.predicted_error.max()),
        }
    return found


def cut_apart(mesh: Mesh) -> Mesh:
    """The mesh with every other face given vertices of its own, as seams of textures do: places and normals stay."""
    faces = mesh.faces.copy()
    faces[::2] += len(mesh.vertices)
    used, renumbered = np.unique(faces, return_inverse=True)
    vertices, normals = (np.concatenate([array, array])[used] for array in mesh[:2])
    return Mesh(vertices, normals, renumbered.reshape(faces.shape).astype(np.int32))


def continuity(model: Model, mesh: Mesh, transfer: Transfer, reference: Reference) -> dict[str, Any]:
    """Jumps at the borders of blocks, and the largest difference between copies of a vertex once the mesh is cut."""
    apart = cut_apart(mesh)
    first = first_of_repeated(normalised(apart)[0], apart.normals)
    found = model.predict(apart).coefficients
    seam = {"copies": int(np.sum(first != np.arange(len(first)))), "seam": float(np.abs(found - found[first]).max())}
    return {**jumps(mesh, transfer.coefficients, reference.coefficients), **seam}


def errors(mesh: Mesh, transfer: Transfer, reference: Reference) -> dict[str, Any]:
    """Of every vertex with a normal: RMS error expected and found, and whether it is partly hidden, or not at all.

    The noise of the reference is taken off what is found, as far as it is known.
    """
    assert transfer.predicted_error is not None
    truth = reference.coefficients
    usable = np.any(mesh.normals != 0, axis=1)
    formula = np.asarray(unshadowed_transfer(mesh.normals, round(truth.shape[1] ** 0.5)))
    noise = np.mean(reference.standard_error**2, axis=1)
    square = np.maximum(rms_by_vertex(transfer.coefficients - truth) ** 2 - noise, 0)
    of_all = {
        "said": rms_by_vertex(transfer.predicted_error),
        "found": np.sqrt(square),
        "partly": partly_hidden(truth),
        "unhidden": np.abs(truth - formula).max(axis=1) < UNHIDDEN,
    }
    return {name: values[usable] for name, values in of_all.items()}


def _rank_correlation(a: np.ndarray, b: np.ndarray) -> float | None:
    if len(a) < 2:
        return None
    ranks = [np.argsort(np.argsort(values)) for values in (a, b)]
    return float(np.corrcoef(ranks[0], ranks[1])[0, 1])


def calibration(by_mesh: dict[str, dict[str, Any]], bound: float | None) -> dict[str, Any]:
    """Error that was said and that there is: by mesh, and in tenths of the partly hidden vertices by what was said.

    In the tenths, and in the share inside the bound of all meshes together, every mesh counts alike.
    """
    rows, drawn = [], []
    for name, of in by_mesh.items():
        partly, unhidden = of["partly"], of["said"][of["unhidden"]]
        said, found = of["said"][partly], of["found"][partly]
        inside = None if bound is None or not len(said) else float(np.mean(found <= bound * said))
        rows.append(
            {
                "mesh": name,
                **{key: float(np.sqrt(np.mean(of[key] ** 2))) for key in ("said", "found")},
                "partly_hidden": float(np.mean(partly)),
                "rank_correlation": _rank_correlation(said, found),
                "inside": inside,
                "most_where_unhidden": float(unhidden.max()) if len(unhidden) else None,
            }
        )
        if len(said):
            chosen = np.random.default_rng(0).choice(len(said), DRAWS)
            drawn.append(np.stack([said[chosen], found[chosen]]))
    said, found = np.concatenate(drawn, axis=1)
    order = np.argsort(said, kind="stable")
    rms = lambda values: [float(np.sqrt(np.mean(part**2))) for part in np.array_split(values[order], TENTHS)]  # noqa: E731
    return {
        "bound": bound,
        "inside": None if bound is None else float(np.mean(found <= bound * said)),
        "meshes": rows,
        "tenths": {"said": rms(said), "found": rms(found)},
    }


def main(model: str, meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    network, readers = load_model(model), load_meshes(meshes, quick)
    rays = 256 if quick else REFERENCE_RAYS
    turned, continuous, by_mesh = [], [], {}
    for label, read in readers.items():
        mesh = read()
        reference, transfer = make_reference(mesh, network.config.bands, rays), network.predict(mesh)
        turned.append({"mesh": label, **equivariance(network, mesh, 1), "rotor": relative_motors(mesh, 1)})
        continuous.append({"mesh": label, **continuity(network, mesh, transfer, reference)})
        by_mesh[label] = errors(mesh, transfer, reference)
        print(turned[-1], continuous[-1], flush=True)
    results = {
        **provenance(seed=1, arguments={"model": Path(model).stem, "rays": rays}),
        "equivariance": turned,
        "convex": convex(network),
        "continuity": continuous,
        "calibration": calibration(by_mesh, network.metadata.get("bound")),
    }
    return saved(output, results)


if __name__ == "__main__":
    main(**options(__doc__, "model", "meshes", "output", "quick"))
