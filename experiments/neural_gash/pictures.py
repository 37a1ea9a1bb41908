"""Relit pictures of the networks that ship: `.venv/bin/python -m experiments.neural_gash.pictures --meshes FOLDER`.

One picture a mesh, its face and its back at one exposure: reference, MLP, two-stage, `local`, and what the last two get
wrong. Drawn are two meshes that the project generates, and of --meshes those whose pictures may be shown.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.options import options
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.apps.pictures.montage import Panel, montage, signed_colors, write_picture
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.measure import metrics
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference
from gash_jax.models.model import load_model

SHOWN = ("generated 1", "generated 2", "spot", "stanford_bunny")
METHODS = ("mlp", "two-stage", "local")
VIEWS = ("front", "back")
LOOKS_BACK = ("spot",)  # its face is towards -z
FULL = 0.3


def draw(name: str, mesh: Mesh, found: dict[str, np.ndarray], wrong: Sequence[str], size: int, path: Path) -> None:
    """Face and back at one exposure: all methods, of which the first is the reference, and what some get wrong."""
    views, studio = VIEWS, studio_light()
    if name in LOOKS_BACK:  # the camera and the light both go half around it
        views, studio = VIEWS[::-1], np.roll(studio, studio.shape[1] // 2, axis=1)
    light, (first, *_) = project_map(studio, 3), found
    radiance = {method: np.asarray(shade(c, light)) for method, c in found.items()}
    hits = [cast_view(mesh, view, size) for view in views]
    exposure = exposure_for([shade_view(hit, radiance[first]) for hit in hits])
    panels = []
    for hit in hits:
        images = {method: shade_view(hit, values) for method, values in radiance.items()}
        for method, image in images.items():
            skill = metrics.skill(found[method], found[first], mesh.normals)
            caption = first if method == first else f"{method}\nskill {skill:.2f}"
            panels.append(Panel(caption, to_srgb(*image, exposure)))
        for method in wrong:
            off = (images[method][0] - images[first][0]).mean(-1) * exposure
            colors = signed_colors(off, FULL, images[method][1])
            panels.append(Panel(f"{method} - {first}\n(1 is white)", colors, FULL))
    write_picture(path, montage(panels, columns=len(found) + len(wrong)))


def main(meshes: Path | None, output: Path, quick: bool) -> list[Path]:
    models, written = {name: load_model(name) for name in METHODS}, []
    for name, read in load_meshes(meshes, quick).items():
        if name in SHOWN:
            mesh, path = read(), output / f"{name.replace(' ', '_')}.png"
            truth = make_reference(mesh, rays=256 if quick else REFERENCE_RAYS).coefficients
            found = {"reference": truth} | {model: models[model].predict(mesh).coefficients for model in METHODS}
            draw(name, mesh, found, METHODS[1:], 64 if quick else 300, path)
            written.append(path)
    return written


if __name__ == "__main__":
    main(**options(__doc__, "meshes", "output", "quick", output="docs/pictures"))
