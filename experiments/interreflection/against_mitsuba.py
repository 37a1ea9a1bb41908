"""Light that bounces, against Mitsuba 3's path tracer from the same vertices.

    .venv/bin/python -m experiments.interreflection.against_mitsuba [MESH...] --output FILE.json

Needs the extra `peers`. On five generated bodies of 10000 vertices and more, and on the meshes given as they are and
with every face cut into four, 2000 vertices send cosine-weighted rays into Mitsuba's scene: same origins, smooth
normals, diffuse albedo .6, as many bounces, no Russian roulette. Lights are maps Y_k + c of the first nine harmonics,
three at once as colours, and a constant one: what arrives is linear in the light, so c is subtracted again.

`difference` is the rms difference over the rms of the coefficients. Both sides are run twice, with independent rays:
the mean of the product of the two differences has no noise in it, unlike that of their squares (`with noise`).
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import parser, saved
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry.mesh import Mesh, subdivide_midpoint
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import trace_geometry
from gash_jax.shapes.procedural import make_shape

ALBEDO, BOUNCES, VERTICES, HEIGHT, SHIFT = 0.6, 3, 2000, 128, 0.7
RENDERED, BAKED = 2048, 1024


def mitsuba_scene(mi: Any, mesh: Mesh, lights: np.ndarray) -> Any:
    """A diffuse mesh in trace space under three maps (h, w, 3)."""
    geometry, properties = trace_geometry(mesh), mi.Properties()
    properties["bsdf"] = mi.load_dict({"type": "diffuse", "reflectance": {"type": "rgb", "value": [ALBEDO] * 3}})
    surface = mi.Mesh("mesh", len(mesh.vertices), len(mesh.faces), has_vertex_normals=True, props=properties)
    values = mi.traverse(surface)
    values["vertex_positions"], values["vertex_normals"] = geometry.vertices.ravel(), mesh.normals.ravel()
    values["faces"] = mesh.faces.astype(np.uint32).ravel()
    values.update()
    light = {"type": "envmap", "bitmap": mi.Bitmap(lights.astype(np.float32))}
    return mi.load_dict({"type": "scene", "mesh": surface, "light": light})


def map_directions() -> np.ndarray:
    """Directions (h, w, 3) of the pixels of a map as Mitsuba lays it out: +y up, -z at its left edge."""
    t = np.arange(HEIGHT)[:, None] / (HEIGHT - 1) * np.pi  # its first and last rows are the poles
    p = (np.arange(2 * HEIGHT) + 0.5)[None] / HEIGHT * np.pi
    return np.stack([np.sin(t) * np.sin(p), np.cos(t) + 0 * p, -np.sin(t) * np.cos(p)], axis=-1)


def path_traced(mi: Any, dr: Any, mesh: Mesh, chosen: np.ndarray, seed: int) -> np.ndarray:
    """Nine coefficients at some vertices by Mitsuba."""
    origins, count = trace_geometry(mesh).origins[chosen], len(chosen)
    harmonics = np.array(evaluate_sh(map_directions().reshape(-1, 3), 3)).reshape(HEIGHT, 2 * HEIGHT, 9)
    harmonics[..., 0] = 0.0  # the first of the maps is c alone
    integrator = mi.load_dict({"type": "path", "max_depth": BOUNCES + 1, "rr_depth": 1000})
    index = dr.arange(mi.UInt32, count * RENDERED) // RENDERED
    normal, origin = (
        [dr.gather(mi.Float, mi.Float(np.ascontiguousarray(axis)), index) for axis in array.T]
        for array in (mesh.normals[chosen], origins)
    )
    arriving = []
    for first in (0, 3, 6):
        scene = mitsuba_scene(mi, mesh, harmonics[..., first : first + 3] + SHIFT)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(10 * seed + first, count * RENDERED)
        local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d())
        ray = mi.RayDifferential3f(mi.Point3f(*origin), mi.Frame3f(mi.Normal3f(*normal)).to_world(local))
        radiance = integrator.sample(scene, sampler, ray)[0]
        arriving += [np.asarray(getattr(radiance, c)).reshape(count, RENDERED).mean(1, np.float64) for c in "xyz"]
    found = np.stack(arriving, axis=1)
    constant = found[:, 0] / SHIFT
    coefficients = found - found[:, :1]
    coefficients[:, 0] = constant / (2 * np.sqrt(np.pi))
    return coefficients


def compare(mi: Any, dr: Any, name: str, mesh: Mesh) -> dict[str, Any]:
    """One mesh: the relative difference of the coefficients, without noise and with it."""
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    chosen = np.sort(np.random.default_rng(0).permutation(active)[:VERTICES])
    options: dict[str, Any] = {"rays": BAKED, "albedo": ALBEDO, "bounces": BOUNCES}
    ours = [bake_transfer(mesh, **options, seed=s).coefficients[chosen].astype(np.float64) for s in (1, 2)]
    direct = bake_transfer(mesh, rays=BAKED, seed=3).coefficients[chosen]
    theirs = [path_traced(mi, dr, mesh, chosen, s) for s in (1, 2)]
    apart = [a - b for a, b in zip(ours, theirs, strict=True)]
    rms = np.sqrt(np.mean(ours[0] * ours[1]))
    clean = float(np.mean(apart[0] * apart[1]))
    row = {
        "mesh": name,
        "vertices": len(mesh.vertices),
        "bounced": float(np.sqrt(np.mean((ours[0] - direct) ** 2)) / rms),
        "difference": float(np.sign(clean) * np.sqrt(abs(clean)) / rms),
        "constant": float(np.mean(apart[0][:, 0] + apart[1][:, 0]) / np.mean(ours[0][:, 0] + ours[1][:, 0])),
        "with_noise": float(np.sqrt(np.mean(apart[0] ** 2)) / rms),
    }
    print(row, flush=True)
    return row


def main(meshes: list[Path], output: Path | None, quick: bool) -> dict:
    import drjit as dr  # pyright: ignore[reportMissingImports]
    import mitsuba as mi  # pyright: ignore[reportMissingImports]

    mi.set_variant("llvm_ad_rgb")
    rows = []
    for index in range(1 if quick else 5):
        kind, mesh = make_shape(17, index, (400, 500) if quick else (10000, 12000))
        rows.append(compare(mi, dr, kind, mesh))
    for path in meshes:
        mesh = load_mesh(path)
        rows += [
            compare(mi, dr, path.stem, mesh),
            compare(mi, dr, f"{path.stem}, cut into four", subdivide_midpoint(mesh)),
        ]
    sizes = {"albedo": ALBEDO, "bounces": BOUNCES, "mitsuba": mi.__version__, "sampled_vertices": VERTICES}
    return saved(output, provenance(seed=17, **sizes, rows=rows))


if __name__ == "__main__":
    command = parser(__doc__, "output", "quick")
    command.add_argument("meshes", type=Path, nargs="*")
    main(**vars(command.parse_args()))
