"""Light that bounces, against Mitsuba 3's path tracer from the same vertices.

    .venv/bin/python -m experiments.interreflection.against_mitsuba [MESH...] --output docs/results/against_mitsuba.json

Needs the extra `peers`, and LLVM (Debian's 14 and 15 abort; 19 works, named by DRJIT_LIBLLVM_PATH). On five generated
bodies in two sizes, and on the meshes given as they are and with every face cut into four, 2000 vertices send
cosine-weighted rays into Mitsuba's scene: same origins, smooth normals, diffuse albedo .6, as many bounces, no Russian
roulette. Lights are maps Y_k + c of the first nine harmonics, three at once as colours, and a constant one: what
arrives is linear in the light, so c is subtracted again, with the same random numbers.

`difference` is the rms difference over the rms of the coefficients. Both sides are run twice, with independent rays:
the mean of the product of the two differences has no noise in it, and may come out below zero (written as a negative
difference). Its scatter over the vertices gives the 95 % interval `low` to `high`; `with_noise` is the rms of one
difference as it is. `constant` is the difference under constant light, relative and signed.

*One rule differs.* To us a face has a front, and reflects whatever meets it there. Mitsuba's diffuse material is black
where the interpolated normal faces away from the ray, which near silhouettes happens on the fronts of coarse faces.
`black` says the same of a bake that leaves such hits out, as Mitsuba does: what is left then is no matter of rules.
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
from gash_jax.prt.bake_job import draw_shifts
from gash_jax.prt.bounces import Exchange, checked_albedo
from gash_jax.prt.integrands import direct
from gash_jax.prt.rays import Hits, RayQuery, trace_geometry
from gash_jax.prt.tracing import active_rows
from gash_jax.prt.visibility import ray_query
from gash_jax.shapes.procedural import make_shape

ALBEDO, BOUNCES, VERTICES, HEIGHT, SHIFT, REPLICATES = 0.6, 3, 2000, 128, 0.7, 4
RENDERED, BAKED = 512, 256
SIZES = ((10000, 12000), (40000, 48000))
# smooth normals turn by much within its faces, so that light does too, which transfer at corners does not follow
HARD_EDGED = ("plate",)


def black_behind(mesh: Mesh, query: RayQuery) -> RayQuery:
    """The query with hits whose interpolated normal faces away moved to a face beyond the last, which has no front."""

    def answer(origins: np.ndarray, directions: np.ndarray) -> Hits:
        hits = query(origins, directions)
        assert isinstance(hits, Hits)
        weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)
        normals = np.einsum("rj,rji->ri", weights, mesh.normals[mesh.faces[np.maximum(hits.face, 0)]])
        away = (hits.face >= 0) & (np.einsum("ri,ri->r", normals, directions) >= 0)
        return hits._replace(face=np.where(away, len(mesh.faces), hits.face).astype(hits.face.dtype))

    return answer


def baked_black(mesh: Mesh, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Nine coefficients of every vertex, of direct light and of bounced, with Mitsuba's rule of what is black.

    The rays are those of `bake_transfer`.
    """
    geometry, count = trace_geometry(mesh), len(mesh.vertices)
    surface = mesh._replace(faces=np.concatenate([mesh.faces, np.zeros((1, 3), np.int32)]))
    query = black_behind(mesh, ray_query(geometry.vertices, geometry.faces, "closest"))
    active, rows = active_rows(mesh, geometry, None, draw_shifts(seed, count, REPLICATES, 0, count))
    rays = Exchange(rows, direct(3), BAKED // REPLICATES, query, active=active, surface=surface)
    found = rays.first
    for _ in range(BOUNCES):
        found = rays.bounce(found, checked_albedo(ALBEDO, count))
    every = np.zeros((2, count, 9))
    every[:, active] = [light[..., 0].mean(1) for light in (rays.first, found)]
    return every[0], every[1]


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
    places = np.arange(RENDERED)[:, None] * [1 / RENDERED, (np.sqrt(5) - 1) / 2]  # a lattice, shifted for each vertex
    places = (places + np.random.default_rng([seed, 1]).random((count, 1, 2))).reshape(-1, 2) % 1
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
        sampler.seed(seed, count * RENDERED)
        local = mi.warp.square_to_cosine_hemisphere(mi.Point2f(*(mi.Float(axis) for axis in places.T)))
        ray = mi.RayDifferential3f(mi.Point3f(*origin), mi.Frame3f(mi.Normal3f(*normal)).to_world(local))
        radiance = integrator.sample(scene, sampler, ray)[0]
        arriving += [np.asarray(getattr(radiance, c)).reshape(count, RENDERED).mean(1, np.float64) for c in "xyz"]
    found = np.stack(arriving, axis=1)
    constant = found[:, 0] / SHIFT
    coefficients = found - found[:, :1]
    coefficients[:, 0] = constant / (2 * np.sqrt(np.pi))
    return coefficients


def apart(ours: list[np.ndarray], theirs: list[np.ndarray]) -> dict[str, float]:
    """How far two independent pairs of coefficients (v, 9) are apart (module docstring)."""
    first, second = (a - b for a, b in zip(ours, theirs, strict=True))
    power = np.mean(ours[0] * ours[1])
    each = np.mean(first * second, axis=1) / power
    clean, spread = each.mean(), 2 * each.std(ddof=1) / np.sqrt(len(each))
    found = {"difference": clean, "low": clean - spread, "high": clean + spread}
    return {
        **{name: float(np.sign(value) * np.sqrt(abs(value))) for name, value in found.items()},
        "constant": float(np.mean(first[:, 0] + second[:, 0]) / np.mean(ours[0][:, 0] + ours[1][:, 0])),
        "with_noise": float(np.sqrt(np.mean(first**2) / power)),
    }


def compare(mi: Any, dr: Any, name: str, mesh: Mesh) -> dict[str, Any]:
    """One mesh: what bounces are of the coefficients, and how far these are from Mitsuba's by either rule."""
    active = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    chosen = np.sort(np.random.default_rng(0).permutation(active)[:VERTICES])
    options: dict[str, Any] = {"rays": BAKED, "replicates": REPLICATES, "albedo": ALBEDO, "bounces": BOUNCES}
    ours = [bake_transfer(mesh, **options, seed=seed).coefficients[chosen].astype(np.float64) for seed in (1, 2)]
    first, black = (np.stack(light)[:, chosen] for light in zip(*(baked_black(mesh, s) for s in (1, 2)), strict=True))
    theirs = [path_traced(mi, dr, mesh, chosen, seed) for seed in (1, 2)]
    row = {
        "mesh": name,
        "vertices": len(mesh.vertices),
        "bounced": float(np.sqrt(np.mean((ours[0] - first[0]) ** 2) / np.mean(ours[0] * ours[1]))),
        **apart(ours, theirs),
        "black": apart(list(black), theirs),
    }
    print(row, flush=True)
    return row


def main(meshes: list[Path], output: Path | None, quick: bool) -> dict:
    import drjit as dr  # pyright: ignore[reportMissingImports]
    import mitsuba as mi  # pyright: ignore[reportMissingImports]

    mi.set_variant("llvm_ad_rgb")
    sizes = ((400, 500),) if quick else SIZES
    bodies = [make_shape(17, index, size) for index in range(1 if quick else 5) for size in sizes]
    for name, mesh in [body for body in bodies if body[0] in HARD_EDGED][:1]:
        bodies.append((f"{name}, cut into sixteen", subdivide_midpoint(subdivide_midpoint(mesh))))
    for path in meshes:
        mesh = load_mesh(path)
        bodies += [(path.stem, mesh), (f"{path.stem}, cut into four", subdivide_midpoint(mesh))]
    used = {"albedo": ALBEDO, "bounces": BOUNCES, "sampled_vertices": VERTICES, "rendered": RENDERED, "baked": BAKED}
    rows, result = [], {}
    for body in bodies:  # each takes minutes: what is there is kept
        rows.append(compare(mi, dr, *body))
        result = saved(output, provenance(seed=17, **used, mitsuba=mi.__version__, rows=rows))
    return result


if __name__ == "__main__":
    command = parser(__doc__, "output", "quick")
    command.add_argument("meshes", type=Path, nargs="*")
    main(**vars(command.parse_args()))
