"""Geometry images: what the vertices of a mesh hold as an image of n x n texels, and back (Gu, Gortler & Hoppe 2002).

Texel (row, column) is the point (u, v) = (column, row) / (n - 1) of the square: the outermost texels lie on its border,
so that both sides of a seam are sampled where they meet. A texel's value is that of the face it lies on, interpolated
by barycentric coordinates; a texel of a filled hole takes that of the cone over the hole's rim. A vertex takes its
value back from the four texels around it, bilinearly. Of the copies that a seam made of it one is chosen, that with the
largest area of faces around it in the square; vertices at one position share it. So both sides of a seam get one value.
Vertices without a face get 0.

Both ways are gathers of fixed width: linear in the values, differentiable, for NumPy arrays and, under `jit`, JAX's.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.algebra.arguments import WholeNumber, whole_number
from gash_jax.geometry.mesh import MeshError
from gash_jax.geometry.parameterisation import SquareMap
from gash_jax.geometry.stretch import signed_areas

MOST_TEXELS = 4096  # along a side


class GeometryImage(NamedTuple):
    """How a mesh of v vertices and images of n x n texels exchange values. Values of vertices are (v, c)."""

    face: Int[np.ndarray, "n n"]  # of the mesh; -1 in a filled hole
    corners: Int[np.ndarray, "n n 3"]  # vertices of the mesh; from v on, means of several
    barycentric: Float[np.ndarray, "n n 3"]  # float32
    members: Int[np.ndarray, "e w"]  # which vertices each mean is of
    shares: Float[np.ndarray, "e w"]  # float32, of which rows sum to 1
    texels: Int[np.ndarray, "v 4"]  # around each vertex, row by row
    bilinear: Float[np.ndarray, "v 4"]  # float32; 0 for a vertex without a face

    def to_image(self, values: Any) -> Any:
        """Values of all vertices, (v, c), as an image (n, n, c). Raises ValueError for another shape."""
        if values.ndim != 2 or len(values) != len(self.texels):
            raise ValueError(f"values have shape {values.shape}: give ({len(self.texels)}, c), a row for each vertex")
        xp = _numpy_of(values)
        means = (xp.asarray(self.shares)[..., None] * values[self.members]).sum(axis=1)
        every = xp.concatenate([values, means])
        return sum(xp.asarray(self.barycentric[..., i, None]) * every[self.corners[..., i]] for i in range(3))

    def from_image(self, image: Any) -> Any:
        """Values of all vertices, (v, c), from an image (n, n, c). Raises ValueError for another shape."""
        size = len(self.face)
        if image.ndim != 3 or image.shape[:2] != (size, size):
            raise ValueError(f"the image has shape {image.shape}: give ({size}, {size}, c)")
        flat = image.reshape(-1, image.shape[-1])
        return (_numpy_of(image).asarray(self.bilinear)[..., None] * flat[self.texels]).sum(axis=1)


def geometry_image(square: SquareMap, size: WholeNumber) -> GeometryImage:
    """The image of `size` x `size` texels that a mesh has by its map. Raises ValueError for a size that is none."""
    size = whole_number(size, "size", 2, MOST_TEXELS)
    faces, disk = square.disk.faces, square.disk
    face, barycentric = locate(square.uv, faces, size)
    lift = disk.lift
    own = np.diff(lift.indptr) == 1
    column = disk.vertices + np.cumsum(~own) - 1
    column[own] = lift.indices[lift.indptr[:-1][own]]
    members, shares = _padded(lift[~own])
    texels, bilinear = _around_vertices(square, size)
    return GeometryImage(
        face=disk.face_of[face],
        corners=column[faces[face]].astype(np.int32),
        barycentric=barycentric.astype(np.float32),
        members=members,
        shares=shares,
        texels=texels,
        bilinear=bilinear,
    )


def locate(
    uv: Float[np.ndarray, "m 2"], faces: Int[np.ndarray, "f 3"], size: int
) -> tuple[Int[np.ndarray, "n n"], Float[np.ndarray, "n n 3"]]:
    """The face that each texel lies on, and its barycentric coordinates there; on an edge, one of both faces.

    `faces` are counter-clockwise and cover the unit square. Every face is asked about the texels in its box, and a
    texel takes the face whose smallest coordinate for it is largest.
    """
    grid = uv * (size - 1)
    corners = grid[faces]
    slack = 1e-6  # of a texel: what rounding may move an edge by
    low = np.clip(np.ceil(corners.min(axis=1) - slack), 0, size - 1).astype(np.int64)
    high = np.clip(np.floor(corners.max(axis=1) + slack), 0, size - 1).astype(np.int64)
    columns, rows = np.maximum(high - low + 1, 0).T
    count = columns * rows
    which = np.repeat(np.arange(len(faces)), count)
    place = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count)
    down, right = np.divmod(place, columns[which])
    at = low[which] + np.stack([right, down], axis=1)
    weights = _barycentric(at.astype(np.float64), corners[which])
    least = weights.min(axis=1)
    texel = at[:, 1] * size + at[:, 0]
    order = np.lexsort((least, texel))
    last = np.flatnonzero(np.diff(texel[order], append=-1))
    if len(last) != size * size or least[order[last]].min() < -1e-6:
        raise MeshError("the map of the mesh does not cover the square: a face of it is flipped or missing")
    best = order[last]
    inside = np.maximum(weights[best], 0)
    inside /= inside.sum(axis=1, keepdims=True)
    return which[best].reshape(size, size), inside.reshape(size, size, 3)


def _barycentric(points: Float[np.ndarray, "n 2"], corners: Float[np.ndarray, "n 3 2"]) -> Float[np.ndarray, "n 3"]:
    a, b, c = corners.transpose(1, 0, 2)
    areas = [_cross(q - points, r - points) for q, r in ((b, c), (c, a), (a, b))]
    return np.stack(areas, axis=1) / _cross(b - a, c - a)[:, None]


def _cross(u: Float[np.ndarray, "n 2"], w: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
    return u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]


def _padded(lift: Any) -> tuple[Int[np.ndarray, "e w"], Float[np.ndarray, "e w"]]:
    """Rows of a sparse matrix as columns and weights of one width, filled up with 0."""
    lengths = np.diff(lift.indptr)
    inside = np.arange(lengths.max(initial=1)) < lengths[:, None]
    members, shares = np.zeros(inside.shape, np.int32), np.zeros(inside.shape, np.float32)
    members[inside], shares[inside] = lift.indices, lift.data
    return members, shares


def _around_vertices(square: SquareMap, size: int) -> tuple[Int[np.ndarray, "v 4"], Float[np.ndarray, "v 4"]]:
    """The four texels around each vertex of the mesh, and their bilinear weights (module docstring)."""
    disk, faces = square.disk, square.disk.faces
    around = np.bincount(faces.ravel(), np.repeat(signed_areas(square.uv, faces), 3), len(square.uv))
    rows = np.flatnonzero(~disk.made)
    entries = disk.lift[rows].tocoo()
    order = np.argsort(around[rows[entries.row]], kind="stable")
    chosen = np.full(disk.vertices, -1)
    chosen[entries.col[order]] = rows[entries.row[order]]  # the largest comes last and stays
    grid = square.uv[chosen] * (size - 1)
    first = np.clip(np.floor(grid), 0, size - 2).astype(np.int32)
    (column, row), (right, down) = first.T, (grid - first).T
    corner = row * size + column
    texels = np.stack([corner, corner + 1, corner + size, corner + size + 1], axis=1)
    weights = np.stack([(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down], axis=1)
    return texels, (weights * (chosen >= 0)[:, None]).astype(np.float32)


def _numpy_of(array: Any) -> Any:
    """NumPy for its arrays, jax.numpy for JAX's, which is not imported for the former."""
    if isinstance(array, np.ndarray):
        return np
    import jax.numpy

    return jax.numpy
