"""Meshes drawn again from their images, as in figure 4 of the DeepPRT paper: harmonic and less stretched maps."""

from pathlib import Path

import numpy as np

from gash_jax.apps.pictures.montage import Panel, montage, write_picture
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb
from gash_jax.geometry.geometry_image import geometry_image
from gash_jax.geometry.mesh import angle_weighted_normals
from gash_jax.geometry.parameterisation import SquareMap
from gash_jax.light.environment import project_map
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.prt.transfer import Transfer

BACKWARDS = ("Spot",)  # its face is towards -z
PIXELS = 300


def draw_reconstructions(
    drawn: dict[tuple[str, str], tuple[Transfer, SquareMap]], sizes: tuple[int, ...], path: Path
) -> None:
    """One row a mesh and map: the mesh, then positions and transfer as images of each size give them back."""
    panels, columns = [], 1 + len(sizes)
    for (name, method), (transfer, square) in drawn.items():
        view, studio = "front", studio_light()
        if name in BACKWARDS:  # the camera and the light both go half around it
            view, studio = "back", np.roll(studio, studio.shape[1] // 2, axis=1)
        light, mesh = project_map(studio, round(transfer.coefficients.shape[1] ** 0.5)), transfer.mesh
        views, labels = [shade_view(cast_view(mesh, view, PIXELS), np.asarray(shade(transfer, light)))], [name]
        for size in sizes:
            image = geometry_image(square, size)
            points, coefficients = (
                image.from_image(image.to_image(values)) for values in (mesh.vertices, transfer.coefficients)
            )
            normals = angle_weighted_normals(points, mesh.faces).astype(np.float32)
            again = mesh._replace(vertices=points, normals=normals)
            views.append(shade_view(cast_view(again, view, PIXELS), np.asarray(shade(coefficients, light))))
            labels.append(f"{'less stretch' if method == 'stretch' else method}, {size} x {size}")
        exposure = exposure_for(views[:1])
        panels += [
            Panel(label, to_srgb(*drawn_view, exposure)) for drawn_view, label in zip(views, labels, strict=True)
        ]
    write_picture(path, montage(panels, columns))
