"""What one lattice is worth: the constants of `prt.error_target` and `prt.allocation`, measured.

    .venv/bin/python -m experiments.lattice_error.run --output experiments/lattice_error/results.json

On vertices of generated shapes of every kind, two independently shifted lattices are doubled from 8 rays on as a bake
doubles them. KAPPA(N) is their variance, mean (e1 - e2)² / 2, over a quarter of the variance among quarters of one.
MISSED is the rms error of the vertices whose rays all agree, over the floor of their standard error, at 16 to 256
rays, against 16384 rays. VARIANCE is the variance of a lattice, summed over all shapes, against that of 8 rays. One
KAPPA serves all coefficients and shapes; the spread over shapes is printed beside it.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import options, saved
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.provenance import provenance
from gash_jax.prt.allocation import PILOT
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_bars import standard_error_floor
from gash_jax.prt.error_target import State, double_rays, trace_points
from gash_jax.prt.integrands import to_world
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.tracing import active_rows
from gash_jax.prt.visibility import visibility
from gash_jax.shapes.procedural import SHAPE_KINDS, make_shape

BANDS, LEVELS, VERTICES = 3, 9, 300


def measure_shape(mesh: Mesh, seed: int) -> dict[str, list[float]]:
    """Sums over some vertices of one shape: squared differences, variances of quarters, misses, by level."""
    rng = np.random.default_rng(seed)
    normals = np.zeros_like(mesh.normals)
    chosen = rng.permutation(np.flatnonzero(np.any(mesh.normals != 0, axis=1)))[:VERTICES]
    normals[chosen] = mesh.normals[chosen]
    mesh = mesh._replace(normals=normals)  # the others still cast shadows
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces)
    shifts = rng.random((2, len(mesh.vertices), 1, 2), np.float32)
    active, rows = active_rows(mesh, geometry, None, shifts[0])
    truth = bake_transfer(mesh, BANDS, 16384, seed=seed).coefficients[active]
    states = []
    for pair in shifts:
        own = rows._replace(shifts=pair[active])
        quarters, share = trace_points(own, None, 0, PILOT, BANDS, visible)
        states.append((own, State(np.full(len(active), PILOT), share, quarters)))
    sums: dict[str, list[float]] = {"variance": [], "difference": [], "quarters": [], "missed": [], "floor": []}
    for _ in range(LEVELS):
        world = [np.asarray(to_world(state.quarters, own.frames)) for own, state in states]
        agree = [(state.share == 0) | (state.share == 1) for _, state in states]
        both = ~(agree[0] & agree[1])
        difference = world[0].mean(1) - world[1].mean(1)
        sums["variance"].append(float(np.sum(difference**2)))
        difference = difference[both]
        sums["difference"].append(float(np.sum(difference**2) / 2))
        sums["quarters"].append(float(sum(np.sum(w[both].var(1, ddof=1)) for w in world) / 8))
        state = states[0][1]
        error, floor = (world[0].mean(1) - truth), standard_error_floor(BANDS, state.rays, state.share)
        sums["missed"].append(float(np.sum(error[agree[0]] ** 2)))
        sums["floor"].append(float(np.sum(floor[agree[0]] ** 2)))
        for own, state in states:
            double_rays(state, np.ones(len(active), bool), own, BANDS, visible)
    return sums


def main(output: Path | None) -> None:
    sums = [measure_shape(make_shape(1, index, (1500, 4000))[1], index) for index in range(len(SHAPE_KINDS))]
    rows = []
    for level in range(LEVELS):
        part = {key: np.array([shape[key][level] for shape in sums]) for key in sums[0]}
        each = part["difference"] / part["quarters"]
        rays = PILOT << level
        missed = float(np.sqrt(part["missed"].sum() / max(part["floor"].sum(), 1e-30)))
        kappa = float(part["difference"].sum() / part["quarters"].sum())
        variance = float(part["variance"].sum() / sum(shape["variance"][0] for shape in sums))
        rows.append(
            {
                "rays": rays,
                "variance": variance,
                "kappa": kappa,
                "spread": [float(each.min()), float(each.max())],
                "missed": missed,
            }
        )
        spread = f"(shapes {each.min():.2f} to {each.max():.2f})"
        print(f"{rays:5d} rays  VARIANCE {variance:.2e}  KAPPA {kappa:.3f} {spread}  MISSED {missed:.2f}")
    saved(output, provenance(seed=0, shapes=len(sums), rows=rows))


if __name__ == "__main__":
    main(**options(__doc__, "output"))
