"""Triangle surfaces of generated shapes: joining, moving, winding, edges, normals.

Notation: a surface is a `RawMesh` of float64 vertices (v, 3) and int64 faces (f, 3), counter-clockwise seen from
outside, without normals.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from gash_jax.geometry.mesh import RawMesh


def join(parts: Sequence[RawMesh]) -> RawMesh:
    """One surface of several; nothing is welded."""
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return RawMesh(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets, strict=True)]),
    )


def moved(
    surface: RawMesh,
    rotation: Float[np.ndarray, "3 3"] | None = None,
    offset: Float[np.ndarray, "3"] | Sequence[float | int] | float = 0.0,
    scale: float = 1.0,
) -> RawMesh:
    """The surface under x -> scale * rotation x + offset."""
    vertices = surface.vertices if rotation is None else surface.vertices @ rotation.T
    return RawMesh(scale * vertices + np.asarray(offset), surface.faces)


def random_rotation(rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """A uniformly distributed proper rotation (unit quaternion from four normal deviates)."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def signed_volume(surface: RawMesh) -> float:
    """Enclosed volume by the divergence theorem; positive for outward winding of a closed surface."""
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return float(np.einsum("fi,fi->", a, np.cross(b, c))) / 6.0


def outward(surface: RawMesh) -> RawMesh:
    """The closed surface, wound so that its volume is positive."""
    return surface if signed_volume(surface) >= 0 else RawMesh(surface.vertices, surface.faces[:, ::-1])


def without_unused(surface: RawMesh) -> RawMesh:
    """The surface with vertices that no face names removed, the order of the others kept."""
    used = np.zeros(len(surface.vertices), bool)
    used[surface.faces] = True
    return RawMesh(surface.vertices[used], (np.cumsum(used) - 1)[surface.faces])


def unique_edges(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "f 3"]]:
    """The undirected edges, and for every face the edges opposite corner 2, 0 and 1 (that is 01, 12, 20)."""
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], -1), axis=-1).reshape(-1, 2)
    count = int(faces.max()) + 1
    keys, inverse = np.unique(pairs[:, 0] * count + pairs[:, 1], return_inverse=True)
    return np.stack([keys // count, keys % count], -1), inverse.reshape(-1, 3)


def face_normals(surface: RawMesh) -> Float[np.ndarray, "f 3"]:
    """Unit face normals; zero for faces without area."""
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


def mean_normals(surface: RawMesh) -> Float[np.ndarray, "v 3"]:
    """Unit means of the adjacent face normals; zero where they cancel."""
    faces, count = surface.faces.ravel(), len(surface.vertices)
    mean = np.stack([np.bincount(faces, np.repeat(axis, 3), count) for axis in face_normals(surface).T], -1)
    return mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-300)


def tangential(surface: RawMesh, step: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    """The part of a displacement across the mean of the adjacent unit face normals."""
    mean = mean_normals(surface)
    return step - np.einsum("vi,vi->v", step, mean)[:, None] * mean


def largest_parts(surface: RawMesh, share: float) -> RawMesh:
    """The connected parts that hold at least `share` of the faces each."""
    count = len(surface.vertices)
    corners = surface.faces[:, [0, 1]].T, surface.faces[:, [1, 2]].T
    links = np.concatenate(corners, axis=1)
    _, label = connected_components(sparse.coo_array((np.ones(links.shape[1]), links), shape=(count, count)))
    part = label[surface.faces[:, 0]]
    kept = np.bincount(part) >= share * len(part)
    return without_unused(RawMesh(surface.vertices, surface.faces[kept[part]]))
