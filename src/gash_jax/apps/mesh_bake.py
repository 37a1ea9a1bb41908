"""The bake of one mesh as `gash bake` does it: with a number of rays, to an error, or by a plan.

With a `texture` it bakes texels in place of vertices. `BakeSettings` are the options of the command, one field each;
its help says what they mean.
"""

import time
from pathlib import Path
from typing import Any, NamedTuple

import click

from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.apps.albedo import albedo_file, read_albedo
from gash_jax.apps.commands.plan import plan_text
from gash_jax.apps.options import check_layout
from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.apps.texture_file import write_texture
from gash_jax.files.atomic import check_writable
from gash_jax.formats.meshes import mesh_files, read_mesh
from gash_jax.geometry.health import HealthReport
from gash_jax.light.environment import load_light
from gash_jax.measure.metrics import relrmse
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bake_job import choose_replicates
from gash_jax.prt.bounce_error import bake_bounces_to_error
from gash_jax.prt.error_target import bake_to_error, check_error
from gash_jax.prt.few_rays import check_few_rays
from gash_jax.prt.plan import Plan, plan_bake
from gash_jax.prt.scene import load_points
from gash_jax.prt.texture_bake import chosen_coordinates, lay_out
from gash_jax.prt.transfer import GLOSSY, Transfer, save_transfer


class BakeSettings(NamedTuple):
    """What is baked of a mesh, and how."""

    bands: int
    rays: int | None
    error: float | None
    auto: bool
    light_path: Path | None
    layout: str | None
    replicates: int | None
    glossy: bool
    components: int | None
    bounces: int
    albedo: str | None
    texture: int | None
    uv: str | None
    points_path: Path | None
    occluders: tuple[Path, ...]
    seed: int
    up: str
    guided: bool
    unbiased: bool

    @property
    def to_error(self) -> bool:
        """Whether an error is given or planned for, and not a number of rays."""
        return self.auto or self.error is not None

    @property
    def unbiased_error(self) -> bool:
        """Whether that error is reached by rays alone, which is what a plan counts."""
        return self.to_error and (self.unbiased or self.auto)

    @property
    def relative_error(self) -> float:
        """The error to reach."""
        return 0.02 if self.error is None else self.error

    @property
    def rays_per_vertex(self) -> int:
        """The rays of a bake that has no error to reach."""
        return (8 if self.guided else 256) if self.rays is None else self.rays

    def inputs(self, mesh: Path) -> list[Path]:
        """The files that the bake of a mesh reads."""
        surfaces = [file for path in (mesh, *self.occluders) for file in mesh_files(path)]
        others = (self.light_path, self.points_path, albedo_file(self.albedo))
        return [*surfaces, *(path for path in others if path is not None)]


def check_settings(chosen: BakeSettings) -> None:
    """Raise click.UsageError for options that do not go together, ValueError for a number out of range."""
    numbers = chosen.rays is not None or chosen.replicates is not None
    if chosen.light_path and not chosen.auto:
        raise click.UsageError("--light decides the bands of a planned bake: add --auto")
    if chosen.to_error and numbers:
        raise click.UsageError("--rays and --replicates do not go with --error or --auto: choose one way")
    if chosen.to_error and chosen.glossy:
        raise click.UsageError("--glossy is baked with a number of rays: give --rays in place of --error or --auto")
    if chosen.guided and chosen.unbiased:
        raise click.UsageError("--guided is biased, --unbiased leaves its network out: choose one")
    if chosen.guided and (chosen.to_error or chosen.replicates is not None):
        raise click.UsageError(
            "--guided goes with --rays alone; a bake to an error is guided unless --unbiased is given"
        )
    if chosen.guided and (chosen.glossy or chosen.bounces or chosen.texture or chosen.points_path):
        raise click.UsageError(
            "--guided bakes the diffuse transfer of vertices: leave out --glossy, --bounces, --texture and --points"
        )
    if chosen.bounces and chosen.auto:
        raise click.UsageError("--auto plans light that does not bounce: give --rays or --error with --bounces")
    if (chosen.bounces > 0) != (chosen.albedo is not None):
        raise click.UsageError("--bounces and --albedo go together: give how often light bounces, and off what")
    if chosen.auto and (chosen.points_path or chosen.occluders):
        raise click.UsageError("--auto plans a mesh alone: give --rays or --error with --points and --occluders")
    if chosen.texture and (chosen.to_error or chosen.glossy or chosen.points_path):
        raise click.UsageError(
            "--texture is baked with a number of rays, diffuse: leave out --error, --auto, --glossy and --points"
        )
    if chosen.uv and not chosen.texture:
        raise click.UsageError("--uv says where texels lie: give it with --texture, such as --texture 512")
    if chosen.components is not None:
        most = (2 * chosen.bands - 1) ** 2
        if not chosen.glossy or chosen.bounces:
            raise click.UsageError("--components compresses visibility: give it with --glossy, and without --bounces")
        if chosen.components > most:
            raise click.UsageError(f"{chosen.bands} bands have {most} components: use that many or fewer")
    check_layout(chosen.layout, chosen.light_path)
    if chosen.to_error:
        check_error(chosen.relative_error)
    elif chosen.guided:
        check_few_rays(chosen.rays_per_vertex)
    else:
        choose_replicates(chosen.rays_per_vertex, chosen.replicates)


def bake_mesh(mesh: Path, output: Path, chosen: BakeSettings, quiet: bool) -> None:
    """Bake a mesh, write its file, say what was found. Raises ValueError for what is no mesh or cannot be written."""
    check_writable(output, chosen.inputs(mesh))
    bands, error, seed, up = chosen.bands, chosen.relative_error, chosen.seed, chosen.up
    light = None
    if chosen.light_path is not None:
        light = load_light(chosen.light_path, MAX_BANDS, chosen.layout).coefficients
    started = time.perf_counter()
    surface, health = read_mesh(mesh, up)
    points, normals = load_points(chosen.points_path, surface, up) if chosen.points_path else (None, None)
    occluders = [read_mesh(path, up)[0] for path in chosen.occluders]
    colors = None if chosen.albedo is None else read_albedo(chosen.albedo, [mesh, *chosen.occluders])
    reflected = {"bounces": chosen.bounces, "albedo": colors, "replicates": chosen.replicates, "seed": seed}
    read = time.perf_counter() - started
    if chosen.texture:
        texels = lay_out(surface, chosen.texture, chosen_coordinates(mesh, chosen.uv))
        rays, options = chosen.rays_per_vertex, {"occluders": occluders, **reflected}
        write_texture(output, (surface, health), texels, bands, rays, options, quiet)
        return
    scene: dict[str, Any] = {"points": points, "normals": normals, "occluders": occluders}
    plan = plan_bake(surface, error, bands=bands, light=light, seed=seed) if chosen.auto else None
    if plan is not None:
        say(plan_text(plan.to_dict()), quiet)
        bands = plan.bands
    with progress_bar(f"baking {mesh.name}", quiet) as update:
        if chosen.to_error and chosen.bounces:
            scene |= {"bounces": chosen.bounces, "albedo": colors}
            transfer = bake_bounces_to_error(surface, error, bands, **scene, seed=seed, progress=update)
        elif chosen.unbiased_error:
            transfer = bake_to_error(surface, error, bands, **scene, seed=seed, progress=update)
        elif chosen.to_error or chosen.guided:
            from gash_jax.models import guided  # networks are slow to import, and other bakes have none

            if chosen.to_error:
                transfer = guided.bake_to_error(surface, error, bands, **scene, seed=seed, progress=update)
            else:
                rays = chosen.rays_per_vertex
                transfer = guided.bake_guided(surface, bands, rays, occluders=occluders, seed=seed, progress=update)
        else:
            scene |= {"glossy": chosen.glossy, **reflected}
            transfer = bake_transfer(surface, bands, chosen.rays_per_vertex, **scene, progress=update)
    entries = _entries_of_aim(transfer, plan) if chosen.to_error else transfer.metadata
    seconds = {**entries["seconds"], "read": read}
    transfer = transfer._replace(metadata={**entries, "health": health.to_dict(), "seconds": seconds})
    save_transfer(output, transfer, chosen.components)
    for line in (_reached(transfer, error) if chosen.to_error else _estimated(transfer)) + _summary(transfer, health):
        say(line, quiet)
    say(f"wrote {output}", quiet)


def _entries_of_aim(transfer: Transfer, plan: Plan | None) -> dict[str, Any]:
    """The metadata of a bake to an error, with the plan and the reason for the number of bands."""
    entries, reason = transfer.metadata, "as asked"
    if plan is not None and plan.radiance_left_out is not None:
        reason = f"which leave out at most {plan.radiance_left_out:.2%} of the radiance under the light that was given"
    modelled = {**entries["modelled"], "bands": f"{transfer.bands}, {reason}"}
    return {**entries, "modelled": modelled, **({} if plan is None else {"plan": plan.to_dict()})}


def _reached(transfer: Transfer, error: float) -> list[str]:
    estimated, rounds = transfer.metadata["estimated_error"], len(transfer.metadata["rounds"])
    lines = [f"error {error:g} was not reached: the rays per vertex are limited"] if estimated > error else []
    if "counted_bounces" in transfer.metadata:
        counted, left_out = (transfer.metadata[name] for name in ("counted_bounces", "light_left_out"))
        more = f"further ones would add {left_out:.2%}" if left_out else "as many as were asked for"
        lines.append(f"{counted} bounces: {more}")
    return [*lines, f"estimated relative error {estimated:.2%} after {rounds} rounds"]


def _estimated(transfer: Transfer) -> list[str]:
    errors = transfer.predicted_error if transfer.standard_error is None else transfer.standard_error
    if errors is None:
        return []
    relative = relrmse(transfer.coefficients + errors, transfer.coefficients)
    lines = [f"estimated relative error {relative:.2%}" if relative is not None else "no transfer"]
    for name in GLOSSY:
        error = transfer.metadata.get(name, {}).get("relative_error")
        lines += [] if error is None else [f"estimated relative error of the {name} {error:.2%}"]
    return lines


def _summary(transfer: Transfer, health: HealthReport) -> list[str]:
    """What was found in the mesh, rays and time, and how much was taken from the closed form."""
    seconds, total = transfer.metadata["seconds"]["total"], transfer.metadata["rays_total"]
    count, modelled = len(transfer.vertices), transfer.metadata["modelled"]
    lines = [f"  {line}" for line in health.lines()]
    lines.append(
        f"{count} vertices x {total / max(count, 1):.4g} rays in {seconds:.2f} s ({total / seconds / 1e6:.2g} M rays/s)"
    )
    if modelled.get("blended_with_closed_form", True):  # not the plain bake
        lines.append(f"closed form: {modelled.get('all_rays_free', 0):.1%} of the vertices saw nothing in the way")
    return lines
