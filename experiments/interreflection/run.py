"""Light that bounces in a sphere with an opening, against its closed form.

    .venv/bin/python -m experiments.interreflection.run --output docs/results/interreflection.json

Inside a sphere every point sees every other with the same form factor, so a bounce brings the mean of the light on the
wall to every vertex alike: for an opening of half-angle a about an axis, f = (1 - cos a)/2 of the sphere, albedo r,

    t^n_k = t^0_k + sin² a / 4 (A_l / pi) Y_k(axis) sum over q = 1 .. n of r^q (1 - f)^(q-1).

The axis is slanted, so that all nine coefficients are there; the rim has 64 segments. The direct transfer of this very
mesh is a boundary integral over the rim (`tests/helpers/transfer_formulas.py`); on the rim of half a sphere, where that
integral runs through the point itself, it is a quarter of the sky. For every opening, albedo and number of
bounces, over all vertices and coefficients:

    light     what constant light of radiance 1 makes of it, mean over vertices and seeds, beside the closed form
    mean      largest error of the mean over the seeds, of a free vertex's t_00
    z         rms error over rms standard error
    covered   share of the errors within the 95 % interval of Student's t at 3 degrees of freedom

Then the relative error and the seconds of whole bakes, by rays and bounces; the figure goes beside the JSON.
"""

from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

from benchmarks.options import options, saved
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.measure.metrics import calibration, relrmse
from gash_jax.measure.provenance import provenance
from gash_jax.measure.timing import timed
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bake_job import draw_shifts
from gash_jax.prt.bounces import Exchange, checked_albedo
from gash_jax.prt.error_bars import replicate_error
from gash_jax.prt.integrands import direct
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.tracing import active_rows
from gash_jax.prt.visibility import ray_query
from tests.helpers.closed_forms import LIFT
from tests.helpers.radiosity import AXIS, cavity_gain, slanted_cavity
from tests.helpers.transfer_formulas import (
    Y00,
    cavity_ao,
    free_transfer,
    groove_transfer,
    polygon_transfer,
    rotation9,
)

DEGREES, ALBEDOS, BOUNCES = (30, 50, 70, 90, 120), (0.2, 0.5, 0.8, 0.95, 1.0), 8
RESOLUTION, RAYS, REPLICATES, SEEDS = 16, 1024, 4, 20


def direct_transfer(mesh: Mesh) -> np.ndarray:
    """Nine coefficients of every vertex of a cavity, from where its rays start: what the rim leaves free."""
    rim = mesh.vertices[-4 * RESOLUTION :].astype(np.float64)
    normals = mesh.normals.astype(np.float64)
    points = mesh.vertices + LIFT * NormalisedMesh(mesh).half_diagonal * normals
    opening = polygon_transfer(points, normals, rim)
    # lifted from the rim of a shallow bowl, a ray starts outside: what it does not see lies behind the opening
    outside = points @ AXIS > (rim @ AXIS).max()
    found = np.where(outside[:, None], free_transfer(normals) - opening, opening)
    if np.abs(rim @ AXIS).max() < 1e-6:  # half a sphere: rays from the rim start in the plane of the opening
        found[-len(rim) :] = [quarter_sky(normal) for normal in normals[-len(rim) :]]
    return found


def quarter_sky(normal: np.ndarray) -> np.ndarray:
    """Nine coefficients of a vertex that sees what is above its horizon and on the side of `AXIS`, at right angles."""
    frame = np.stack([AXIS, np.cross(normal, AXIS), normal], axis=1)
    return rotation9(frame) @ groove_transfer(np.pi / 2)


def exchange(mesh: Mesh, seed: int) -> Exchange:
    """The rays of one bake, for all albedos and bounces."""
    geometry = trace_geometry(mesh)
    shifts = draw_shifts(seed, len(mesh.vertices), REPLICATES, 0, len(mesh.vertices))
    active, rows = active_rows(mesh, geometry, None, shifts)
    query = ray_query(geometry.vertices, geometry.faces, "closest")
    return Exchange(rows, direct(3), RAYS // REPLICATES, query, active=active, surface=mesh)


def cavity(degrees: float, seeds: int) -> list[dict]:
    """Rows of one opening: every albedo and every number of bounces."""
    half = np.radians(degrees)
    mesh = slanted_cavity(half, RESOLUTION)
    exact = direct_transfer(mesh)
    errors: dict[tuple[float, int], list[np.ndarray]] = {}
    claimed: dict[tuple[float, int], list[np.ndarray]] = {}
    for seed in range(seeds):
        rays = exchange(mesh, seed)
        for albedo in ALBEDOS:
            found = rays.first
            for bounce in range(BOUNCES + 1):
                found = found if bounce == 0 else rays.bounce(found, checked_albedo(albedo, len(mesh.vertices)))
                mean = found[..., 0].mean(1)
                error = mean - exact - cavity_gain(half, albedo, bounce)
                errors.setdefault((albedo, bounce), []).append(error)
                claimed.setdefault((albedo, bounce), []).append(replicate_error(found[..., 0], mean, RAYS, rays.share))
    rows = []
    for (albedo, bounce), found in errors.items():
        score, covered = calibration(np.stack(found), np.stack(claimed[albedo, bounce]))
        average, closed_form = np.mean(found, axis=0), cavity_ao(half) + cavity_gain(half, albedo, bounce, 1)[0] / Y00
        row = {"degrees": degrees, "albedo": albedo, "bounces": bounce, "closed_form": float(closed_form)}
        row["light"] = float(np.mean(average[:, 0] + exact[:, 0]) / Y00 + closed_form - cavity_ao(half))
        rows.append({**row, "mean": float(np.abs(average).max() / Y00), "z": score, "covered": covered})
    return rows


def error_and_seconds(repeats: int) -> list[dict]:
    """Relative error and seconds of whole bakes of a cavity of 60 degrees, albedo .8."""
    half = np.radians(60)
    mesh = slanted_cavity(half, RESOLUTION)
    exact, rows = direct_transfer(mesh), []
    for bounce in (0, 1, 2, 4, 8):
        for rays in (16, 64, 256, 1024):
            found, seconds = timed(lambda r=rays, n=bounce: bake_transfer(mesh, rays=r, bounces=n, albedo=0.8), repeats)
            error = relrmse(found.coefficients, exact + cavity_gain(half, 0.8, bounce))
            rows.append({"bounces": bounce, "rays": rays, "seconds": seconds, "relrmse": error})
    return rows


def draw(rows: list[dict], path: Path) -> None:
    """Error against seconds, one line for each number of bounces."""
    figure, axis = plt.subplots(figsize=(5, 3.8))
    for bounce in sorted({row["bounces"] for row in rows}):
        own = [row for row in rows if row["bounces"] == bounce]
        axis.loglog(
            [r["seconds"] for r in own], [r["relrmse"] for r in own], marker="o", ms=4, label=f"{bounce} bounces"
        )
    axis.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.xaxis.set_major_formatter(FormatStrFormatter("%g"))
    axis.xaxis.set_minor_formatter(NullFormatter())
    axis.set_xlabel("seconds, 1025 vertices, 16 to 1024 rays")
    axis.set_ylabel("relative RMS error")
    axis.grid(True, which="both", lw=0.3, alpha=0.6)
    axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)


def main(output: Path | None, quick: bool) -> dict:
    rows: list[dict] = []
    for degrees in DEGREES[2:3] if quick else DEGREES:
        rows += cavity(degrees, 2 if quick else SEEDS)
        own = [row for row in rows if row["degrees"] == degrees]
        worst = {name: (min(r[name] for r in own), max(r[name] for r in own)) for name in ("mean", "z", "covered")}
        print(degrees, worst, flush=True)
    timings = error_and_seconds(1 if quick else 5)
    sizes = {"rays": RAYS, "seeds": 2 if quick else SEEDS, "vertices": 1 + 4 * RESOLUTION**2, "rim": 4 * RESOLUTION}
    if output:
        draw(timings, output.with_suffix(".png"))
    return saved(output, provenance(seed=0, **sizes, rows=rows, timings=timings))


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
