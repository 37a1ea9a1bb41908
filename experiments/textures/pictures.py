"""Low-poly meshes under the studio light: transfer at their vertices, at subdivided vertices, in a texture.

    .venv/bin/python -m experiments.textures.pictures --meshes FOLDER --output docs/pictures/textures.png

needs xatlas, and with --meshes fast-simplification. Subdivided as far as takes about the bytes of the texture.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import options
from experiments.textures.run import BANDS, mesh_bytes
from experiments.textures.scenes import scenes
from gash_jax.apps.pictures.montage import Panel, montage, write_picture
from gash_jax.apps.pictures.views import Camera, Picture, cast_view, exposure_for, look_up_view, shade_view, to_srgb
from gash_jax.geometry.mesh import Mesh, subdivide_midpoint
from gash_jax.light.environment import project_light
from gash_jax.light.shading import shade, shade_texture
from gash_jax.light.studio import studio_light
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.texture_bake import bake_texture

SHOWN: dict[str, tuple[Camera, int]] = {
    "table": ((30.0, 30.0), 0),
    "Spot": ((150.0, 12.0), 180),
}  # degrees of the light
RAYS, SIZE, LEVELS, PIXELS = 1024, 128, 2, 360


def panels_of(name: str, mesh: Mesh, quick: bool) -> list[Panel]:
    """One row: vertices, subdivided vertices, texture, with their bytes."""
    (camera, turn), rays, pixels = SHOWN[name], 16 if quick else RAYS, 32 if quick else PIXELS
    image = studio_light()
    light = project_light(np.roll(image, round(turn / 360 * image.shape[1]), axis=1), BANDS)
    views: list[Picture] = []
    captions: list[str] = []
    fine = mesh
    for level in range(LEVELS + 1):
        if level in (0, LEVELS):
            values = bake_transfer(fine, BANDS, rays).coefficients
            views.append(shade_view(cast_view(fine, camera, pixels), np.asarray(shade(values, light))))
            size = mesh_bytes(fine) + values.nbytes // 2
            captions.append(f"{name}, {len(fine.vertices)} vertices, {size / 1000:.0f} kB")
        fine = subdivide_midpoint(fine)
    texture = bake_texture(mesh, BANDS, rays, size=SIZE, uv="atlas")
    size = mesh_bytes(mesh) + texture.texture.nbytes + texture.uv.nbytes
    views.append(look_up_view(cast_view(mesh, camera, pixels), texture.uv, shade_texture(texture, light)))
    captions.append(f"{len(mesh.vertices)} vertices, {SIZE} x {SIZE} texels, {size / 1000:.0f} kB")
    exposure = exposure_for(views[-1:])
    return [Panel(text, to_srgb(*view, exposure)) for text, view in zip(captions, views, strict=True)]


def main(meshes: Path | None, output: Path | None, quick: bool) -> list[Panel]:
    panels: list[Any] = []
    for name, mesh in scenes(meshes).items():
        if name in SHOWN:
            panels += panels_of(name, mesh, quick)
    if output:
        write_picture(output, montage(panels, 3))
    return panels


if __name__ == "__main__":
    main(**options(__doc__, "meshes", "output", "quick"))
