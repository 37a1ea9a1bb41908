"""How the faces of a mesh hang together: edges, duplicates, fans, boundary loops, welding.

Half-edge h = 3 f + c runs from corner c of face f to the next corner. An edge is the set of half-edges between
the same two vertices, whatever their direction; half-edges from a vertex to itself belong to none.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.geometry.mesh import connected_labels


class Edges(NamedTuple):
    """Half-edges sorted by edge, and the edges."""

    halfedge: Int[np.ndarray, "h"]
    edge: Int[np.ndarray, "h"]  # ascending
    forward: Bool[np.ndarray, "h"]  # from the smaller vertex index to the larger
    start: Int[np.ndarray, "e"]  # first place of each edge in the three arrays above
    faces_at: Int[np.ndarray, "e"]  # how many half-edges, that is faces, each edge has
    vertices: Int[np.ndarray, "e 2"]


def build_edges(faces: Int[np.ndarray, "f 3"], vertex_count: int) -> Edges:
    """Group the half-edges of `faces` by edge."""
    tail, head = faces.ravel().astype(np.int64), faces[:, [1, 2, 0]].ravel().astype(np.int64)
    key = np.minimum(tail, head) * vertex_count + np.maximum(tail, head)
    order = np.argsort(key)
    order = order[tail[order] != head[order]]
    key = key[order]
    new = np.ones(len(key), dtype=bool)
    new[1:] = key[1:] != key[:-1]
    start = np.flatnonzero(new)
    return Edges(
        halfedge=order,
        edge=np.cumsum(new) - 1,
        forward=(tail < head)[order],
        start=start,
        faces_at=np.diff(np.append(start, len(key))),
        vertices=np.stack(np.divmod(key[start], vertex_count), axis=1),
    )


def repeated_directions(edges: Edges) -> Int[np.ndarray, "e"]:
    """For each edge, how many of its two directions (0, 1 or 2) are used by more than one half-edge."""
    if not len(edges.start):
        return np.zeros(0, dtype=np.int64)
    forward = np.add.reduceat(edges.forward.astype(np.int64), edges.start)
    return (forward > 1).astype(np.int64) + (edges.faces_at - forward > 1)


def first_of_duplicates(faces: Int[np.ndarray, "f 3"], vertex_count: int) -> Int[np.ndarray, "f"]:
    """For each face, the first face with the same set of three vertex indices (itself, if it is the first)."""
    ordered = np.sort(faces, axis=1).astype(np.int64)
    pair = ordered[:, 0] * vertex_count + ordered[:, 1]
    if vertex_count > 2_000_000:  # three indices would overflow one int64
        pair = np.unique(pair, return_inverse=True)[1]
    key = pair * vertex_count + ordered[:, 2]
    rising = np.sort(key)
    if (rising[1:] != rising[:-1]).all():  # as nearly always, and numbers are sorted faster than their order is found
        return np.arange(len(key))
    order = np.argsort(key, kind="stable")
    new = np.ones(len(key), dtype=bool)
    new[1:] = key[order][1:] != key[order][:-1]
    first = np.empty(len(key), dtype=np.int64)
    first[order] = order[np.flatnonzero(new)][np.cumsum(new) - 1]
    return first


def has_repeated_index(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, "f"]:
    """Faces that name a vertex more than once."""
    a, b, c = faces.T
    return (a == b) | (b == c) | (c == a)


def cyclic_ascent(faces: Int[np.ndarray, "f 3"]) -> Bool[np.ndarray, "f"]:
    """One of two classes for the winding of a face: equal for two faces on the same three vertices exactly if
    these are wound alike."""
    a, b, c = faces.T
    return (a < b).astype(np.int8) + (b < c) + (c < a) == 2


def fan_counts(faces: Int[np.ndarray, "f 3"], edges: Edges, vertex_count: int) -> Int[np.ndarray, "v"]:
    """Number of face fans at each vertex: groups of its faces joined through edges at the vertex.

    1 at a regular vertex, 0 at an isolated one. Faces with a repeated index join fans but make none.
    """
    following = np.arange(3 * len(faces)).reshape(-1, 3)[:, [1, 2, 0]].ravel()[edges.halfedge]
    low = np.where(edges.forward, edges.halfedge, following)  # the corner at the smaller vertex
    high = np.where(edges.forward, following, edges.halfedge)
    same = edges.edge[1:] == edges.edge[:-1]
    sources = np.concatenate([low[:-1][same], high[:-1][same]])
    targets = np.concatenate([low[1:][same], high[1:][same]])
    fan = connected_labels(sources, targets, 3 * len(faces))
    proper = np.repeat(~has_repeated_index(faces), 3)
    vertex_of_fan = np.full(fan.max(initial=-1) + 1, -1, dtype=np.int64)
    vertex_of_fan[fan[proper]] = faces.ravel()[proper]
    return np.bincount(vertex_of_fan[vertex_of_fan >= 0], minlength=vertex_count)


def loop_labels(edge_vertices: Int[np.ndarray, "e 2"]) -> Int[np.ndarray, "e"]:
    """Label 0, 1, ... of the loop of each boundary edge; loops that touch in a vertex count as one."""
    nodes, ends = np.unique(edge_vertices, return_inverse=True)
    ends = ends.reshape(-1, 2)
    labels = connected_labels(ends[:, 0], ends[:, 1], len(nodes))
    return np.unique(labels[ends[:, 0]], return_inverse=True)[1]


def weld(vertices: Float[np.ndarray, "v d"]) -> Int[np.ndarray, "v"]:
    """For each vertex, the number of its position: vertices at equal positions share one.

    Only for reasoning about the surface (STL corners, texture seams); the mesh itself is never welded.
    """
    order = np.lexsort(vertices.T)
    ordered = vertices[order]
    new = np.ones(len(vertices), dtype=bool)
    new[1:] = sum((column[1:] != column[:-1]) for column in ordered.T)
    position = np.empty(len(vertices), dtype=np.int64)
    position[order] = np.cumsum(new) - 1
    return position
