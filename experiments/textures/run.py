"""Error under light against bytes: transfer at vertices, at subdivided vertices, in textures, on low-poly meshes.

    .venv/bin/python -m experiments.textures.run --meshes FOLDER --output docs/results/textures.json

needs xatlas, and with --meshes fast-simplification. The reference is the transfer of points drawn evenly from the
surface, with many rays each; a representation is looked up at these points as a renderer would. Radiance is that under
the studio light from four sides. Textures are looked up before seams were made equal as well, and the difference
between both sides of seams is measured at `DENSE` points a texel before and after. Bytes are what a renderer holds:
positions and normals in float32, indices in int32, texture coordinates in float32, coefficients in float16. The figure
stands beside the results.
"""

from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
from matplotlib.figure import Figure

from benchmarks.options import options, saved
from experiments.textures.scenes import SEED, scenes
from gash_jax.geometry.bilinear import lookup
from gash_jax.geometry.mesh import Mesh, face_areas, normalized, subdivide_midpoint
from gash_jax.geometry.seams import equal_on_seams, seam_jumps, seam_rows
from gash_jax.light.environment import project_light
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.measure.metrics import relrmse
from gash_jax.measure.provenance import provenance
from gash_jax.prt import texture_bake
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.texture import TransferTexture

BANDS, RAYS, REFERENCE_RAYS, POINTS = 3, 512, 4096, 8000
SIZES, MOST_VERTICES = (32, 64, 128, 256, 512), 20000
SIDES, DENSE = 4, 8


class Places(NamedTuple):
    """Points on the surface."""

    face: np.ndarray
    barycentric: np.ndarray  # (p, 3)


def places_on(mesh: Mesh, count: int) -> Places:
    """Points drawn evenly from the area of a mesh."""
    random = np.random.default_rng(SEED)
    areas = face_areas(mesh.vertices, mesh.faces)
    face = random.choice(len(areas), count, p=areas / areas.sum())
    root, along = np.sqrt(random.random(count)), random.random(count)
    return Places(face, np.stack([1 - root, root * (1 - along), root * along], axis=1))


def at_places(values: np.ndarray, faces: np.ndarray, places: Places) -> np.ndarray:
    """Values of vertices, interpolated at places."""
    return np.einsum("pi,pik->pk", places.barycentric, values[faces[places.face]].astype(np.float64))


def in_children(places: Places) -> Places:
    """The same places on the faces of `subdivide_midpoint`: children 4 f .. 4 f + 3 at corners a, b, c and between."""
    a, b, c = places.barycentric.T
    choices = [(2 * a - 1, 2 * b, 2 * c), (2 * a, 2 * b - 1, 2 * c), (2 * a, 2 * b, 2 * c - 1)]
    choices.append((1 - 2 * c, 1 - 2 * a, 1 - 2 * b))
    child = np.select([a >= 0.5, b >= 0.5, c >= 0.5], [0, 1, 2], 3)
    barycentric = np.stack([np.stack(choice, axis=1) for choice in choices])[child, np.arange(len(a))]
    return Places(4 * places.face + child, barycentric)


def radiance_error(found: np.ndarray, reference: np.ndarray) -> float | None:
    """Relrmse of radiance under the studio light from four sides."""
    light = studio_light()
    turned = [np.roll(light, side * light.shape[1] // SIDES, axis=1) for side in range(SIDES)]
    lights = [project_light(image, BANDS) for image in turned]
    both = [np.stack([np.asarray(shade(t.astype(np.float32), one)) for one in lights]) for t in (found, reference)]
    return relrmse(*(radiance.reshape(-1, 3) for radiance in both))


def mesh_bytes(mesh: Mesh) -> int:
    """Positions, normals and indices."""
    return 24 * len(mesh.vertices) + 12 * len(mesh.faces)


def baked_texture(mesh: Mesh, rays: int, size: int) -> tuple[TransferTexture, np.ndarray]:
    """A texture, and its coefficients before seams were made equal."""
    kept: list[np.ndarray] = []

    def keeping(values: np.ndarray, *others: Any) -> np.ndarray:
        kept.append(values.reshape(size, size, -1))
        return equal_on_seams(values, *others)

    with patch.object(texture_bake, "equal_on_seams", keeping):
        texture = texture_bake.bake_texture(mesh, BANDS, rays, size=size, uv="atlas", seed=SEED)
    return texture, kept[0]


def seam_jump(mesh: Mesh, uv: np.ndarray, image: np.ndarray) -> float:
    """RMS difference of lookups on both sides of seams, relative to the RMS coefficient at texels that are not 0."""
    size = len(image)
    rows = seam_rows(mesh, uv, size, per_texel=DENSE)
    values = image.reshape(size**2, -1).astype(np.float64)
    jumps = seam_jumps(values, rows)
    return float(np.sqrt(np.mean(jumps**2) / np.mean(values[np.any(values != 0, axis=1)] ** 2))) if len(jumps) else 0.0


def rows_of(name: str, mesh: Mesh, quick: bool) -> list[dict[str, Any]]:
    """Every representation of one mesh."""
    sizes, rays, many, count = (SIZES[:2], 16, 64, 500) if quick else (SIZES, RAYS, REFERENCE_RAYS, POINTS)
    places = places_on(mesh, count)
    points = at_places(mesh.vertices, mesh.faces, places)
    normals = normalized(at_places(mesh.normals, mesh.faces, places))
    reference = bake_transfer(mesh, BANDS, many, points=points, normals=normals, seed=SEED + 1).coefficients
    rows = []

    def add(way: str, detail: int, bytes_: int, samples: int, found: np.ndarray, **more: Any) -> None:
        errors = {"transfer": relrmse(found, reference), "radiance": radiance_error(found, reference)}
        rows.append({"mesh": name, "way": way, "detail": detail, "bytes": bytes_, "samples": samples, **errors, **more})
        print(rows[-1], flush=True)

    fine, at, level = mesh, places, 0
    while len(fine.vertices) <= (200 if quick else MOST_VERTICES) or level < 2:
        values = bake_transfer(fine, BANDS, rays, seed=SEED).coefficients.astype(np.float16)
        count_bytes = mesh_bytes(fine) + values.nbytes
        add("vertices", level, count_bytes, len(fine.vertices), at_places(values, fine.faces, at))
        fine, at, level = subdivide_midpoint(fine), in_children(at), level + 1
    for size in sizes:
        texture, before = baked_texture(mesh, rays, size)
        uv = np.einsum("pi,pij->pj", places.barycentric, texture.uv[places.face])
        count_bytes = mesh_bytes(mesh) + texture.texture.nbytes + texture.uv.nbytes
        more = {
            "radiance_before": radiance_error(lookup(before, uv), reference),
            "seam_jump_before": seam_jump(mesh, texture.uv, before),
            "seam_jump": seam_jump(mesh, texture.uv, texture.texture),
        }
        samples = int(np.count_nonzero(texture.coverage))
        add("texture", size, count_bytes, samples, lookup(texture.texture, uv), **more)
    return rows


def main(meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    rows, about = [], {}
    for name, mesh in scenes(meshes).items():
        about[name] = {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
        rows += rows_of(name, mesh, quick)
    settings = {"bands": BANDS, "rays": RAYS, "reference_rays": REFERENCE_RAYS, "points": POINTS}
    if output:
        plot(rows, output.with_suffix(".png"))
    return saved(output, {**provenance(seed=SEED, arguments=settings), "meshes": about, "rows": rows})


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Error of radiance against bytes, a plot for each mesh."""
    names = list(dict.fromkeys(row["mesh"] for row in rows))
    figure = Figure(figsize=(3.7 * len(names), 3.6), layout="constrained")
    for axes, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        for way, label in (("vertices", "vertices, then subdivided"), ("texture", "texture")):
            own = [row for row in rows if (row["mesh"], row["way"]) == (name, way)]
            axes.plot([row["bytes"] for row in own], [row["radiance"] for row in own], marker="o", label=label)
            for row in own:
                text = f"{row['detail']}²" if way == "texture" else f"{row['samples']} v"
                axes.annotate(text, (row["bytes"], row["radiance"]), (3, 4), textcoords="offset points", fontsize=7)
        axes.set(xscale="log", yscale="log", xlabel="bytes", title=name)
        axes.grid(alpha=0.3)
    figure.axes[0].set_ylabel("radiance, relrmse")
    figure.axes[0].legend(fontsize=8)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(**options(__doc__, "meshes", "output", "quick"))
