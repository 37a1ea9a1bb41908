"""Bake transfer into a texture: texels are points with normals, baked as `bake_transfer` bakes points.

A layout says which texels stand for which points of the surface (`geometry.texels`). Normals are those of the face's
corners, interpolated and made unit. The points are baked in groups of so many that memory stays bounded, each with
random numbers of its own; then both sides of seams are made equal (`geometry.seams`), and what no lookup reaches
repeats the nearest texel, so that filtered copies of the texture (mip maps) stay clean at the rims of charts.
"""

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import WholeNumber, as_array, shown, whole_number
from gash_jax.algebra.sh import validate_bands
from gash_jax.formats.meshes import MeshLike, as_mesh, texture_coordinates
from gash_jax.geometry.mesh import Mesh, MeshError, normalized
from gash_jax.geometry.seams import SeamRows, apart_rows, equal_on_seams, seam_jumps, seam_rows
from gash_jax.geometry.texels import Texels, find_texels
from gash_jax.geometry.texture_coordinates import ATLAS, FLAT, checked_coordinates, corner_areas
from gash_jax.geometry.topology import first_of_duplicates
from gash_jax.geometry.uv_atlas import atlas_coordinates
from gash_jax.prt.bake import bake_transfer, choose_replicates
from gash_jax.prt.texture import FILLED, MOST_TEXELS, ON_FACE, RIM, TransferTexture
from gash_jax.prt.tracing import ProgressFn
from gash_jax.prt.transfer import make_metadata

if TYPE_CHECKING:
    from jax import Array

    from gash_jax.algebra.arguments import ArrayLike

MOST_DOUBLED = 1e-3  # of the texels on faces: exporters let charts touch
_NUMBERS = 1 << 24  # that a group of texels may have in all replicates


class Layout(NamedTuple):
    """Which points of a mesh the texels of a texture stand for."""

    size: int
    uv: Float[np.ndarray, "f 3 2"]
    source: str  # "own" or "atlas"
    texels: Texels
    seams: SeamRows  # that can be made equal
    mixed: int  # points on seams where charts lie too close for that

    def lines(self, rays: int, values: int) -> list[str]:
        """For people, beforehand: texels, rays and bytes, with so many float16 a texel; and what is odd."""
        count, size = len(self.texels.texel), self.size
        lines = [
            f"texture {size} x {size}: {count} texels ({count / size**2:.0%}) x {rays} rays = "
            f"{count * rays / 1e6:.3g} M rays, {size**2 * (2 * values + 1) / 2**20:.3g} MiB beside the mesh"
        ]
        total = self.mixed + len(self.seams.texels)
        if self.mixed:
            lines.append(
                f"  at {self.mixed / total:.1%} of the points on seams charts lie less than two texels apart and mix: "
                "a larger texture, or charts further apart, would help"
            )
        flat = self.faces_without_area
        if flat:
            lines.append(f"  {flat} {'face has' if flat == 1 else 'faces have'} no area in the texture")
        if self.texels.doubled:
            lines.append(f"  {self.texels.doubled} texels lie on two faces: the first one counts")
        return lines

    @property
    def faces_without_area(self) -> int:
        """In the texture: they look up a line or a point of it."""
        return int(np.count_nonzero(np.abs(corner_areas(self.uv)) <= FLAT))

    def entries(self, jump: float) -> dict[str, Any]:
        """For metadata, with the largest difference between both sides of a seam."""
        inside = int(self.texels.inside.sum())
        return {
            **{"size": self.size, "uv": self.source, "texels_on_faces": inside},
            **{"texels_at_rims": len(self.texels.texel) - inside, "texels_on_two_faces": self.texels.doubled},
            "faces_without_area": self.faces_without_area,
            **{"points_on_seams": len(self.seams.texels), "largest_seam_jump": jump},
            "points_on_seams_mixed": self.mixed,
        }


def lay_out(mesh: Mesh, size: WholeNumber, uv: "ArrayLike | Array | str | None") -> Layout:
    """The layout of a mesh in a texture of `size` x `size`; `uv` is "atlas" or (f, 3, 2), of which None says none.

    Raises ValueError for a size that is none, MeshError for texture coordinates that cannot be used.
    """
    size = whole_number(size, "size", 1, MOST_TEXELS)
    if uv is None or isinstance(uv, str):
        source, found = "atlas", atlas_coordinates(mesh, size)
    else:
        source, found = "own", np.asarray(as_array(uv))
    coordinates = checked_coordinates(found, len(mesh.faces))
    alone = _without_copies(mesh, coordinates)
    texels = find_texels(coordinates[alone], size)
    texels = texels._replace(face=alone[texels.face])
    if source == "own" and texels.doubled > MOST_DOUBLED * np.count_nonzero(texels.inside):
        raise MeshError(
            f"{texels.doubled} of {np.count_nonzero(texels.inside)} texels on the mesh lie on two faces: its texture "
            f"coordinates overlap, as mirrored halves do; {ATLAS}"
        )
    rows = seam_rows(mesh, coordinates, size)
    chart = np.full(size * size, -1)
    chart[texels.texel] = rows.chart_of[texels.face]
    apart = apart_rows(rows, chart)
    return Layout(size, coordinates, source, texels, apart, len(rows.texels) - len(apart.texels))


def chosen_coordinates(source: MeshLike, uv: Any) -> Any:
    """What `lay_out` takes: for None a mesh's own texture coordinates, or those of an atlas where it has none.

    "own" insists. Raises MeshError.
    """
    if isinstance(uv, str) and uv not in ("own", "atlas"):
        raise MeshError(f"uv is {shown(uv)}: use 'own', 'atlas' or an array (f, 3, 2)")
    if uv is not None and not (isinstance(uv, str) and uv == "own"):
        return uv
    own = texture_coordinates(source)
    if own is None and uv == "own":
        raise MeshError(f"the mesh has no texture coordinates of its own: unwrap it, or {ATLAS}")
    return own


def bake_texture(
    mesh: MeshLike,
    bands: WholeNumber = 3,
    rays: WholeNumber = 256,
    *,
    size: WholeNumber = 512,
    uv: "ArrayLike | Array | Literal['own', 'atlas'] | None" = None,
    bounces: WholeNumber = 0,
    albedo: "ArrayLike | Array | None" = None,
    occluders: Sequence[MeshLike] = (),
    replicates: WholeNumber | None = None,
    seed: WholeNumber = 0,
    progress: ProgressFn | None = None,
) -> TransferTexture:
    """Bake shadowed diffuse transfer into a texture of `size` x `size` texels, with `rays` rays a texel.

    `uv` is (f, 3, 2), (u, v) of each corner of each face, u to the right and v downwards; "own" for those of the mesh
    (OBJ, glTF, PLY, trimesh); "atlas" for charts made by xatlas, which is an extra; None for its own, or else an atlas.
    Points on seams, at most one texel apart, get the same value from both sides. The other arguments are those of
    `bake_transfer`, the albedo that of the vertices. Raises ValueError for options out of range, MeshError for what is
    no mesh or has texture coordinates that cannot be used: none, of several tiles, overlapping.

    >>> square = ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> uv = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]])
    >>> texture = gash_jax.bake_texture(square, rays=16, size=8, uv=uv)
    >>> texture.texture.shape, texture.texture.dtype, texture.coverage.min()
    ((8, 8, 9), dtype('float16'), np.uint8(2))
    """
    surface, bands = as_mesh(mesh), validate_bands(bands)
    choose_replicates(rays, replicates)
    layout = lay_out(surface, size, chosen_coordinates(mesh, uv))
    options = {"bounces": bounces, "albedo": albedo, "occluders": occluders, "replicates": replicates, "seed": seed}
    return bake_layout(surface, layout, bands, int(rays), **options, progress=progress)


def bake_layout(
    mesh: Mesh,
    layout: Layout,
    bands: int,
    rays: int,
    *,
    seed: WholeNumber = 0,
    progress: ProgressFn | None,
    **options: Any,
) -> TransferTexture:
    """Bake the texels of a layout (`bake_texture`)."""
    started, seed = time.perf_counter(), whole_number(seed, "seed", 0)
    texels, count = layout.texels, len(layout.texels.texel)
    channels = (3,) if options["bounces"] and np.shape(options["albedo"])[-1:] == (3,) else ()
    texture = np.zeros((layout.size**2, bands**2, *channels), np.float16)
    replicates = choose_replicates(rays, options["replicates"])
    error = np.zeros_like(texture) if replicates > 1 else None
    group = max(_NUMBERS // (texture[0].size * replicates), 1)
    total, parameters = 0, {}
    for start in range(0, count, group):
        part = slice(start, min(start + group, count))
        points, normals = texel_points(mesh, texels, part)
        own = seed if not start else int(np.random.SeedSequence([seed, start]).generate_state(1)[0])
        update = _part_of(progress, part, count)
        baked = bake_transfer(mesh, bands, rays, points=points, normals=normals, seed=own, progress=update, **options)
        texture[texels.texel[part]] = baked.coefficients
        if error is not None and baked.standard_error is not None:
            error[texels.texel[part]] = baked.standard_error
        total, parameters = total + baked.metadata["rays_total"], baked.metadata["parameters"]
    coverage = np.full(layout.size**2, FILLED, np.uint8)
    coverage[texels.texel] = np.where(texels.inside, ON_FACE, RIM)
    flat = equal_on_seams(texture.reshape(len(texture), -1), layout.seams, coverage == ON_FACE)
    told = layout.entries(float(np.abs(seam_jumps(flat, layout.seams)).max(initial=0)))
    coverage = coverage.reshape(layout.size, layout.size)
    texture, error = (_filled(values, coverage) for values in (flat.reshape(texture.shape), error))
    seconds = {"total": time.perf_counter() - started}
    entries = {"texture": told, "rays_total": total, "seconds": seconds}
    metadata = make_metadata(bands, "bake texture", {**parameters, "seed": seed}, **entries)
    return TransferTexture(texture, error, coverage, layout.uv, *mesh, metadata)


def texel_points(
    mesh: Mesh, texels: Texels, part: slice | Int[np.ndarray, "t"]
) -> tuple[Float[np.ndarray, "t 3"], Float[np.ndarray, "t 3"]]:
    """Positions and unit normals of some of the texels; normal 0 where those of the corners cancel."""
    corners, weights = mesh.faces[texels.face[part]], texels.barycentric[part].astype(np.float64)
    points, normals = (np.einsum("ti,tij->tj", weights, array[corners]) for array in (mesh.vertices, mesh.normals))
    return points, normalized(np.where(np.abs(normals).max(axis=1, keepdims=True) > 1e-6, normals, 0.0))


def _part_of(progress: ProgressFn | None, part: slice, count: int) -> ProgressFn | None:
    """The progress of one of several groups."""
    size = part.stop - part.start
    return progress and (lambda done, total: progress(part.start + int(size * done / max(total, 1)), count))


def _filled(values: np.ndarray | None, coverage: np.ndarray) -> Any:
    """Values as an image, in which texels that were not baked repeat the nearest that were."""
    if values is None:
        return None
    from scipy.ndimage import distance_transform_edt  # slow to import, and only textures need it

    missing = coverage == FILLED
    image = values.reshape(*coverage.shape, *values.shape[1:])
    if missing.any():
        nearest: Any = distance_transform_edt(missing, return_distances=False, return_indices=True)
        image[missing] = image[tuple(nearest[:, missing])]
    return image


def _without_copies(mesh: Mesh, uv: Float[np.ndarray, "f 3 2"]) -> Int[np.ndarray, "g"]:
    """The faces but those that another covers with the same vertices and texture coordinates, as doubled sheets do."""
    first = first_of_duplicates(mesh.faces, len(mesh.vertices))
    order = np.argsort(mesh.faces, axis=1)[..., None]
    placed = np.take_along_axis(uv, order, axis=1)
    copies = (first != np.arange(len(first))) & np.all(placed == placed[first], axis=(1, 2))
    return np.flatnonzero(~copies)
