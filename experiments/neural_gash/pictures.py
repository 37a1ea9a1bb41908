"""Relit pictures of the networks that ship: `.venv/bin/python -m experiments.neural_gash.pictures --meshes FOLDER`.

One picture a mesh, its face and its back at one exposure: reference, MLP, two-stage, `local`, and what the last two get
wrong. Drawn are two meshes that the project generates, and of --meshes those whose pictures may be shown.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import options
from experiments.neural_gash.evaluate import load_meshes
from gash_jax.apps.pictures.montage import Panel, montage, signed_colors, write_picture
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb
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


def main(meshes: Path | None, output: Path, quick: bool) -> list[Path]:
    models, written = {name: load_model(name) for name in METHODS}, []
    for name, read in load_meshes(meshes, quick).items():
        if name not in SHOWN:
            continue
        mesh = read()
        truth = make_reference(mesh, rays=256 if quick else REFERENCE_RAYS).coefficients
        found = {"reference": truth} | {model: models[model].predict(mesh).coefficients for model in METHODS}
        views, studio = VIEWS, studio_light()
        if name in LOOKS_BACK:  # the camera and the light both go half around it
            views, studio = VIEWS[::-1], np.roll(studio, studio.shape[1] // 2, axis=1)
        light = project_map(studio, 3)
        radiance = {method: np.asarray(shade(c, light)) for method, c in found.items()}
        hits = [cast_view(mesh, view, 64 if quick else 300) for view in views]
        exposure = exposure_for([shade_view(hit, radiance["reference"]) for hit in hits])
        panels = []
        for hit in hits:
            images = {method: shade_view(hit, values) for method, values in radiance.items()}
            for method, image in images.items():
                skill = metrics.skill(found[method], truth, mesh.normals)
                caption = "reference" if method == "reference" else f"{method}\nskill {skill:.2f}"
                panels.append(Panel(caption, to_srgb(*image, exposure)))
            for method in METHODS[1:]:
                wrong = (images[method][0] - images["reference"][0]).mean(-1) * exposure
                colors = signed_colors(wrong, FULL, images[method][1])
                panels.append(Panel(f"{method} - reference\n(1 is white)", colors, FULL))
        path = output / f"{name.replace(' ', '_')}.png"
        write_picture(path, montage(panels, columns=6))
        written.append(path)
    return written


if __name__ == "__main__":
    main(**options(__doc__, "meshes", "output", "quick", output="docs/pictures"))
