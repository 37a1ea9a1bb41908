"""What a texture takes to bake, before anyone pays for it: texels, rays, seconds and bytes.

Texels are laid out as for the bake itself, so their number is exact. At most `SAMPLE` of them are baked against the
whole scene, twice: the first time pays for compilation, the second is timed, and all texels take in proportion.
"""

import operator
import time
from typing import Any, NamedTuple

import numpy as np

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.bake import bake_transfer, choose_replicates
from gash_jax.prt.plan import SAMPLE
from gash_jax.prt.texture_bake import Layout, chosen_coordinates, lay_out, texel_points


class TexturePlan(NamedTuple):
    """What baking a texture is expected to take."""

    bands: int
    size: int
    uv: str  # "own" or "atlas"
    texels: int  # that are baked
    rays_per_texel: int
    rays_total: int
    seconds: float
    bytes: int

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return self._asdict()


def plan_texture(
    mesh: MeshLike,
    size: WholeNumber = 512,
    rays: WholeNumber = 256,
    *,
    bands: WholeNumber = 3,
    uv: Any = None,
    seed: WholeNumber = 0,
) -> TexturePlan:
    """Plan a bake of `size` x `size` texels, with `rays` rays a texel; `uv` and what is raised as `bake_texture`."""
    surface, bands, seed = as_mesh(mesh), validate_bands(bands), whole_number(seed, "seed", 0)
    errors, rays = 1 + (choose_replicates(rays, None) > 1), operator.index(rays)
    started = time.perf_counter()
    layout = lay_out(surface, size, chosen_coordinates(mesh, uv))
    laid_out = time.perf_counter() - started
    count = len(layout.texels.texel)
    chosen = np.sort(np.random.default_rng(seed).permutation(count)[:SAMPLE])
    first, then = (_seconds(surface, layout, chosen, bands, rays) for _ in range(2))
    tracing = first["trace"] - then["trace"] + then["trace"] * count / max(len(chosen), 1)
    return TexturePlan(
        bands=bands,
        size=layout.size,
        uv=layout.source,
        texels=count,
        rays_per_texel=rays,
        rays_total=rays * count,
        seconds=laid_out + first["build"] + max(tracing, 0.0),
        bytes=texture_bytes(surface, layout, errors * bands**2),
    )


def texture_bytes(mesh: Mesh, layout: Layout, values: int) -> int:
    """Size of a texture file with so many float16 a texel, but for a few kilobytes of metadata."""
    return layout.size**2 * (2 * values + 1) + 36 * len(mesh.faces) + 24 * len(mesh.vertices)


def _seconds(mesh: Mesh, layout: Layout, chosen: np.ndarray, bands: int, rays: int) -> dict[str, float]:
    points, normals = texel_points(mesh, layout.texels, chosen)
    return bake_transfer(mesh, bands, rays, points=points, normals=normals).metadata["seconds"]
