"""Texture coordinates for meshes without: an atlas of charts that do not overlap, by xatlas.

https://github.com/jpcy/xatlas, through the Python package of the same name. It is an extra, as most bakes do without.
"""

import numpy as np
from jaxtyping import Float

from gash_jax.geometry.mesh import Mesh, MeshError
from gash_jax.geometry.normalised import NormalisedMesh

PADDING = 3  # texels between charts: a bilinear lookup reaches one beyond each, and one is to spare


def atlas_coordinates(mesh: Mesh, size: int) -> Float[np.ndarray, "f 3 2"]:
    """(u, v) of each corner of each face in an atlas for a texture of `size` x `size`; (0, 0) on faces without area.

    Raises MeshError where xatlas is not installed.
    """
    try:
        import xatlas  # type: ignore[import-not-found]
    except ImportError:
        raise MeshError(
            "texture coordinates for a mesh without are made by xatlas, which is not installed: pip install xatlas "
            "(or gash-jax[textures]), or unwrap the mesh in the program that made it"
        ) from None
    shape = NormalisedMesh(mesh)
    places = shape.positions(shape.half_diagonal)
    places[~shape.referenced] = 0.0  # they may lie anywhere
    atlas = xatlas.Atlas()
    atlas.add_mesh(places.astype(np.float32), mesh.faces.astype(np.uint32), mesh.normals)
    options = xatlas.PackOptions()
    options.resolution, options.padding, options.bilinear = size, PADDING, True
    atlas.generate(xatlas.ChartOptions(), options)
    _, corners, uv = atlas.get_mesh(0)
    sides = np.array([atlas.width, atlas.height])
    return (uv * sides / max(sides.max(), 1)).astype(np.float32)[corners]
