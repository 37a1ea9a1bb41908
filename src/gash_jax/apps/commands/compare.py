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
from gash_jax.prt.error_target import LOWEST_ERROR
from gash_jax.prt.transfer import Transfer, load_transfer

NAMES = ("relrmse", "skill", "mse", "shadow_mse", "equivalent_rays", "vertices", "bands", "reference_rays")
BELIEVED = 0.25  # of the error that is measured: what a reference's own may be


@click.command(cls=Command, epilog="gash compare predicted.npz reference.npz --json")
@click.argument("transfer", type=PATH)
@click.argument("reference", type=PATH)
@json_option
@quiet_option
def compare(transfer: Path, reference: Path, as_json: bool, quiet: bool) -> None:
    """Measure TRANSFER against REFERENCE (same mesh, same bands): relrmse, skill, equivalent rays and more.

    REFERENCE is a bake with many rays, or to an error that is at most a quarter of what is to be measured.
    """
    candidate, believed = load_transfer(transfer), load_transfer(reference)
    check_same_mesh(candidate, believed)
    estimate, truth = candidate.coefficients, believed.coefficients
    per_mse, per_std = metrics.coefficient_errors(estimate, truth)
    rays, stated = _rays_and_error(reference, believed)
    curve: dict[int, float] = {}
    if _has_yardstick(believed):
        with progress_bar("baking the yardstick", quiet) as update:
            curve = metrics.plain_bake_curve(believed.mesh, truth, rays, progress=update)
    error, relative = metrics.mse(estimate, truth), metrics.relrmse(estimate, truth)
    values = {
        "relrmse": relative,
        "skill": metrics.skill(estimate, truth, believed.normals),
        "mse": error,
        "mse_per_coefficient": per_mse.tolist(),
        "std": per_std.tolist(),
        "shadow_mse": metrics.shadow_mse(estimate, truth),
        "equivalent_rays": _equivalent_rays(error, curve) if np.any(truth) else "no transfer",
        "vertices": len(truth),
        "bands": believed.bands,
        "reference_rays": rays,
        **({} if stated is None else {"reference_error": stated}),
    }
    if stated is not None and relative is not None and stated > BELIEVED * relative:
        click.echo(
            f"warning: {reference} states a relative error of {stated:.4g}, more than a quarter of the relrmse "
            f"{relative:.4g}: bake the reference with --error {max(LOWEST_ERROR, BELIEVED * relative):.2g}",
            err=True,
        )
    click.echo(json.dumps(values) if as_json else _text(values))


def _has_yardstick(reference: Transfer) -> bool:
    """Whether the plain bake of the reference's mesh is a worse estimate of the same: not of light that bounces, of
    points, or in the shadow of occluders."""
    asked = reference.metadata.get("parameters", {})
    return len(reference.faces) > 0 and not asked.get("bounces") and not asked.get("occluders")


def _equivalent_rays(error: float, curve: dict[int, float]) -> float | str:
    return metrics.equivalent_rays(error, curve) if curve else "no yardstick"


def _rays_and_error(path: Path, reference: Transfer) -> tuple[int, float | None]:
    """Rays per vertex of a reference, on the average for a bake to an error, and the error that such a one states."""
    known = reference.metadata
    rays, stated = known.get("parameters", {}).get("rays"), known.get("estimated_error")
    if rays is not None:
        return rays, None
    if stated is None or "rays_total" not in known:
        raise ValueError(f"{path} is not a bake: compare with one, such as gash bake MESH --rays 4096")
    return round(known["rays_total"] / max(1, np.count_nonzero(reference.normals.any(axis=1)))), stated


def _text(values: dict[str, Any]) -> str:
    """The measures for people."""
    names = [*NAMES, *(["reference_error"] if "reference_error" in values else [])]
    lines = [f"{name:16s} {number(values[name])}" for name in names] + ["per coefficient  mse std"]
    pairs = zip(values["mse_per_coefficient"], values["std"], strict=True)
    return "\n".join([*lines, *(f"  {index:3d}            {m:.3e} {s:.3e}" for index, (m, s) in enumerate(pairs))])
