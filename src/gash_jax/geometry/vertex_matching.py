"""Vertices of two files of one surface, and vertices that one file has twice.

Programs split a vertex where its texture coordinates or normals differ, so that their file has more vertices than the
one that was modelled. Both are matched by place first and by normal second: places count as one within 1e-5 of the
diagonal of the bounding box.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from gash_jax.geometry.mesh import MeshError, connected_labels, lengths

TOLERANCE = 1e-5  # of the diagonal
_NORMAL = 0.25  # so much does the length of a normal weigh, in tolerances: never as much as a place
_SAME_NORMAL = 1e-2


def vertices_of(
    engine: tuple[Float[np.ndarray, "e 3"], Float[np.ndarray, "e 3"]],
    file: tuple[Float[np.ndarray, "v 3"], Float[np.ndarray, "v 3"]],
) -> Int[np.ndarray, "e"]:
    """The vertex of `file` that each vertex of `engine` is, both (places, normals).

    Raises MeshError where there is none.
    """
    unit = _unit(file[0])
    _, found = KDTree(_features(*file, unit, _NORMAL)).query(_features(*engine, unit, _NORMAL))
    away = lengths(engine[0].astype(np.float64) - file[0][found].astype(np.float64)) > unit
    if away.any():
        raise MeshError(
            f"{away.sum()} of {len(away)} vertices of the .glb (first: {np.argmax(away)}) are nowhere in the transfer: "
            "bake the same shape, in the same place and scale, with the same axis up"
        )
    return np.asarray(found, np.int32)


def same_vertices(places: Float[np.ndarray, "v 3"], normals: Float[np.ndarray, "v 3"]) -> Int[np.ndarray, "v"]:
    """A label for each vertex, equal for vertices at one place with one normal (within 1e-2)."""
    features = _features(places, normals, _unit(places), 1.0 / _SAME_NORMAL)
    pairs = KDTree(features).query_pairs(1.0, output_type="ndarray")
    return connected_labels(pairs[:, 0], pairs[:, 1], len(places))


def mean_over(labels: Int[np.ndarray, "v"], values: Float[np.ndarray, "v n"]) -> Float[np.ndarray, "v n"]:
    """Each row replaced by the mean of the rows with its label."""
    counts = np.bincount(labels)
    sums = np.stack([np.bincount(labels, column) for column in values.T], axis=1)
    return (sums / counts[:, None])[labels].astype(values.dtype)


def _unit(places: Float[np.ndarray, "v 3"]) -> float:
    span = np.ptp(places.astype(np.float64), axis=0)
    return TOLERANCE * max(float(np.linalg.norm(span)), float(np.finfo(np.float32).tiny))


def _features(places: np.ndarray, normals: np.ndarray, unit: float, weight: float) -> Float[np.ndarray, "v 6"]:
    return np.concatenate([places.astype(np.float64) / unit, weight * normals.astype(np.float64)], axis=1)
