"""Bake a texture and write its file, saying beforehand what it takes and afterwards what came of it."""

from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.apps.printing import say
from gash_jax.apps.progress import progress_bar
from gash_jax.geometry.health import HealthReport
from gash_jax.geometry.mesh import Mesh
from gash_jax.measure.metrics import relrmse
from gash_jax.prt.bake import choose_replicates
from gash_jax.prt.texture import FILLED, TransferTexture, save_texture
from gash_jax.prt.texture_bake import Layout, bake_layout


def write_texture(
    output: Path,
    read: tuple[Mesh, HealthReport],
    layout: Layout,
    bands: int,
    rays: int,
    options: dict[str, Any],
    quiet: bool,
) -> None:
    """Bake the texels of a layout, write the file, and say what was found; `options` are those of `bake_layout`."""
    mesh, health = read
    colours = 3 if options["bounces"] and np.shape(options["albedo"])[-1:] == (3,) else 1
    errors = 1 + (choose_replicates(rays, options["replicates"]) > 1)
    for line in layout.lines(rays, bands**2 * colours * errors):
        say(line, quiet)
    with progress_bar("baking texels", quiet) as update:
        texture = bake_layout(mesh, layout, bands, rays, **options, progress=update)
    save_texture(output, texture._replace(metadata={**texture.metadata, "health": health.to_dict()}))
    for line in [*_estimated(texture), *(f"  {line}" for line in health.lines())]:
        say(line, quiet)
    told = texture.metadata["texture"]
    if told["points_on_seams"]:
        jump, count = told["largest_seam_jump"], told["points_on_seams"]
        say(f"seams: both sides agree within {jump:.1g} at {count} points", quiet)
    say(f"wrote {output} (texture coordinates: {told['uv']})", quiet)


def _estimated(texture: TransferTexture) -> list[str]:
    if texture.standard_error is None:
        return []
    baked = texture.coverage != FILLED
    values, error = (array[baked].astype(np.float32) for array in (texture.texture, texture.standard_error))
    relative = relrmse(values + error, values)
    return [f"estimated relative error {relative:.2%}" if relative is not None else "no transfer"]
