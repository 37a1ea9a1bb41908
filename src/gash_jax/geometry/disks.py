"""From a mesh to a disk, for maps to the plane only: corners joined, loops filled, handles and closed surfaces cut.

A *disk* is a surface with one boundary loop and no handle. The mesh itself stays as it is: every point of the disk is a
mean of mesh vertices, and `lift` (sparse) says which.

* Vertices at equal positions are joined (seams of textures, corners of an STL file), so faces that name such a vertex
  twice disappear from the map. A vertex where fans of faces touch becomes one for each fan.
* Of several boundary loops one stays: the longest, or a chosen one. Each other is closed by a cone over its mean.
* A closed surface of genus 0 is cut along the shortest path by edges between two vertices far apart: the one farthest
  from the surface's centroid, and the one farthest from that along edges.
* Handles are opened one after the other, each by the shortest loop or arc through an edge that a tree of shortest paths
  and a tree of dual edges leave over (Eppstein 2003, "Dynamic generators of topologically embedded graphs"; the dual
  tree of largest distances is that of Erickson and Whittlesey 2005). Paths start at the boundary as far as it has come,
  of a closed surface at the vertex farthest from its centroid.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.csgraph import depth_first_order, dijkstra, minimum_spanning_tree

from gash_jax.algebra.arguments import whole_number
from gash_jax.geometry.mesh import Mesh, MeshError, connected_labels, face_areas, face_components, lengths
from gash_jax.geometry.topology import build_edges, fan_counts, has_repeated_index, repeated_directions, weld


class Disk(NamedTuple):
    """A surface with one boundary loop (module docstring)."""

    points: Float[np.ndarray, "n 3"]  # float64
    faces: Int[np.ndarray, "m 3"]
    face_of: Int[np.ndarray, "m"]  # face of the mesh that each one is, or a part of; -1 where a loop was filled
    loop: Int[np.ndarray, "b"]  # boundary, the surface to its left
    lift: sparse.csr_array  # (n, v): points = lift @ vertices
    vertices: int  # that the mesh has
    made: Bool[np.ndarray, "n"]  # tips of cones and middles of edges: no vertex of the mesh lies there
    filled_loops: int
    cut_edges: int  # edges of the surface that were cut


def as_disk(mesh: Mesh, boundary: int | None = None) -> Disk:
    """The mesh as a disk. `boundary` names the loop that stays by one of its vertices; None is the longest loop.

    Raises MeshError, one line, for what has no such map: several parts, edges of more than two faces, faces wound
    against each other.
    """
    surface = _joined(mesh)
    loops = boundary_loops(surface.faces)
    kept = _kept_loop(mesh, surface, loops, boundary)
    surface = _filled(surface, [loop for number, loop in enumerate(loops) if number != kept])
    surface = surface._replace(loop=np.zeros(0, np.int64) if kept is None else loops[kept])
    if kept is None and _euler(surface) == 2:
        return with_seam(surface, None)
    while _euler(surface) < 1:
        surface = _without_handle(surface)
    return surface


def _euler(surface: Disk) -> int:
    return len(surface.points) - len(build_edges(surface.faces, len(surface.points)).start) + len(surface.faces)


def with_seam(disk: Disk, vertex: int | None) -> Disk:
    """The disk cut open from a vertex inside it, along the shortest path by edges to its boundary.

    None takes the vertex farthest from the boundary; of a closed surface, from its vertex farthest from the centroid.
    """
    distance, before = _paths(disk)
    far = int(distance.argmax()) if vertex is None else vertex
    return _opened(disk, _path_edges(before, np.array([far])))


def _paths(disk: Disk) -> tuple[Float[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Length of the shortest path by edges from each vertex to the boundary, and the next vertex of it, or -1.

    Of a closed surface, to the vertex farthest from its centroid.
    """
    tail, head = build_edges(disk.faces, len(disk.points)).vertices.T
    # two corners of a disk may be joined by an edge of no length, which a sparse matrix would not hold
    long = np.maximum(lengths(disk.points[tail] - disk.points[head]), np.finfo(float).tiny)
    graph = sparse.csr_array((long, (tail, head)), shape=2 * (len(disk.points),))
    roots = disk.loop
    if not len(roots):
        middles, areas = disk.points[disk.faces].mean(axis=1), face_areas(disk.points, disk.faces)
        centroid = areas @ middles / max(areas.sum(), np.finfo(float).tiny)
        roots = np.array([lengths(disk.points - centroid).argmax()])
    distance, before, _ = dijkstra(graph, directed=False, indices=roots, min_only=True, return_predecessors=True)
    return distance, before


def _path_edges(before: Int[np.ndarray, "n"], ends: Int[np.ndarray, "_"]) -> Int[np.ndarray, "c 2"]:
    """The edges of the paths from some vertices."""
    on = np.zeros(len(before), dtype=bool)
    while len(ends := np.unique(ends[before[ends] >= 0])):
        on[ends] = True
        ends = before[ends]
    return np.stack([np.flatnonzero(on), before[on]], axis=1)


def boundary_loops(faces: Int[np.ndarray, "f 3"]) -> list[Int[np.ndarray, "_"]]:
    """Vertices of each boundary loop of a manifold surface in order, the surface to their left.

    The loops come in the order of their smallest vertices, and each begins with it.
    """
    edges = build_edges(faces, int(faces.max(initial=0)) + 1)
    open_halfedge = edges.halfedge[edges.start[edges.faces_at == 1]]
    tail, head = faces.ravel()[open_halfedge], faces[:, [1, 2, 0]].ravel()[open_halfedge]
    count = int(faces.max(initial=0)) + 1
    label = connected_labels(tail, head, count)
    _, first = np.unique(label[tail[np.argsort(tail)]], return_index=True)
    starts = np.sort(np.sort(tail)[first])
    following = sparse.csr_array((np.ones(len(tail)), (tail, head)), shape=(count, count))
    return [depth_first_order(following, start, return_predecessors=False) for start in starts]


def with_means(disk: Disk, groups: list[Int[np.ndarray, "_"]]) -> Disk:
    """The disk with a further point for each group of points, their mean; no face names them yet."""
    sizes, count = np.array([len(group) for group in groups]), len(disk.points)
    starts = np.concatenate([[0], np.cumsum(sizes)])
    means = sparse.csr_array((np.repeat(1 / sizes, sizes), np.concatenate(groups), starts), (len(groups), count))
    return disk._replace(
        points=np.concatenate([disk.points, means @ disk.points]),
        lift=sparse.csr_array(sparse.vstack([disk.lift, means @ disk.lift])),
        made=np.append(disk.made, np.ones(len(groups), bool)),
    )


def _joined(mesh: Mesh) -> Disk:
    """The mesh with vertices at one position joined and fans parted; what has no map is refused here."""
    position = weld(mesh.vertices)
    first = np.unique(position, return_index=True)[1]
    position = np.argsort(np.argsort(first))[position]  # numbered as their first vertices are
    faces = position[mesh.faces]
    whole = np.flatnonzero(~has_repeated_index(faces))
    used, faces = np.unique(faces[whole], return_inverse=True)
    if not len(used):
        raise MeshError("every face has two corners in one place: there is no surface to map to a square")
    faces, number = faces.reshape(-1, 3), np.full(len(mesh.vertices), -1)
    number[used] = np.arange(len(used))
    members = np.flatnonzero(number[position] >= 0)
    rows = number[position[members]]
    ones = sparse.csr_array((np.ones(len(members)), (rows, members)), shape=(len(used), len(mesh.vertices)))
    lift = sparse.csr_array(sparse.diags_array(1 / ones.sum(axis=1)) @ ones)
    nothing, count = np.zeros(0, np.int64), len(mesh.vertices)
    points = lift @ mesh.vertices.astype(np.float64)
    surface = Disk(points, faces, whole, nothing, lift, count, np.zeros(len(used), bool), 0, 0)
    edges = build_edges(faces, len(used))
    for bad, what in (
        (int((edges.faces_at > 2).sum()), "edges with more than two faces"),
        (int((repeated_directions(edges) > 0).sum()), "edges whose two faces are wound against each other"),
    ):
        if bad:
            raise MeshError(f"the mesh has {bad} {what}, so it has no map to a square: repair it first")
    if (fan_counts(faces, edges, len(used)) > 1).any():
        surface = _opened(surface, np.zeros((0, 2), np.int64))
    if parts := int(face_components(surface.faces).max(initial=0)):
        raise MeshError(f"the mesh has {parts + 1} parts: a square takes one, map each part by itself")
    return surface


def _kept_loop(mesh: Mesh, surface: Disk, loops: list[np.ndarray], boundary: int | None) -> int | None:
    """Number of the loop that goes to the border of the square; None for a closed surface."""
    if boundary is not None:
        vertex = whole_number(boundary, "boundary", 0, len(mesh.vertices) - 1)
        on = surface.lift[:, [vertex]].nonzero()[0]
        found = [number for number, loop in enumerate(loops) if np.isin(on, loop).any()]
        if not found:
            raise MeshError(f"vertex {vertex} lies on no boundary loop: name a vertex of the loop that is to stay")
        return found[0]
    if not loops:
        return None
    return int(np.argmax([lengths(surface.points[loop] - surface.points[np.roll(loop, -1)]).sum() for loop in loops]))


def _filled(surface: Disk, loops: list[Int[np.ndarray, "_"]]) -> Disk:
    """Each of the loops closed by a cone over the mean of its vertices."""
    if not loops:
        return surface
    count = len(surface.points)
    tips = [np.full(len(loop), count + number) for number, loop in enumerate(loops)]
    cones = [np.stack([np.roll(loop, -1), loop, tip], axis=1) for loop, tip in zip(loops, tips, strict=True)]
    filled = with_means(surface, loops)
    return filled._replace(
        faces=np.concatenate([surface.faces, *cones]),
        face_of=np.concatenate([surface.face_of, np.full(sum(map(len, loops)), -1)]),
        filled_loops=len(loops),
    )


def _without_handle(surface: Disk) -> Disk:
    """The surface cut along the shortest loop or arc of those that make it a disk (module docstring)."""
    distance, before = _paths(surface)
    edges, size = build_edges(surface.faces, len(surface.points)), len(surface.faces)
    tail, head = edges.vertices.T
    crossed = np.flatnonzero((edges.faces_at == 2) & (before[tail] != head) & (before[head] != tail))
    first, second = edges.halfedge[edges.start[crossed]] // 3, edges.halfedge[edges.start[crossed] + 1] // 3
    low, high = np.minimum(first, second), np.maximum(first, second)
    reach = (distance[tail] + distance[head] + lengths(surface.points[tail] - surface.points[head]))[crossed]
    # two faces may share two edges, of which the dual tree takes one at the most
    order = np.argsort(-reach, kind="stable")
    chosen = order[np.unique(low[order] * size + high[order], return_index=True)[1]]
    price = 1 + (reach.max() - reach[chosen]) / reach.max()
    tree = minimum_spanning_tree(sparse.csr_array((price, (low[chosen], high[chosen])), shape=(size, size))).tocoo()
    taken = np.isin(low[chosen] * size + high[chosen], tree.row.astype(np.int64) * size + tree.col)
    left = np.delete(np.arange(len(crossed)), chosen[taken])
    across = edges.vertices[crossed[left[reach[left].argmin()]]]
    return _opened(surface, np.concatenate([_path_edges(before, across), across[None]]))


def _opened(surface: Disk, cuts: Int[np.ndarray, "c 2"]) -> Disk:
    """The surface cut along edges: a vertex becomes as many as its corners fall apart into."""
    count = len(surface.points)
    edges = build_edges(surface.faces, count)
    cut = np.isin(edges.vertices @ [count, 1], np.sort(cuts, axis=1) @ [count, 1])
    whole = np.flatnonzero((edges.faces_at == 2) & ~cut)
    one, other = edges.halfedge[edges.start[whole]], edges.halfedge[edges.start[whole] + 1]
    after = np.arange(3 * len(surface.faces)).reshape(-1, 3)[:, [1, 2, 0]].ravel()
    # the tail of a half-edge is the head of its partner
    label = connected_labels(
        np.concatenate([one, after[one]]), np.concatenate([after[other], other]), 3 * len(surface.faces)
    )
    _, first, faces = np.unique(label, return_index=True, return_inverse=True)
    vertex = surface.faces.ravel()[first]
    faces = faces.reshape(-1, 3)
    return surface._replace(
        points=surface.points[vertex],
        faces=faces,
        loop=np.concatenate([*boundary_loops(faces), np.zeros(0, np.int64)]),
        lift=surface.lift[vertex],
        made=surface.made[vertex],
        cut_edges=surface.cut_edges + len(cuts),
    )
