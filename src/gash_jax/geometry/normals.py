"""Vertex normals of a mesh as found: the file's own where usable, else angle-weighted, always facing outward.

Computed normals use the faces that count: not degenerate, the first of each set of duplicates, wound as
`orientation` decides. A vertex with degenerate faces only (a detail finer than the mesh by six orders of
magnitude) takes those, if they have any area at all. File normals are made unit length and, where they point
into a solid sheet, negated; else they stay as they are. Isolated vertices get 0.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.geometry.mesh import angle_weighted_normals, lengths, normalized, referenced_by, vector_areas
from gash_jax.geometry.orientation import Orientation

AGAINST = -0.3  # mean cosine between a solid sheet's file normals and outward faces that means "inside out"


class VertexNormals(NamedTuple):
    """Normals, and how they came about."""

    normals: Float[np.ndarray, "v 3"]  # float64, unit or 0
    from_file: bool
    filled: Int[np.ndarray, "n"]  # vertices whose file normal was unusable and was computed instead
    negated: Int[np.ndarray, "n"]  # vertices whose file normal pointed inward
    missing: Int[np.ndarray, "n"]  # vertices of a face left without a normal


def vertex_normals(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    counted: Bool[np.ndarray, "f"],
    orientation: Orientation,
    file_normals: Float[np.ndarray, "v 3"] | None,
) -> VertexNormals:
    """Normals of a mesh; `counted` are the faces that contribute to computed ones."""
    outward = np.where(orientation.reverse[:, None], faces[:, ::-1], faces)
    used = referenced_by(faces, len(vertices))
    nobody = np.zeros(0, dtype=np.int64)
    own = None if file_normals is None else _unit_or_zero(file_normals) * used[:, None]
    if own is None or not own.any():
        normals = _computed(vertices, outward, counted, used)
        return VertexNormals(normals, False, nobody, nobody, _without(normals, used))
    negated = _inside_out(vertices, outward, counted, orientation, own)
    own[negated] *= -1
    filled = _without(own, used)
    if len(filled):
        own[filled] = _computed(vertices, outward, counted, used)[filled]
    missing = _without(own, used)
    return VertexNormals(own, True, np.setdiff1d(filled, missing), negated, missing)


def _computed(
    vertices: np.ndarray, outward: np.ndarray, counted: np.ndarray, used: np.ndarray
) -> Float[np.ndarray, "v 3"]:
    normals = angle_weighted_normals(vertices, outward[counted])
    missing = _without(normals, used)
    if len(missing):
        normals[missing] = angle_weighted_normals(vertices, outward)[missing]
    return normals


def _unit_or_zero(normals: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 3"]:
    wide = normals.astype(np.float64)
    wide[~np.isfinite(wide).all(axis=1)] = 0.0
    return normalized(wide)


def _without(normals: np.ndarray, used: np.ndarray) -> Int[np.ndarray, "n"]:
    return np.flatnonzero(used & ~normals.any(axis=1))


def _inside_out(
    vertices: np.ndarray, outward: np.ndarray, counted: np.ndarray, orientation: Orientation, own: np.ndarray
) -> Int[np.ndarray, "n"]:
    """Vertices of the solid sheets whose file normals point inward on the average over their area."""
    faces = outward[counted & (orientation.sheet >= 0)]
    sheet = orientation.sheet[counted & (orientation.sheet >= 0)]
    vectors = vector_areas(vertices, faces)
    agreement = np.einsum("fi,fi->f", vectors, own[faces].sum(axis=1))
    weight = np.einsum("f,fc->f", lengths(vectors), own[faces].any(axis=2).astype(np.float64))
    sheets = len(orientation.solid)
    total, area = np.bincount(sheet, agreement, sheets), np.bincount(sheet, weight, sheets)
    against = orientation.solid & (total < AGAINST * area)
    return np.unique(faces[against[sheet]])
