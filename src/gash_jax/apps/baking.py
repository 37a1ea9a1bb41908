"""`gash bake` in its three ways (rays, error, auto) and `gash plan`."""

import time
from pathlib import Path
from typing import Any

from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.apps.progress import progress_bar, say
from gash_jax.files.atomic import check_writable
from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.health import HealthReport
from gash_jax.light.environment import load_light
from gash_jax.measure import metrics
from gash_jax.prt.bake import bake_transfer, choose_replicates
from gash_jax.prt.error_target import bake_to_error, check_error
from gash_jax.prt.plan import plan_bake
from gash_jax.prt.transfer import Transfer, save_transfer


def _finish_bake(transfer: Transfer, health: HealthReport, read: float, output: Path, quiet: bool) -> None:
    """Write a bake and say how it went."""
    transfer.metadata["health"] = health.to_dict()
    transfer.metadata["seconds"]["read"] = read
    save_transfer(output, transfer)
    seconds, total = transfer.metadata["seconds"]["total"], transfer.metadata["rays_total"]
    for line in health.lines():
        say(f"  {line}", quiet)
    count = len(transfer.vertices)
    each, rate = total / max(count, 1), total / seconds / 1e6
    say(f"{count} vertices x {each:.4g} rays in {seconds:.2f} s ({rate:.2g} M rays/s)", quiet)
    modelled = transfer.metadata["modelled"]
    if modelled.get("blended_with_closed_form", True):  # not the plain bake
        say(f"closed form: {modelled.get('all_rays_free', 0):.1%} of the vertices saw nothing in the way", quiet)
    say(f"wrote {output}", quiet)


def bake(
    mesh_path: Path,
    output: Path,
    bands: int,
    rays: int,
    replicates: int | None,
    seed: int,
    up: str,
    quiet: bool,
) -> None:
    """`gash bake --rays`."""
    check_writable(output)
    choose_replicates(rays, replicates)
    started = time.perf_counter()
    mesh, health = read_mesh(mesh_path, up)
    read = time.perf_counter() - started
    with progress_bar(f"baking {mesh_path.name}", quiet) as update:
        transfer = bake_transfer(mesh, bands, rays, replicates=replicates, seed=seed, progress=update)
    if transfer.standard_error is not None:
        relative = metrics.relrmse(transfer.coefficients + transfer.standard_error, transfer.coefficients)
        say(f"estimated relative error {relative:.2%}" if relative is not None else "no transfer", quiet)
    _finish_bake(transfer, health, read, output, quiet)


def bake_error(
    mesh_path: Path,
    output: Path,
    bands: int,
    error: float,
    auto: bool,
    light_path: Path | None,
    seed: int,
    up: str,
    quiet: bool,
) -> None:
    """`gash bake --error` and `gash bake --auto`, which first plans and then follows the plan."""
    check_writable(output)
    check_error(error)
    irradiance = None if light_path is None else load_light(light_path, MAX_BANDS).coefficients
    started = time.perf_counter()
    mesh, health = read_mesh(mesh_path, up)
    read = time.perf_counter() - started
    plan = plan_bake(mesh, error, bands=bands, light=irradiance, seed=seed) if auto else None
    if plan is not None:
        say(plan_text(plan.to_dict()), quiet)
    with progress_bar(f"baking {mesh_path.name}", quiet) as update:
        transfer = bake_to_error(mesh, error, bands if plan is None else plan.bands, seed=seed, progress=update)
    entries = transfer.metadata
    entries["modelled"]["bands"] = f"{transfer.bands}, as asked"
    if plan is not None:
        entries["plan"] = plan.to_dict()
        if plan.irradiance_held is not None:
            held = f"hold {plan.irradiance_held:.2%} of the light's irradiance; higher ones are left out"
            entries["modelled"]["bands"] = f"{transfer.bands}, which {held}"
    if entries["estimated_error"] > error:
        say(f"error {error:g} was not reached: the rays per vertex are limited", quiet)
    say(f"estimated relative error {entries['estimated_error']:.2%} after {len(entries['rounds'])} rounds", quiet)
    _finish_bake(transfer, health, read, output, quiet)


def plan(mesh_path: Path, light_path: Path | None, error: float, bands: int, up: str) -> dict[str, Any]:
    """`gash plan`."""
    check_error(error)
    light = None if light_path is None else load_light(light_path, MAX_BANDS).coefficients
    mesh, health = read_mesh(mesh_path, up)
    found = plan_bake(mesh, error, bands=bands, light=light)
    return {"vertices": len(mesh.vertices), "faces": len(mesh.faces), **found.to_dict(), "health": health.to_dict()}


def plan_text(values: dict[str, Any]) -> str:
    """The plan for people: what, and why."""
    held = values["irradiance_held"]
    reason = "as asked; --light decides by the light" if held is None else f"hold {held:.2%} of the irradiance"
    return "\n".join(
        [
            f"occluded vertices    {values['occluded_share']:.1%}, {values['blocked_rays']:.1%} of all rays blocked "
            f"({values['sampled_vertices']} vertices sampled)",
            f"bands                {values['bands']} ({reason})",
            f"error                {values['error']:g}",
            f"rays                 {values['rays_total'] / 1e6:.3g} M, {values['rays_per_vertex']:.3g} per vertex",
            f"time                 {values['seconds']:.2g} s",
            f"file                 {values['bytes'] / 2**20:.3g} MiB",
        ]
    )
