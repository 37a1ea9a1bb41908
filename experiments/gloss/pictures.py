"""What bands leave of gloss: `.venv/bin/python -m experiments.gloss.pictures --output docs/pictures/gloss.png`.

A generated mesh under the generated studio, seen from the front at one exposure a row: every vertex by dense rays with
the whole lobe, and shaded in 8, 6 and 4 bands. The rows are Phong's lobe of exponent 30 and GGX of roughness 0.5, whose
reference is the microfacets.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import options
from experiments.gloss.dense import dense_rays, integrate
from experiments.gloss.run import SEED, cut, facets, reflected_share, relative, whole_lobe
from gash_jax.apps.pictures.montage import montage, write_picture
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb, toward_camera
from gash_jax.light.brdf import ggx, phong
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.gloss import map_radiance, mirrored

BANDS, EXPONENT, ROUGHNESS = (8, 6, 4), 30.0, 0.5


def main(output: Path, quick: bool) -> None:
    mesh, rays, size = bumpy_sphere(10 if quick else 48), 256 if quick else 4096, 96 if quick else 320
    image = studio_light(256)
    light = project_map(image, max(BANDS))
    baked = bake_transfer(mesh, max(BANDS), min(rays, 1024), glossy=True)
    toward, normals = toward_camera(mesh).astype(np.float64), mesh.normals.astype(np.float64)
    # of what faces away from the camera nothing is drawn
    seen = np.flatnonzero(np.sum(toward * normals, axis=1) > 0.02)
    toward_seen, normals_seen = toward[seen], normals[seen]
    cosines = np.sum(toward_seen * normals_seen, axis=1)
    kernels = {
        "Phong, exponent 30": whole_lobe(mirrored(normals_seen, toward_seen), EXPONENT),
        "GGX, roughness 0.5": facets(normals_seen, toward_seen, ROUGHNESS**2),
    }
    lobes = {"Phong, exponent 30": phong(EXPONENT), "GGX, roughness 0.5": ggx(ROUGHNESS)}
    exact = integrate(dense_rays(mesh, seen, rays, SEED), lambda w: map_radiance(image, w), kernels)
    angles = np.linspace(0, 89, 60)
    share = [reflected_share(angle, ROUGHNESS**2) for angle in angles]
    white = np.interp(np.degrees(np.arccos(np.clip(cosines, 0, 1))), angles, share)[:, None]
    hit, panels = cast_view(mesh, "front", size), []
    for name, lobe in lobes.items():
        reference = np.zeros_like(toward)
        reference[seen] = exact[name].value / (white if name.startswith("GGX") else 1)
        shown = {f"{name}\nall bands, by dense rays": reference}
        for bands in BANDS:
            found = np.asarray(shade(cut(baked, bands), light, view=toward, lobe=lobe))
            error = relative(found[seen], reference[seen])
            shown[f"{bands} bands\nrelrmse {error:.2f}"] = found
        pictures = {caption: shade_view(hit, radiance) for caption, radiance in shown.items()}
        exposure = exposure_for([next(iter(pictures.values()))])
        panels += [(caption, to_srgb(*picture, exposure)) for caption, picture in pictures.items()]
    write_picture(output, montage(panels, columns=1 + len(BANDS)))


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
