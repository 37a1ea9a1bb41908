"""What bands leave of gloss, against every ray tried on every triangle.

    .venv/bin/python -m experiments.gloss.brute_force --output docs/results/gloss_brute_force.json

The rows `bands` of `experiments.gloss.run` on few vertices of one small body, whole lobe x visibility x map by the
brute-force tracer in JAX in place of Embree. `apart` is how far the radiance by Embree's rays is from it, relative rms,
and `rays_apart` the share of rays that the two answer differently: they graze an edge.
"""

from pathlib import Path

import numpy as np

from benchmarks.options import options, saved
from experiments.gloss.dense import choose_vertices, dense_rays, only
from experiments.gloss.run import ANGLES, BAKED, BANDS, SEED, cut_to_bands, relative, whole_radiance
from gash_jax.light.environment import project_map
from gash_jax.light.studio import studio_light
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.primitives import bumpy_sphere

RESOLUTION, VERTICES, RAYS = 10, 40, 4096


def main(output: Path | None, quick: bool) -> dict:
    mesh, image = bumpy_sphere(4 if quick else RESOLUTION), studio_light(256)
    count, rays = (5, 256) if quick else (VERTICES, RAYS)
    chosen, light = choose_vertices(mesh, count, SEED), project_map(image, 10)
    fine = bake_transfer(only(mesh, chosen), max(BANDS), min(rays, BAKED), glossy=True)
    blocks = {backend: list(dense_rays(mesh, chosen, rays, SEED, backend)) for backend in ("jax", "embree")}
    rows = []
    for angle in ANGLES:
        normals = mesh.normals[chosen].astype(np.float64)
        brute, embree = (whole_radiance(iter(found), image, normals, angle) for found in blocks.values())
        for row in cut_to_bands(brute, fine, light, chosen, angle):
            rows.append({**row, "apart": relative(embree[row["lobe"]].value, brute[row["lobe"]].value)})
    unlike = np.mean([a.free != b.free for a, b in zip(*blocks.values(), strict=True)])
    sizes = {"faces": len(mesh.faces), "vertices": count, "rays": rays, "seed": SEED}
    return saved(output, provenance(**sizes, rays_apart=float(unlike), rows=rows))


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
