"""`gash bake` in its three ways: with a number of rays, to an error, or by the plan that a few pilot rays make.

With `--texture` it bakes texels in place of vertices, with several meshes a folder of files.
"""

from pathlib import Path
from typing import Any

import click

from gash_jax.apps.folder_bake import bake_folder
from gash_jax.apps.mesh_bake import BakeSettings, bake_mesh, check_settings
from gash_jax.apps.options import (
    PATH,
    Command,
    bands_option,
    bounces_option,
    layout_option,
    light_option,
    quiet_option,
    up_option,
)
from gash_jax.apps.shard_options import Work, shard_options
from gash_jax.prt.texture import MOST_TEXELS


@click.command(cls=Command, epilog="gash bake bunny.ply -o bunny.npz --error 0.02")
@click.argument("mesh", type=PATH, nargs=-1, required=True)
@click.option("-o", "--output", required=True, type=PATH, help="File to write; the folder of several meshes.")
@bands_option()
@click.option("--rays", type=click.IntRange(1, 1 << 20), help="Rays per vertex.  [default: 256]")
@click.option("--error", type=float, help="Relative error to reach, 0.001 to 1; rays go where they are needed.")
@click.option(
    "--guided", is_flag=True, help="Few rays (--rays 4, 8, 16 ...; 8 unless given), reconstructed by a network; biased."
)
@click.option(
    "--unbiased", is_flag=True, help="With --error: by rays alone, without the network, and with a standard error."
)
@click.option(
    "--auto", is_flag=True, help="Plan first, then follow the plan by rays alone (--error 0.02 unless given)."
)
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
@shard_options
@quiet_option
def bake(mesh: tuple[Path, ...], output: Path, quiet: bool, work: Work, **options: Any) -> None:
    """Bake shadowed transfer of MESH with Embree, with an error bar for every coefficient.

    That of rays alone is a standard error; --guided and --error foretell theirs by the network that they use.

    Several meshes are baked into a folder, which may be shared with other machines: -o FOLDER. What is there already,
    baked with the same options from the same files, is left as it is.
    """
    chosen = BakeSettings(**options)
    check_settings(chosen)
    if len(mesh) == 1 and work == Work():
        bake_mesh(mesh[0], output, chosen, quiet)
    else:
        bake_folder(mesh, output, chosen, work, quiet)
