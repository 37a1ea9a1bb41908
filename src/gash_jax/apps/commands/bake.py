"""`gash bake` in its three ways: with a number of rays, to an error, or by the plan that a few pilot rays make.

With `--texture` it bakes texels in place of vertices.
"""

import time
from pathlib import Path
from typing import Any

import click

from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.apps.albedo import albedo_file, read_albedo
from gash_jax.apps.commands.plan import plan_text
from gash_jax.apps.options import (
    PATH,
    Command,
    bands_option,
    bounces_option,
    check_layout,
    layout_option,
    light_option,
    output_option,
    quiet_option,
    up_option,
)
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
from gash_jax.prt.error_target import bake_to_error, check_error
from gash_jax.prt.plan import Plan, plan_bake
from gash_jax.prt.scene import load_points
from gash_jax.prt.texture import MOST_TEXELS
from gash_jax.prt.texture_bake import chosen_coordinates, lay_out
from gash_jax.prt.transfer import GLOSSY, Transfer, save_transfer


@click.command(cls=Command, epilog="gash bake bunny.ply -o bunny.npz --error 0.02")
@click.argument("mesh", type=PATH)
@output_option
@bands_option()
@click.option("--rays", type=click.IntRange(1, 1 << 20), help="Rays per vertex.  [default: 256]")
@click.option("--error", type=float, help="Relative error to reach, 0.001 to 1; rays go where they are needed.")
@click.option("--auto", is_flag=True, help="Plan first, then follow the plan (--error 0.02 unless given).")
@light_option("With --auto: the light that decides the bands, by the radiance of the mesh under it (map or name).")
@layout_option
@click.option(
    "--replicates",
    type=click.IntRange(1),
    help="Independent point sets the rays are split into for the standard error.  [default: 4; 1 below 16 rays]",
)
@click.option("--glossy", is_flag=True, help="As many rays again for glossy transfer: visibility in 2 bands - 1 bands.")
@click.option(
    "--components",
    type=click.IntRange(1, 361),
    help="With --glossy: write the visibility as so many numbers a vertex, its principal components.",
)
@bounces_option
@click.option(
    "--albedo",
    metavar="0.6|R,G,B|vertex|FILE",
    help="With --bounces: one number, one colour, the vertices' colours, or a .npy or .npz file with one a vertex.",
)
@click.option("--texture", type=click.IntRange(1, MOST_TEXELS), help="Bake into a texture of so many texels squared.")
@click.option(
    "--uv",
    type=click.Choice(["own", "atlas"]),
    help="With --texture: the file's texture coordinates, or an atlas by xatlas.  [default: own, if it has some]",
)
@click.option("--points", "points_path", type=PATH, help="Bake these points with normals, or splats, instead (.ply).")
@click.option("--occluders", type=PATH, multiple=True, help="A mesh that casts shadow, and gets none; repeatable.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Seed of the rays.")
@up_option
@quiet_option
def bake(
    mesh: Path,
    output: Path,
    bands: int,
    rays: int | None,
    error: float | None,
    auto: bool,
    light_path: Path | None,
    layout: str | None,
    replicates: int | None,
    glossy: bool,
    components: int | None,
    bounces: int,
    albedo: str | None,
    texture: int | None,
    uv: str | None,
    points_path: Path | None,
    occluders: tuple[Path, ...],
    seed: int,
    up: str,
    quiet: bool,
) -> None:
    """Bake shadowed transfer of MESH with Embree, with a standard error for every coefficient."""
    if light_path and not auto:
        raise click.UsageError("--light decides the bands of a planned bake: add --auto")
    to_error = auto or error is not None
    if to_error and (rays is not None or replicates is not None):
        raise click.UsageError("--rays and --replicates do not go with --error or --auto: choose one way")
    if to_error and glossy:
        raise click.UsageError("--glossy is baked with a number of rays: give --rays in place of --error or --auto")
    if bounces and to_error:
        raise click.UsageError("--bounces goes with a number of rays: give --rays in place of --error or --auto")
    if (bounces > 0) != (albedo is not None):
        raise click.UsageError("--bounces and --albedo go together: give how often light bounces, and off what")
    if auto and (points_path or occluders):
        raise click.UsageError("--auto plans a mesh alone: give --rays or --error with --points and --occluders")
    if texture and (to_error or glossy or points_path):
        raise click.UsageError(
            "--texture is baked with a number of rays, diffuse: leave out --error, --auto, --glossy and --points"
        )
    if uv and not texture:
        raise click.UsageError("--uv says where texels lie: give it with --texture, such as --texture 512")
    if components is not None and (not glossy or bounces):
        raise click.UsageError("--components compresses visibility: give it with --glossy, and without --bounces")
    if components is not None and components > (2 * bands - 1) ** 2:
        raise click.UsageError(f"{bands} bands have {(2 * bands - 1) ** 2} components: use that many or fewer")
    check_layout(layout, light_path)
    surfaces = [file for path in (mesh, *occluders) for file in mesh_files(path)]
    check_writable(output, [*surfaces, light_path, points_path, albedo_file(albedo)])
    error, rays = 0.02 if error is None else error, 256 if rays is None else rays
    if to_error:
        check_error(error)
    else:
        choose_replicates(rays, replicates)
    light = None if light_path is None else load_light(light_path, MAX_BANDS, layout).coefficients
    started = time.perf_counter()
    surface, health = read_mesh(mesh, up)
    points, normals = load_points(points_path, surface, up) if points_path else (None, None)
    scene: dict[str, Any] = {"points": points, "normals": normals}
    scene["occluders"] = [read_mesh(path, up)[0] for path in occluders]
    colors = None if albedo is None else read_albedo(albedo, [mesh, *occluders])
    read = time.perf_counter() - started
    if texture:
        options = {"occluders": scene["occluders"], "bounces": bounces, "albedo": colors, "replicates": replicates}
        texels = lay_out(surface, texture, chosen_coordinates(mesh, uv))
        write_texture(output, (surface, health), texels, bands, rays, {**options, "seed": seed}, quiet)
        return
    plan = plan_bake(surface, error, bands=bands, light=light, seed=seed) if auto else None
    if plan is not None:
        say(plan_text(plan.to_dict()), quiet)
        bands = plan.bands
    with progress_bar(f"baking {mesh.name}", quiet) as update:
        if to_error:
            transfer = bake_to_error(surface, error, bands, **scene, seed=seed, progress=update)
        else:
            reflected = {"bounces": bounces, "albedo": colors, "glossy": glossy, "replicates": replicates}
            transfer = bake_transfer(surface, bands, rays, **scene, **reflected, seed=seed, progress=update)
    entries = _entries_of_aim(transfer, plan) if to_error else transfer.metadata
    seconds = {**entries["seconds"], "read": read}
    transfer = transfer._replace(metadata={**entries, "health": health.to_dict(), "seconds": seconds})
    save_transfer(output, transfer, components)
    for line in (_reached(transfer, error) if to_error else _estimated(transfer)) + _summary(transfer, health):
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
    return [*lines, f"estimated relative error {estimated:.2%} after {rounds} rounds"]


def _estimated(transfer: Transfer) -> list[str]:
    if transfer.standard_error is None:
        return []
    relative = relrmse(transfer.coefficients + transfer.standard_error, transfer.coefficients)
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
