"""Ambient-occlusion refinement of predicted transfer (GNN paper, 4.3.2; after Bunnell 2005).

The paper projects the offset from a vertex v to a neighbour n onto the normal of v; a positive projection occludes. It
gives no formula and searches densely. Here, with u the unit offset to a neighbour at distance d < R,

    occlusion(v) = sum_n w max(n_v . u, 0) / sum_n w,      w = 1 - d / R

over at most `neighbours` nearest vertices, found by a k-d tree; R = RADIUS times the radius of the surface. It lies
in [0, 1), does not change when the mesh is moved, turned or scaled, and is 0 on a convex mesh, in whose tangent planes
nothing stands. Refined coefficients are t (1 - strength * occlusion). STRENGTH is the one that brings the unshadowed
closed form of generated shapes nearest to their bakes (experiments/ambient).
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.normalised import NormalisedMesh

NEIGHBOURS = 64
RADIUS = 0.5
STRENGTH = 2.1
BLOCK = 1 << 15


def ambient_occlusion(mesh: Mesh, neighbours: int = NEIGHBOURS) -> Float[np.ndarray, "v"]:
    """Occlusion of every vertex, 0 where it has no normal or no neighbour in reach.

    Raises ValueError for fewer than one neighbour.
    """
    if neighbours < 1:
        raise ValueError(f"{neighbours} neighbours: ask for at least 1")
    shape = NormalisedMesh(mesh)
    serving, reach = np.flatnonzero(shape.referenced), RADIUS * shape.radius
    if not len(serving) or reach <= 0:
        return np.zeros(len(mesh.vertices))
    points, normals = mesh.vertices.astype(np.float64), mesh.normals.astype(np.float64)
    tree, count = KDTree(points[serving]), min(neighbours + 1, len(serving))
    blocks = (slice(start, start + BLOCK) for start in range(0, len(points), BLOCK))
    return np.concatenate([_occlusion(tree, points[serving], points[b], normals[b], count, reach) for b in blocks])


def _occlusion(
    tree: KDTree, serving: np.ndarray, points: np.ndarray, normals: np.ndarray, count: int, reach: float
) -> Float[np.ndarray, "v"]:
    distance, found = tree.query(points, count, distance_upper_bound=reach, workers=-1)
    distance, found = np.reshape(distance, (-1, count)), np.reshape(found, (-1, count))
    # the vertex itself, and what coincides with it, has no direction; the tree reports what is out of reach as inf
    near = (distance > 0) & np.isfinite(distance)
    offsets = serving[np.where(near, found, 0)] - points[:, None]
    height = np.einsum("vki,vi->vk", offsets, normals) / np.where(near, distance, 1)
    weight = np.where(near, 1 - np.where(near, distance, 0) / reach, 0)
    return np.sum(weight * np.maximum(height, 0), axis=1) / np.maximum(weight.sum(axis=1), np.finfo(float).tiny)


def ambient_refinement(
    mesh: Mesh, coefficients: Float[np.ndarray, "v k"], strength: float = STRENGTH, neighbours: int = NEIGHBOURS
) -> Float[np.ndarray, "v k"]:
    """Coefficients darkened where neighbours stand above the tangent plane; never by more than to 0."""
    shade = np.clip(1 - strength * ambient_occlusion(mesh, neighbours), 0, 1)
    return (coefficients * shade[:, None]).astype(coefficients.dtype)
