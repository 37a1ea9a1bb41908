"""`gash compare`: every measure of a transfer against a reference bake of the same mesh."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.apps.options import PATH, Command, json_option, quiet_option
from gash_jax.apps.printing import number
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.same_mesh import check_same_mesh
from gash_jax.measure import metrics
from gash_jax.prt.transfer import load_transfer

NAMES = ("relrmse", "skill", "mse", "shadow_mse", "equivalent_rays", "vertices", "bands", "reference_rays")


@click.command(cls=Command, epilog="gash compare predicted.npz reference.npz --json")
@click.argument("transfer", type=PATH)
@click.argument("reference", type=PATH)
@json_option
@quiet_option
def compare(transfer: Path, reference: Path, as_json: bool, quiet: bool) -> None:
    """Measure TRANSFER against REFERENCE (same mesh, same bands): relrmse, skill, equivalent rays and more."""
    candidate, believed = load_transfer(transfer), load_transfer(reference)
    check_same_mesh(candidate, believed)
    estimate, truth = candidate.coefficients, believed.coefficients
    per_mse, per_std = metrics.coefficient_errors(estimate, truth)
    rays = believed.metadata.get("parameters", {}).get("rays")
    if rays is None:
        raise ValueError(f"{reference} is not a bake: compare with one, such as gash bake MESH --rays 4096")
    with progress_bar("baking the yardstick", quiet) as update:
        curve = metrics.plain_bake_curve(believed.mesh, truth, rays, progress=update)
    error = metrics.mse(estimate, truth)
    values = {
        "relrmse": metrics.relrmse(estimate, truth),
        "skill": metrics.skill(estimate, truth, believed.normals),
        "mse": error,
        "mse_per_coefficient": per_mse.tolist(),
        "std": per_std.tolist(),
        "shadow_mse": metrics.shadow_mse(estimate, truth),
        "equivalent_rays": metrics.equivalent_rays(error, curve) if np.any(truth) else "no transfer",
        "vertices": len(truth),
        "bands": believed.bands,
        "reference_rays": rays,
    }
    click.echo(json.dumps(values) if as_json else _text(values))


def _text(values: dict[str, Any]) -> str:
    """The measures for people."""
    lines = [f"{name:16s} {number(values[name])}" for name in NAMES] + ["per coefficient  mse std"]
    pairs = zip(values["mse_per_coefficient"], values["std"], strict=True)
    return "\n".join([*lines, *(f"  {index:3d}            {m:.3e} {s:.3e}" for index, (m, s) in enumerate(pairs))])
