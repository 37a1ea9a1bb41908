"""Relit pictures of the variants: `.venv/bin/python -m experiments.neural_gash.pictures --output docs/pictures`.

One picture a mesh, front and back: reference, MLP, two-stage, `local`, and what the last two get wrong. Drawn are two
meshes that the project generates, and of --meshes those whose pictures may be shown.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import options
from experiments.neural_gash.evaluate import load_meshes, load_models
from gash_jax.apps.pictures.montage import montage, signed_colors, write_picture
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.measure import metrics
from gash_jax.measure.reference import REFERENCE_RAYS, make_reference

SHOWN = ("generated 1", "generated 2", "spot", "stanford_bunny")
FULL = 0.3


def main(runs: Path, meshes: Path | None, output: Path, quick: bool) -> list[Path]:
    models, light, written = load_models(runs), project_map(studio_light(), 3), []
    chosen = [f"{name}-long" if f"{name}-long" in models else name for name in ("mlp", "two-stage")] + ["local"]
    for name, read in load_meshes(meshes, quick).items():
        if name not in SHOWN:
            continue
        mesh = read()
        truth = make_reference(mesh, rays=256 if quick else REFERENCE_RAYS).coefficients
        found = {"reference": truth} | {model: models[model].predict(mesh).coefficients for model in chosen}
        radiance = {method: np.asarray(shade(c, light)) for method, c in found.items()}
        hits = [cast_view(mesh, view, 64 if quick else 360) for view in ("front", "back")]
        exposure = exposure_for([shade_view(hit, radiance["reference"]) for hit in hits])
        panels = []
        for hit in hits:
            images = {method: shade_view(hit, values) for method, values in radiance.items()}
            for method, image in images.items():
                skill = metrics.skill(found[method], truth, mesh.normals)
                caption = "reference" if method == "reference" else f"{method}\nskill {skill:.2f}"
                panels.append((caption, to_srgb(*image, exposure)))
            for method in chosen[1:]:
                wrong = (images[method][0] - images["reference"][0]).mean(-1) * exposure
                panels.append((f"{method} - reference\nfull colour at {FULL}", signed_colors(wrong, FULL)))
        path = output / f"{name.replace(' ', '_')}.png"
        write_picture(path, montage(panels, columns=6))
        written.append(path)
    return written


if __name__ == "__main__":
    main(**options(__doc__, "runs", "meshes", "output", "quick", output="docs/pictures"))
