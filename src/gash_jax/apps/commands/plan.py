"""`gash plan`: what a bake to an error, with bounces or into a texture needs, from a few pilot rays."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from gash_jax.algebra.sh import MAX_BANDS
from gash_jax.apps.albedo import read_albedo
from gash_jax.apps.options import (
    PATH,
    Command,
    bands_option,
    bounces_option,
    check_layout,
    json_option,
    layout_option,
    light_option,
    up_option,
)
from gash_jax.formats.meshes import read_mesh
from gash_jax.light.environment import load_light
from gash_jax.prt.bounce_plan import plan_bounces
from gash_jax.prt.error_target import check_error
from gash_jax.prt.plan import plan_bake
from gash_jax.prt.texture import MOST_TEXELS
from gash_jax.prt.texture_bake import chosen_coordinates
from gash_jax.prt.texture_plan import plan_texture


@click.command(cls=Command, epilog="gash plan bunny.ply --light studio.hdr --error 0.02")
@click.argument("mesh", type=PATH)
@light_option("Light that decides the bands, by the radiance of the mesh under it (.hdr, .exr, .npz, or a name).")
@layout_option
@click.option("--error", type=float, help="Relative error to reach, 0.001 to 1.  [default: 0.02]")
@bounces_option
@click.option("--texture", type=click.IntRange(1, MOST_TEXELS), help="Plan a texture of so many texels squared.")
@click.option(
    "--uv", type=click.Choice(["own", "atlas"]), help="With --texture, as of gash bake.  [default: own, if it has some]"
)
@click.option(
    "--rays",
    type=click.IntRange(1, 1 << 20),
    help="With --bounces or --texture: rays per vertex or texel.  [default: 256]",
)
@click.option("--albedo", help="With --bounces: three colours R,G,B take longer than one.")
@bands_option()
@click.option("--glossy", is_flag=True, help="Plan glossy transfer too: as many rays again, and a larger file.")
@up_option
@json_option
def plan(
    mesh: Path,
    light_path: Path | None,
    layout: str | None,
    error: float | None,
    bounces: int,
    texture: int | None,
    uv: str | None,
    rays: int | None,
    albedo: str | None,
    bands: int,
    glossy: bool,
    up: str,
    as_json: bool,
) -> None:
    """Say what baking MESH needs: bands, rays, seconds and bytes, from a few pilot rays."""
    if bounces and (light_path or error is not None):
        raise click.UsageError("--bounces plans a bake of --rays: leave out --light and --error")
    if texture and (bounces or glossy or light_path or error is not None):
        raise click.UsageError(
            "--texture plans a diffuse bake of --rays: leave out --bounces, --glossy, --light and --error"
        )
    if uv and not texture:
        raise click.UsageError("--uv says where texels lie: give it with --texture, such as --texture 512")
    if not bounces and albedo is not None:
        raise click.UsageError("--albedo plans light that bounces: add --bounces")
    if not bounces and not texture and rays is not None:
        raise click.UsageError("--rays plans light that bounces, or a texture: add --bounces or --texture")
    error = 0.02 if error is None else error
    check_error(error)
    check_layout(layout, light_path)
    light = None if light_path is None else load_light(light_path, MAX_BANDS, layout).coefficients
    surface, health = read_mesh(mesh, up)
    rays = 256 if rays is None else rays
    if texture:
        found = plan_texture(surface, texture, rays, bands=bands, uv=chosen_coordinates(mesh, uv)).to_dict()
    elif bounces:
        coloured = albedo is not None and np.shape(read_albedo(albedo, [mesh]))[-1:] == (3,)
        wanted = {"bands": bands, "coloured": coloured, "glossy": glossy}
        found = plan_bounces(surface, bounces, rays, **wanted).to_dict()
    else:
        found = plan_bake(surface, error, bands=bands, light=light, glossy=glossy).to_dict()
    values = {"vertices": len(surface.vertices), "faces": len(surface.faces), **found, "health": health.to_dict()}
    text = texture_text if texture else bounces_text if bounces else plan_text
    click.echo(json.dumps(values) if as_json else text(values))


def plan_text(values: dict[str, Any]) -> str:
    """The plan for people: what, and why."""
    left_out = values["radiance_left_out"]
    reason = "as asked; --light decides by the light"
    if left_out is not None:
        reason = f"the light's other bands add at most {left_out:.2%} to the radiance, shadows counted"
    return "\n".join(
        [
            f"occluded vertices    {values['occluded_share']:.1%}, {values['blocked_rays']:.1%} of all rays blocked "
            f"({values['sampled_vertices']} vertices sampled)",
            f"bands                {values['bands']} ({reason})",
            f"error                {values['error']:g}",
            f"rays                 {values['rays_total'] / 1e6:.3g} M, {values['rays_per_vertex']:.3g} per vertex "
            "(by rays alone, as --auto bakes; --error takes fewer)",
            f"time                 {values['seconds']:.2g} s",
            f"file                 {values['bytes'] / 2**20:.3g} MiB",
        ]
    )


def bounces_text(values: dict[str, Any]) -> str:
    """The plan of a bake with bounces for people."""
    return "\n".join(
        [
            f"reflected rays       {values['reflected_rays']:.1%} meet the front of a face "
            f"({values['sampled_vertices']} vertices sampled)",
            f"bounces              {values['bounces']}, {values['bands']} bands",
            f"rays                 {values['rays_total'] / 1e6:.3g} M, {values['rays_per_vertex']} per vertex",
            f"time                 {values['seconds']:.2g} s",
            f"memory               {values['memory'] / 2**20:.3g} MiB beside the mesh",
            f"file                 {values['bytes'] / 2**20:.3g} MiB",
        ]
    )


def texture_text(values: dict[str, Any]) -> str:
    """The plan of a texture for people."""
    size = values["size"]
    return "\n".join(
        [
            f"texels               {values['texels']}, {values['texels'] / size**2:.0%} of {size} x {size} "
            f"(texture coordinates: {values['uv']})",
            f"bands                {values['bands']}",
            f"rays                 {values['rays_total'] / 1e6:.3g} M, {values['rays_per_texel']} per texel",
            f"time                 {values['seconds']:.2g} s",
            f"file                 {values['bytes'] / 2**20:.3g} MiB",
        ]
    )
