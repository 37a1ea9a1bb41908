"""Triangle meshes as plain NumPy arrays, and what follows from them.

A mesh is (vertices, normals, faces): right-handed, +y up, faces counter-clockwise seen from outside. Vertex i
is vertex i of the file it came from; no function here merges or reorders vertices.

Vertices are float32, but everything is derived in float64 from differences of positions, so that meshes of size
1e-6 to 1e6, or far from the origin, lose no more than float32 storage took.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Num
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from gash_jax.algebra.arguments import proper_rotation

if TYPE_CHECKING:
    import trimesh


class MeshError(ValueError):
    """A mesh or mesh file that cannot be used; the message is one line that says what to do.

    >>> try:
    ...     gash_jax.load_mesh((np.zeros((3, 3)), np.array([[0, 1, 3]])))
    ... except gash_jax.MeshError as error:
    ...     print(error)
    1 of 1 faces name a vertex that does not exist (first: face 0 [0, 1, 3], the mesh has 3 vertices from 0): export ...
    """


class Mesh(NamedTuple):
    """A triangle mesh. A vertex without a usable normal has normal 0.

    >>> mesh = gash_jax.load_mesh("bunny.ply")
    >>> mesh.vertices.shape, mesh.normals.shape, mesh.faces.shape
    ((362, 3), (362, 3), (720, 3))
    """

    vertices: Float[np.ndarray, "v 3"]  # float32
    normals: Float[np.ndarray, "v 3"]  # float32, unit or 0
    faces: Int[np.ndarray, "f 3"]  # int32

    def to_trimesh(self) -> "trimesh.Trimesh":
        """The same vertices, normals and faces as a trimesh.Trimesh, nothing merged."""
        import trimesh  # slow to import, and a bake does without

        return trimesh.Trimesh(self.vertices, self.faces, vertex_normals=self.normals, process=False)


class RawMesh(NamedTuple):
    """A triangle surface that nobody has checked yet, as a file, a caller or a generator gave it.

    `geometry.health.prepare_mesh` makes a `Mesh` of its arrays.
    """

    vertices: Num[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Num[np.ndarray, "v 3"] | None = None  # not finite or 0 where a vertex has none
    notes: tuple[str, ...] = ()  # what reading had to decide
    colors: Num[np.ndarray, "v 3"] | None = None  # linear RGB
    uv: Num[np.ndarray, "f 3 2"] | None = None  # of the faces' corners, v downwards; not finite where one has none


def referenced(mesh: Mesh) -> Bool[np.ndarray, "v"]:
    """Which vertices belong to a face."""
    return referenced_by(mesh.faces, len(mesh.vertices))


def referenced_by(faces: Int[np.ndarray, "f 3"], vertex_count: int) -> Bool[np.ndarray, "v"]:
    """Which of `vertex_count` vertices belong to one of `faces`."""
    used = np.zeros(vertex_count, dtype=bool)
    used[faces] = True
    return used


def vector_areas(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Area times unit normal of each face, float64."""
    a, b, c = _corners(vertices, faces)
    return _cross(b - a, c - a) / 2


def face_areas(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f"]:
    """Area of each face, float64."""
    return lengths(vector_areas(vertices, faces))


def face_normals(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3"]:
    """Unit normal of each face by its winding, float64; 0 for a face of no area."""
    return normalized(vector_areas(vertices, faces))


def angle_weighted_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "v 3"]:
    """Unit vertex normals, float64: face normals weighted by the angle of the face at the vertex.

    Independent of how flat regions are triangulated (Thürmer & Wüthrich 1998). 0 where a vertex has no face
    with area, or where its faces cancel.
    """
    a, b, c = _corners(vertices, faces)
    ab, bc, ca = b - a, c - b, a - c
    cross = _cross(ab, -ca)
    twice_area = lengths(cross)
    cosines = [-np.einsum("fi,fi->f", u, w) for u, w in ((ab, ca), (ab, bc), (bc, ca))]
    angles = np.arctan2(twice_area[:, None], np.stack(cosines, axis=1))
    angles[twice_area == 0] = 0.0
    corner = faces.ravel()
    unit = normalized(cross)
    sums = np.stack([np.bincount(corner, (angles * n[:, None]).ravel(), len(vertices)) for n in unit.T], axis=1)
    total = np.bincount(corner, angles.ravel(), len(vertices))
    sums = sums.astype(np.float64)  # bincount of nothing has integers
    sums[lengths(sums) <= 1e-9 * total] = 0.0  # opposite faces: nothing but rounding is left
    return normalized(sums)


def unique_edges(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "e 2"]:
    """Undirected edges, each once, as (smaller, larger) vertex index in lexicographic order."""
    tail, head = faces.astype(np.int64).ravel(), faces[:, [1, 2, 0]].astype(np.int64).ravel()
    count = int(faces.max(initial=0)) + 1
    keys = np.unique(np.minimum(tail, head) * count + np.maximum(tail, head))
    edges = np.stack(np.divmod(keys, count), axis=1).astype(np.int32)
    return edges[edges[:, 0] != edges[:, 1]]


def face_components(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f"]:
    """Label 0, 1, ... of each face's part, in order of first face; faces that share a vertex share a part."""
    count = int(faces.max(initial=0)) + 1
    labels = connected_labels(faces[:, :2].ravel(), faces[:, 1:].ravel(), count)[faces[:, 0]]
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


def connected_labels(sources: Int[np.ndarray, "e"], targets: Int[np.ndarray, "e"], count: int) -> Int[np.ndarray, "n"]:
    """Label of the connected component of each of `count` nodes joined by undirected edges."""
    ends = (sources.astype(np.int32), targets.astype(np.int32))
    joined = coo_array((np.ones(len(sources)), ends), shape=(count, count))
    joined.has_canonical_format = True  # an edge given twice does no harm: spares sorting and summing
    return connected_components(joined.tocsr(), directed=False)[1]


def transform(
    mesh: Mesh,
    rotation: Float[np.ndarray, "3 3"] | None = None,
    translation: Float[np.ndarray, "3"] | None = None,
    scale: float = 1.0,
) -> Mesh:
    """The mesh moved to x -> scale * rotation x + translation (identity and 0 where None).

    Raises ValueError unless `rotation` is a proper rotation and `scale` positive: faces keep their winding.
    """
    matrix = np.eye(3) if rotation is None else proper_rotation(rotation)
    if not scale > 0:
        raise ValueError(f"scale must be positive, not {scale}")
    shift = 0.0 if translation is None else np.asarray(translation, dtype=np.float64)
    moved = scale * (mesh.vertices.astype(np.float64) @ matrix.T) + shift
    turned = mesh.normals.astype(np.float64) @ matrix.T
    return Mesh(moved.astype(np.float32), turned.astype(np.float32), mesh.faces)


def subdivide_midpoint(mesh: Mesh) -> Mesh:
    """Each face split into four at its edge midpoints; the surface is the same.

    The old vertices keep their indices, midpoints follow in the order of `unique_edges`. The normal at a
    midpoint is the normalised sum of those at the ends of its edge.
    """
    edges = unique_edges(mesh.faces)
    count = len(mesh.vertices)
    keys = edges[:, 0].astype(np.int64) * count + edges[:, 1]
    heads = mesh.faces[:, [1, 2, 0]]
    wanted = np.minimum(mesh.faces, heads).astype(np.int64) * count + np.maximum(mesh.faces, heads)
    middle = count + np.searchsorted(keys, wanted).astype(np.int32)
    middle = np.where(mesh.faces == heads, mesh.faces, middle)  # a repeated index has no edge to split
    (a, b, c), (ab, bc, ca) = mesh.faces.T, middle.T
    faces = np.stack([a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca], axis=1).reshape(-1, 3).astype(np.int32)
    ends = mesh.vertices.astype(np.float64)[edges]
    tilt = mesh.normals.astype(np.float64)[edges]
    vertices = np.concatenate([mesh.vertices, ends.mean(axis=1).astype(np.float32)])
    normals = np.concatenate([mesh.normals, normalized(tilt.sum(axis=1)).astype(np.float32)])
    return Mesh(vertices, normals, faces)


def concatenate(meshes: Sequence[Mesh]) -> Mesh:
    """All meshes as one, vertices and faces in the given order."""
    offsets = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.faces + np.int32(o) for mesh, o in zip(meshes, offsets, strict=True)]),
    )


def normalized(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit vectors in the precision given; 0 stays 0."""
    length = lengths(vectors)[:, None]
    return vectors / np.where(length > 0, length, 1)


def lengths(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Length of each row."""
    return np.sqrt(np.einsum("ni,ni->n", vectors, vectors))


def _corners(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    points = np.asarray(vertices, dtype=np.float64)  # differences of float32 numbers are exact in float64
    columns = np.ascontiguousarray(points.T)  # one contiguous array a component, here and in all that follows
    a, b, c = (np.take(columns, corner, axis=1).T for corner in faces.T)
    return a, b, c


def _cross(u: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Cross product of rows; several times faster than np.cross on large arrays."""
    (ux, uy, uz), (wx, wy, wz) = u.T, w.T
    return np.stack([uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx], axis=1)
