"""Three lights and a moving object: what a viewer would see of each variant.

    .venv/bin/python -m experiments.neural_gash.scene [--lights FOLDER] --output FILE.json

The scene is generated: a plate with three bodies on it, one of which moves past the others. Every frame is predicted
anew and held against its bake. Lights as in the GNN paper, 4.4.1: dark, normal, bright; environment maps of a folder,
or without one the generated studio: of low contrast, as it is, and with its key light ten times as strong.
"""

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.options import parser, saved
from experiments.neural_gash.evaluate import is_shown, load_models
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.apps.pictures.views import cast_view, shade_view
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, RawMesh
from gash_jax.light.environment import load_light, project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.measure import metrics
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.procedural import make_shape
from gash_jax.shapes.triangles import join, moved

MAPS = {"dark": "grace_256.hdr", "normal": "uffizi_256.hdr", "bright": "venice_sunset_1k.hdr"}
BODIES = ((12, 2), (12, 6), (12, 3))
FRAMES = 12


def _surface(seed: int, index: int, size: int) -> RawMesh:
    mesh = make_shape(seed, index, (size, size + 1))[1]
    extent = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    low = mesh.vertices.min(axis=0).astype(np.float64)
    middle = low + np.ptp(mesh.vertices, axis=0) / 2
    lifted = mesh.vertices - [middle[0], low[1], middle[2]]
    return RawMesh(lifted / extent, mesh.faces.astype(np.int64))


def frames(count: int, size: int) -> list[Mesh]:
    """The scene in time: bodies 0 and 1 stand, body 2 moves between and past them; vertex order never changes."""
    n = max(8, round((size / 2) ** 0.5))
    grid = np.linspace(-1.2, 1.2, n)
    x, z = np.meshgrid(grid, grid, indexing="ij")
    flat = np.stack([x.ravel(), np.zeros(n * n), z.ravel()], -1)
    a = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
    plate = RawMesh(flat, np.concatenate([np.stack([a, a + 1, a + n], -1), np.stack([a + 1, a + n + 1, a + n], -1)]))
    bodies = [_surface(*body, size) for body in BODIES]
    found = []
    for t in np.linspace(-0.9, 0.9, count):
        parts = [plate, moved(bodies[0], offset=(-0.45, 0.01, 0.1)), moved(bodies[1], offset=(0.45, 0.01, -0.1))]
        scene = join([*parts, moved(bodies[2], offset=(0.1 * np.sin(3 * t), 0.01, t))])
        found.append(prepare_mesh(scene.vertices.astype(np.float32), scene.faces.astype(np.int32))[0])
    return found


def scene_lights(folder: Path | None) -> dict[str, np.ndarray]:
    """SH lights by name, each scaled to the same mean radiance."""
    if folder:
        found = {name: np.asarray(load_light(folder / file, 3).coefficients) for name, file in MAPS.items()}
    else:
        studio = studio_light()
        bright = np.where(studio > np.quantile(studio, 0.98), 10 * studio, studio)
        found = {"dark": project_map(np.sqrt(studio), 3), "normal": project_map(studio, 3)}
        found |= {"bright": project_map(bright, 3)}
    return {name: np.asarray(light) / np.asarray(light)[0].mean() for name, light in found.items()}


def main(runs: Path, lights: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    meshes = frames(4 if quick else FRAMES, 150 if quick else 2500)
    references = np.stack([bake_transfer(mesh, rays=64 if quick else 4096).coefficients for mesh in meshes])
    methods: dict[str, Any] = {"closed form": lambda mesh: np.asarray(unshadowed_transfer(mesh.normals, 3))}
    shown = {name: model for name, model in load_models(runs).items() if is_shown(name)}
    methods |= {name: lambda mesh, m=model: m.predict(mesh).coefficients for name, model in shown.items()}
    methods["plain bake, 16 rays"] = lambda mesh: bake_transfer(mesh, rays=16, replicates=1).coefficients
    maps, hit, rows = scene_lights(lights), cast_view(meshes[0], "front", 64 if quick else 256), {}
    for name, predict in methods.items():
        estimates = np.stack([predict(mesh) for mesh in meshes])
        flat = (-1, estimates.shape[-1])
        normals = np.concatenate([mesh.normals for mesh in meshes])
        row: dict[str, Any] = {
            "skill": metrics.skill(estimates.reshape(flat), references.reshape(flat), normals),
            "flicker": metrics.flicker(estimates, references),
        }
        for light_name, light in maps.items():
            pictures = [shade_view(hit, np.asarray(shade(c, light)))[0] for c in (estimates[0], references[0])]
            row[light_name] = metrics.image_scores(*pictures)
        rows[name] = row
        print(name, {key: value if isinstance(value, dict) else round(value, 4) for key, value in row.items()})
    arguments = {"frames": len(meshes), "lights": "maps" if lights else "generated"}
    return saved(output, {**provenance(seed=0, arguments=arguments), "vertices": len(meshes[0].vertices), "rows": rows})


if __name__ == "__main__":
    command = parser(__doc__, "runs", "output", "quick")
    command.add_argument("--lights", type=Path, metavar="FOLDER", help="with environment maps; else generated ones")
    main(**vars(command.parse_args()))
