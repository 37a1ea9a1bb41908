"""How far `local` reaches: into what is nearly dark, into kinds of shapes, to higher bands, and to light that bounces.

    .venv/bin/python -m experiments.local.reach --meshes FOLDER --output FILE.json

FOLDER holds .ply files: the meshes of `experiments/neural_gash/evaluate.py` that are there are measured, besides
generated ones, and SHAPES of every kind that networks are trained on, from a seed that no training has.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import options, saved
from experiments.local.measures import relative_error
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure import metrics
from gash_jax.measure.provenance import provenance
from gash_jax.measure.reference import REFERENCE_RAYS, REFERENCE_SEED
from gash_jax.models.families import labels_of
from gash_jax.models.model import Model, load_model
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.procedural import ALL_KINDS, make_shape

SHAPE_SEED, SHAPES, SHAPE_RAYS = 2027, 2, 1024
SHAPE_VERTICES = (200, 10000)
BASE, ALBEDO, FEW_RAYS = 3, 0.5, 16
BOUNCE_RAYS = 1024


def scores(mesh: Mesh, estimate: np.ndarray, truth: np.ndarray) -> dict[str, Any]:
    """Error relative to what arrives, skill and relrmse."""
    return {
        "relative": relative_error(mesh, estimate, truth),
        "skill": metrics.skill(estimate, truth, mesh.normals),
        "relrmse": metrics.relrmse(estimate, truth),
    }


def by_band(mesh: Mesh, estimate: np.ndarray, truth: np.ndarray) -> list[dict[str, Any]]:
    """Of every number of bands the relrmse of all of them, and the skill of the last alone, where it has a shadow."""
    rows = []
    for bands in range(1, round(truth.shape[1] ** 0.5) + 1):
        last = slice((bands - 1) ** 2, bands**2)
        formula = np.asarray(unshadowed_transfer(mesh.normals, bands))
        floor = metrics.mse(formula[:, last], truth[:, last])
        alone = 1 - metrics.mse(estimate[:, last], truth[:, last]) / floor if floor > metrics.NO_OCCLUSION else None
        relrmse = metrics.relrmse(estimate[:, : bands**2], truth[:, : bands**2])
        rows.append({"bands": bands, "relrmse": relrmse, "skill_of_last": alone})
    return rows


def bounced(model: Model, mesh: Mesh, rays: int) -> list[dict[str, Any]]:
    """relrmse with bounces, and what it would be had the prediction none."""
    direct, rows = model.predict(mesh).coefficients, []
    for bounces in range(1, labels_of(model.config)[1] + 1):
        light: dict[str, Any] = {"bounces": bounces, "albedo": ALBEDO}
        truth = bake_transfer(mesh, model.config.bands, rays, seed=REFERENCE_SEED, **light).coefficients
        found = model.predict(mesh, **light).coefficients
        left_out = metrics.relrmse(direct, truth)
        rows.append({"bounces": bounces, "relrmse": metrics.relrmse(found, truth), "left_out": left_out})
    return rows


def measure(name: str, mesh: Mesh, rays: int, bounce_rays: int) -> dict[str, Any]:
    """Everything of one mesh."""
    base = load_model(name, BASE)
    model = load_model(name, labels_of(base.config)[0])
    truth = bake_transfer(mesh, model.config.bands, rays, seed=REFERENCE_SEED).coefficients
    found = model.predict(mesh).coefficients
    k = BASE**2
    few = bake_transfer(mesh, BASE, FEW_RAYS, replicates=1).coefficients
    formula = np.asarray(unshadowed_transfer(mesh.normals, BASE))
    return {
        "vertices": len(mesh.vertices),
        **scores(mesh, found[:, :k], truth[:, :k]),
        "others": {
            "closed form": relative_error(mesh, formula, truth[:, :k]),
            f"plain bake, {FEW_RAYS} rays": relative_error(mesh, few, truth[:, :k]),
        },
        "bands": by_band(mesh, found, truth),
        "bounces": bounced(base, mesh, bounce_rays),
    }


def main(model: str, meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    rows, shapes = [], []
    rays, shape_rays, bounce_rays = (64, 64, 64) if quick else (REFERENCE_RAYS, SHAPE_RAYS, BOUNCE_RAYS)
    for label, read in load_meshes(meshes, quick).items():
        rows.append({"mesh": label, **measure(model, read(), rays, bounce_rays)})
        print(rows[-1], flush=True)
    size = (200, 300) if quick else SHAPE_VERTICES
    # kinds come in rounds that hold each once
    for index in range(4 if quick else SHAPES * len(ALL_KINDS)):
        kind, mesh = make_shape(SHAPE_SEED, index, size, "all")
        shapes.append({"kind": kind, **measure(model, mesh, shape_rays, min(bounce_rays, shape_rays))})
        print(shapes[-1], flush=True)
    arguments = {"model": Path(model).stem, "rays": rays, "shape_rays": shape_rays, "bounce_rays": bounce_rays}
    arguments |= {"albedo": ALBEDO, "few_rays": FEW_RAYS}
    return saved(output, {**provenance(seed=SHAPE_SEED, arguments=arguments), "rows": rows, "shapes": shapes})


if __name__ == "__main__":
    main(**options(__doc__, "model", "meshes", "output", "quick"))
