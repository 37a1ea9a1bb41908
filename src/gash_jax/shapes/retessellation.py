"""Retessellation: other vertices on hardly another surface.

Real meshes are decimated, locally refined or irregular, and a network must not read the tessellation as geometry.
Every operation works on whole arrays. `refine` splits marked edges at their midpoints with the 1, 2 or 3 edge
patterns, so neighbouring triangles always agree and a closed surface stays closed. `collapse` contracts edges that
are the cheapest within two rings, so no two contractions of one pass touch the same triangle; the link condition
(exactly two common neighbours) keeps the surface a manifold.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.triangles import (
    face_normals,
    mean_normals,
    tangential,
    unique_edges,
    without_unused,
)


def refine(surface: RawMesh, marked: Bool[np.ndarray, "e"]) -> RawMesh:
    """Split the marked edges (in the order of `unique_edges`) at their midpoints, conformingly.

    Every face is first turned so that its pattern of marked edges becomes one of: none, edge 01, edges 01 and
    12, all three.
    """
    vertices, faces = surface[:2]
    edges, face_edges = unique_edges(faces)
    middle_of = np.cumsum(marked) - 1 + len(vertices)
    vertices = np.concatenate([vertices, vertices[edges[marked]].mean(axis=1)])
    hit = marked[face_edges]
    count = hit.sum(axis=1)
    # one edge: turn it to place 0; two edges: turn the unmarked one to place 2
    turn = np.where(count == 1, hit.argmax(axis=1), np.where(count == 2, (~hit).argmax(axis=1) + 1, 0))
    order = (turn[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, order, axis=1).T
    ab, bc, ca = middle_of[np.take_along_axis(face_edges, order, axis=1)].T
    patterns = (
        (count == 0, [(a, b, c)]),
        (count == 1, [(a, ab, c), (ab, b, c)]),
        (count == 2, [(a, ab, c), (ab, bc, c), (ab, b, bc)]),
        (count == 3, [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]),
    )
    pieces = [np.stack(corners, -1)[chosen] for chosen, split in patterns for corners in split]
    return RawMesh(vertices, np.concatenate(pieces))


def refine_to(surface: RawMesh, target: int, metric: Float[np.ndarray, "3"] | None = None) -> RawMesh:
    """Split the longest edges until the surface has `target` vertices (unchanged if it has them).

    `metric` weighs the axes when edges are compared: unequal weights leave triangles long along the light axis.
    """
    weights = np.ones(3) if metric is None else metric
    while (missing := target - len(surface.vertices)) > 0:
        edges, _ = unique_edges(surface.faces)
        length = np.linalg.norm(np.diff(surface.vertices[edges], axis=1)[:, 0] * weights, axis=1)
        # no more than the longest third at once, or the triangles between would turn into slivers
        share = min(missing, max(1, len(edges) // 3))
        marked = np.zeros(len(edges), bool)
        marked[np.argsort(-length, kind="stable")[:share]] = True
        surface = refine(surface, marked)
    return surface


def refine_regions(surface: RawMesh, rng: np.random.Generator, target: int) -> RawMesh:
    """Split the edges nearest to a few random vertices until about `target` vertices (at most two levels)."""
    seeds = surface.vertices[rng.integers(len(surface.vertices), size=int(rng.integers(1, 4)))]
    for share in (0.5, 1.0):
        missing = int(share * (target - len(surface.vertices)))
        edges, _ = unique_edges(surface.faces)
        middles = surface.vertices[edges].mean(axis=1)
        distance = np.linalg.norm(middles[:, None] - seeds, axis=-1).min(axis=1)
        marked = np.zeros(len(edges), bool)
        marked[np.argsort(distance, kind="stable")[: max(0, missing)]] = True
        surface = refine(surface, marked)
    return surface


def collapse(surface: RawMesh, rng: np.random.Generator, target: int, passes: int = 14) -> RawMesh:
    """Contract edges to their midpoints, flat and short ones first, until `target` vertices are left.

    At most `passes` rounds. Boundary vertices stay, and so do faces that would turn over.
    """
    for _ in range(passes):
        excess = len(surface.vertices) - target
        if excess <= 0:
            break
        contracted = _collapse_pass(surface, rng, excess)
        if len(contracted.vertices) == len(surface.vertices):
            break
        surface = contracted
    return surface


def _collapse_pass(surface: RawMesh, rng: np.random.Generator, excess: int) -> RawMesh:
    vertices, faces = surface[:2]
    edges, face_edges = unique_edges(faces)
    cost = _collapse_cost(surface, edges, face_edges) * np.exp(0.5 * rng.normal(size=len(edges)))
    chosen = np.flatnonzero(_cheapest_within_two_rings(edges, cost, len(vertices)))
    chosen = chosen[np.argsort(cost[chosen], kind="stable")]
    chosen = chosen[: max(1, min(excess, 2 * len(chosen) // 3))]
    keep, gone = edges[chosen].T
    goes_to = np.arange(len(vertices))
    goes_to[gone] = keep
    at = vertices.copy()
    at[keep] = 0.5 * (vertices[keep] + vertices[gone])
    at[gone] = at[keep]
    new_faces = goes_to[faces]
    alive = (new_faces != np.roll(new_faces, 1, axis=1)).all(axis=1)
    turned = np.einsum("fi,fi->f", face_normals(surface), face_normals(RawMesh(at, faces))) < 0.3
    # undo the contractions around faces that would turn over
    undone = np.zeros(len(vertices), bool)
    undone[faces[alive & turned]] = True
    bad = undone[keep] | undone[gone]
    goes_to[gone[bad]] = gone[bad]
    at[keep[bad]], at[gone[bad]] = vertices[keep[bad]], vertices[gone[bad]]
    new_faces = goes_to[faces]
    alive = (new_faces != np.roll(new_faces, 1, axis=1)).all(axis=1)
    return without_unused(RawMesh(at, new_faces[alive]))


def _collapse_cost(
    surface: RawMesh, edges: Int[np.ndarray, "e 2"], face_edges: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "e"]:
    """Squared length times bend; infinite where contraction would break the manifold or the boundary."""
    vertices, faces = surface[:2]
    count = len(vertices)
    bend = np.zeros(count)
    np.maximum.at(bend, faces, 1.0 - np.einsum("fci,fi->fc", mean_normals(surface)[faces], face_normals(surface)))
    ones = np.ones(len(edges))
    graph = sparse.csr_array((ones, edges.T), shape=(count, count))
    graph = graph + graph.T
    common = np.asarray((graph @ graph)[edges[:, 0], edges[:, 1]]).ravel()
    regular = np.bincount(face_edges.ravel(), minlength=len(edges)) == 2
    boundary = np.zeros(count, bool)
    boundary[edges[~regular]] = True
    length2 = np.sum(np.diff(vertices[edges], axis=1)[:, 0] ** 2, axis=-1)
    cost = length2 * (1e-3 + bend[edges].max(axis=1))
    return np.where((common == 2) & ~boundary[edges].any(axis=1), cost, np.inf)


def _cheapest_within_two_rings(
    edges: Int[np.ndarray, "e 2"], cost: Float[np.ndarray, "e"], count: int
) -> Bool[np.ndarray, "e"]:
    rank = np.empty(len(edges), np.int64)
    rank[np.argsort(cost, kind="stable")] = np.arange(len(edges))
    lowest = np.full(count, len(edges))
    np.minimum.at(lowest, edges, rank[:, None])
    spread = lowest.copy()
    np.minimum.at(spread, edges, lowest[edges[:, ::-1]])
    return (spread[edges].min(axis=1) == rank) & np.isfinite(cost)


def relax(surface: RawMesh, steps: int, amount: float = 0.5) -> RawMesh:
    """Move vertices tangentially towards the mean of their neighbours; the boundary stays."""
    vertices, faces = surface[:2]
    edges, face_edges = unique_edges(faces)
    count = len(vertices)
    inner = np.ones(count, bool)
    inner[edges[np.bincount(face_edges.ravel(), minlength=len(edges)) != 2]] = False
    graph = sparse.csr_array((np.ones(len(edges)), edges.T), shape=(count, count))
    graph = graph + graph.T
    degree = np.maximum(graph.sum(axis=1), 1.0)[:, None]
    for _ in range(steps):
        step = (graph @ vertices) / degree - vertices
        vertices = vertices + amount * inner[:, None] * tangential(RawMesh(vertices, faces), step)
    return RawMesh(vertices, faces)


def jitter(surface: RawMesh, rng: np.random.Generator, amount: float) -> RawMesh:
    """Move vertices tangentially at random by up to `amount` (below 0.5) of their lowest triangle; not the boundary.

    The lowest height of the adjacent triangles bounds the step, so flat neighbourhoods cannot fold over.
    """
    vertices, faces = surface[:2]
    edges, face_edges = unique_edges(faces)
    a, b, c = vertices[faces].transpose(1, 0, 2)
    length = np.linalg.norm(np.diff(vertices[edges], axis=1)[:, 0], axis=1)
    height = np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(length[face_edges].max(axis=1), 1e-300)
    lowest = np.full(len(vertices), np.inf)
    np.minimum.at(lowest, faces, height[:, None])
    lowest[edges[np.bincount(face_edges.ravel(), minlength=len(edges)) != 2]] = 0.0
    way = rng.normal(size=vertices.shape)
    way *= rng.random((len(vertices), 1)) / np.linalg.norm(way, axis=1, keepdims=True)
    return RawMesh(vertices + tangential(surface, amount * lowest[:, None] * way), faces)
