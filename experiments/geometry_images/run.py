"""What a geometry image loses: stretch, crowded faces, round trips of positions and of transfer by resolution.

    .venv/bin/python -m experiments.geometry_images.run --meshes FOLDER --output FILE.json

The figure stands beside the results. A round trip is from the vertices to the image and back. Meshes: one that the
project generates, and of --meshes the ICT face's skin and the cow Spot.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from matplotlib.figure import Figure

from benchmarks.options import options, saved
from experiments.geometry_images.pictures import draw_reconstructions
from gash_jax.formats.meshes import load_mesh
from gash_jax.geometry import parameterisation
from gash_jax.geometry.geometry_image import geometry_image
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.image_fit import image_fit
from gash_jax.geometry.mesh import Mesh, lengths
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.geometry.parameterisation import Method, SquareMap, parameterise
from gash_jax.geometry.stretch import signed_areas, total_stretch
from gash_jax.measure.metrics import relrmse
from gash_jax.measure.provenance import provenance
from gash_jax.prt.bake import bake_transfer
from gash_jax.shapes.organic import displaced

SHOWN = {"ict_face_skin": "ICT face", "spot": "Spot"}
METHODS: tuple[Method, ...] = ("harmonic", "stretch")
SIZES = (64, 128, 256, 512)
SEED, BANDS, RAYS = 0, 4, 1024
EVENNESSES = (0.0, 0.5, 0.75, 1.0)


def generated_body(size: int) -> Mesh:
    """A closed body with ridges."""
    surface = displaced(np.random.default_rng(SEED), size)
    return prepare_mesh(surface.vertices.astype(np.float32), surface.faces.astype(np.int32))[0]


def meshes_of(folder: Path | None, quick: bool) -> dict[str, Callable[[], Mesh]]:
    """Name and reader of every mesh that is measured."""
    size = 600 if quick else 6000
    found: dict[str, Callable[[], Mesh]] = {"generated": lambda: generated_body(size)}
    for stem, name in SHOWN.items():
        if folder is not None and (path := folder / f"{stem}.ply").exists():
            found[name] = lambda path=path: load_mesh(path)
    return found


def map_figures(square: SquareMap, seconds: float) -> dict[str, Any]:
    """What a map reports, whatever the resolution."""
    disk = square.disk
    own = disk.face_of >= 0
    return {
        **{"seconds": seconds, "stretch": total_stretch(square.uv, disk.points, disk.faces[own])},
        **{"weights": square.weights, "steps": square.steps, "seams": square.seams, "cut_edges": disk.cut_edges},
        **{"filled_loops": disk.filled_loops, "split_edges": square.split_edges, "flat_faces": square.flat_faces},
        "smallest_area": float(signed_areas(square.uv, disk.faces).min()),
    }


def size_figures(square: SquareMap, mesh: Mesh, transfer: np.ndarray, size: int) -> dict[str, Any]:
    """What an image of one size loses."""
    image, own = geometry_image(square, size), square.disk.face_of >= 0
    areas = signed_areas(square.uv, square.disk.faces)[own]
    back = image.from_image(image.to_image(mesh.vertices))
    fitted = image.from_image(image_fit(image)(transfer))
    error = lengths((back - mesh.vertices).astype(np.float64))[NormalisedMesh(mesh).referenced]
    error /= 2 * NormalisedMesh(mesh).half_diagonal
    return {
        **{"size": size, "below_a_texel": float((areas < 1 / (size - 1) ** 2).mean())},
        **{"positions_rms": float(np.sqrt(np.mean(error**2))), "positions_most": float(error.max())},
        "transfer_relrmse": relrmse(image.from_image(image.to_image(transfer)), transfer),
        "fitted_relrmse": relrmse(fitted, transfer),
    }


def evenness_figures(mesh: Mesh, transfer: np.ndarray, size: int) -> list[dict[str, Any]]:
    """The less stretched map at other weights of small faces, at one size."""
    found = []
    for evenness in EVENNESSES:
        with patch.object(parameterisation, "EVENNESS", evenness):
            found.append({"evenness": evenness, **size_figures(parameterise(mesh), mesh, transfer, size)})
    return found


def main(meshes: Path | None, output: Path | None, quick: bool) -> dict[str, Any]:
    rows, drawn = [], {}
    sizes, rays = (SIZES[:2], 64) if quick else (SIZES, RAYS)
    for name, read in meshes_of(meshes, quick).items():
        mesh = read()
        transfer = bake_transfer(mesh, BANDS, rays, seed=SEED)
        for method in METHODS:
            start = time.perf_counter()
            square = parameterise(mesh, method)
            figures = map_figures(square, time.perf_counter() - start)
            found = [size_figures(square, mesh, transfer.coefficients, size) for size in sizes]
            row = {"mesh": name, "vertices": len(mesh.vertices), "method": method, **figures, "sizes": found}
            if method == "stretch":
                row["evenness"] = evenness_figures(mesh, transfer.coefficients, sizes[-2])
            rows.append(row)
            drawn[name, method] = (transfer, square)
            last = {key: value for key, value in found[-1].items() if key != "size"}
            print(f"{name} {method}: stretch {figures['stretch']:.3f}, at {sizes[-1]} {last}", flush=True)
    results = {**provenance(seed=SEED, arguments={"bands": BANDS, "rays": rays}), "rows": rows}
    if output:
        plot_round_trips(rows, output.with_name("round_trip.png"))
        draw_reconstructions(drawn, sizes[:1] + sizes[2:3], output.with_name("reconstructions.png"))
    return saved(output, results)


def plot_round_trips(rows: list[dict[str, Any]], path: Path) -> None:
    """Faces below a texel, and errors of positions and transfer, against the resolution."""
    figure = Figure(figsize=(11, 3.8), layout="constrained")
    plots, sizes = figure.subplots(1, 3), [found["size"] for found in rows[0]["sizes"]]
    wanted = ("below_a_texel", "positions_rms", "transfer_relrmse")
    labels = ("share of faces below a texel", "positions, RMS error / box diagonal", "transfer, relrmse")
    colors = {name: f"C{number}" for number, name in enumerate(dict.fromkeys(row["mesh"] for row in rows))}
    for plot, key, label in zip(plots, wanted, labels, strict=True):
        for row in rows:
            style = "-" if row["method"] == "stretch" else "--"
            line = f"{row['mesh']}, {'less stretch' if row['method'] == 'stretch' else 'harmonic'}"
            values = [found[key] for found in row["sizes"]]
            plot.plot(sizes, values, style, marker="o", color=colors[row["mesh"]], label=line)
            if key == "transfer_relrmse" and row["method"] == "stretch":
                fitted = [found["fitted_relrmse"] for found in row["sizes"]]
                plots[0].plot([], [], ":", color=colors[row["mesh"]], label=f"{row['mesh']}, images fitted")
                plot.plot(sizes, fitted, ":", color=colors[row["mesh"]])
        plot.set(xscale="log", xlabel="texels along a side", ylabel=label, xticks=sizes, xticklabels=sizes)
        plot.set_yscale("linear" if key == "below_a_texel" else "log")
        plot.minorticks_off()
        plot.grid(alpha=0.3)
    figure.legend(*plots[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    main(**options(__doc__, "meshes", "output", "quick"))
