"""A light before and after each window: `.venv/bin/python -m experiments.windows.pictures --output FILE.jpg`.

Every mesh in three bands under each light, one exposure a row, without a window and with every kind. What is negative
in a colour is drawn in magenta. With `--meshes` and `--maps` the three meshes of `run` and two maps with very small
bright lights, without them what the project generates.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import options
from experiments.maps import lights
from experiments.windows.run import KINDS, chosen_meshes, window
from gash_jax.apps.pictures.montage import Panel, montage, write_picture
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb
from gash_jax.prt.bake import bake_transfer

MAPS = ("grace_256", "venice_sunset_1k")
MAGENTA = (230, 0, 160)
CAMERAS = {"spot": (30.0, -20.0), "stanford_bunny": (200.0, -15.0), "armadillo": (180.0, -10.0)}


def main(output: Path | None, meshes: Path | None, maps: Path | None, quick: bool) -> None:
    found = lights(maps, 3)
    found = {name: found[name] for name in (MAPS if maps else list(found)[2:])}
    size, panels = 64 if quick else 260, []
    for name, mesh in chosen_meshes(meshes, quick).items():
        transfer = np.asarray(bake_transfer(mesh, 3, 64 if quick else 256).coefficients)
        hit = cast_view(mesh, CAMERAS.get(name, "back"), size)
        for source, light in found.items():
            factors = {kind: window(light, kind) for kind in KINDS}
            images = {k: shade_view(hit, transfer @ (light * w[:, None])) for k, w in factors.items()}
            exposure = exposure_for([images["none"]])
            for kind, (image, covered) in images.items():
                pixels, below = to_srgb(image, covered, exposure), image.min(axis=-1) < 0
                pixels[below & (covered > 0.5)] = MAGENTA
                kept = f"{factors[kind][1]:.2f} of l = 1, {factors[kind][4]:.2f} of l = 2"
                title = f"{name}, {source}" if kind == "none" else f"{kind}: {kept}"
                panels.append(Panel(f"{title}\n{np.mean(below[covered > 0.5]):.1%} negative", pixels))
    if output:
        write_picture(output, montage(panels, columns=len(KINDS)))


if __name__ == "__main__":
    main(**options(__doc__, "output", "meshes", "maps", "quick"))
