"""Maps of a mesh to the unit square without flipped faces: harmonic, and with less stretch.

The boundary loop of the mesh, or of the disk made of it (`disks`), goes to the border of the square by arc length. Its
vertex farthest from the surface's centroid goes to the corner (0, 0) (so nothing here depends on the order of vertices
or on how the mesh lies), and the vertices nearest to a quarter, a half and three quarters of the loop's length to the
next corners; along each side lengths are kept up to a scale. The interior solves sum_j w_ij (u_j - u_i) = 0:

* *harmonic*: w_ij = (cot a + cot b)/2 over the angles opposite the edge, a finite-element Laplace equation. Negative
  weights may turn faces around; then
* *mean value*: w_ij = (tan(a/2) + tan(b/2)) / |p_i - p_j| over the angles at vertex i (Floater 2003), and where even
  rounding hurts
* *uniform*: w_ij = 1. Positive weights make every face counter-clockwise (Tutte 1963, Floater 2003), but for an edge
  between two vertices on one side of the square, which cuts off faces that would lie flat on that side. Such edges get
  a vertex of their own in their middle.

*Less stretch*: from mean-value weights on, w_ij is divided by the square root of the stretch around vertex j and the
equations are solved anew, as long as the stretch of the whole falls (Yoshizawa, Belyaev & Seidel 2004, "A fast and
simple stretch-minimizing mesh parameterization"; they divide by the stretch itself, which overshoots where limbs
collapse). The weights stay positive, so no face turns around. What falls is the stretch of faces whose areas are first
brought three quarters of the way to their mean (on a logarithmic scale): small faces, of which there are most where a
surface has most detail, get more of the square than their area, as a texel should hold no more than one of them.

*Seams*: where a limb stays crowded, the disk is cut open from the vertex of the largest stretch along the shortest path
to its border, as Gu, Gortler & Hoppe 2002 ("Geometry images", section 3) do; a seam that does not take away a tenth of
the stretch is not made.
"""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse
from scipy.sparse.linalg import splu

from gash_jax.geometry.disks import Disk, as_disk, with_means, with_seam
from gash_jax.geometry.mesh import Mesh, MeshError, face_areas, lengths
from gash_jax.geometry.stretch import signed_areas, total_stretch, vertex_stretch
from gash_jax.geometry.topology import build_edges

Method = Literal["stretch", "harmonic"]
Weights = Literal["cotangent", "mean value", "uniform"]

MOST_STEPS, MOST_SEAMS = 60, 8
LEAST_GAIN, SEAM_GAIN = 1e-3, 0.1  # share of the stretch that one step, and one seam, must take away
POWER = 0.5  # of the stretch that weights are divided by, at first
# 0: every face gets its share of the area, 1: all get the same; measured by experiments/geometry_images
EVENNESS = 0.75
_LEAST_TANGENT, _LEAST_LENGTH = 1e-3, 1e-4  # bounds of mean-value weights for slivers, the length in median edges


class SquareMap(NamedTuple):
    """A mesh on the unit square: `disk.faces` over `uv`, and how they came about."""

    uv: Float[np.ndarray, "n 2"]
    disk: Disk  # with the vertices in the middle of edges
    weights: Weights  # of the harmonic map, or that the stretch was lowered from
    steps: int  # solutions that lowered the stretch
    seams: int  # seams made to lower the stretch
    split_edges: int  # edges between two vertices of one side, which got a vertex in their middle
    flat_faces: int  # faces with three corners on one side, which these edges rescued


def parameterise(mesh: Mesh, method: Method = "stretch", boundary: int | None = None) -> SquareMap:
    """Map a mesh to the unit square, every face counter-clockwise and of positive area (module docstring).

    `method` "harmonic" is the plain map, "stretch" the one of less stretch; `boundary` is a vertex of the loop that
    goes to the border, None the longest. Raises MeshError for a mesh without such a map (`disks`).
    """
    disk = as_disk(mesh, boundary)
    if method == "harmonic":
        disk, border, split, flat = _on_border(disk)
        uv, name = _first_valid(disk, border, ("cotangent", "mean value", "uniform"))
        return SquareMap(uv, disk, name, 0, 0, split, flat)
    best, least = _less_stretched(disk, 0)
    for seams in range(1, MOST_SEAMS + 1):
        disk = with_seam(disk, _most_stretched(best))
        try:
            trial, stretch = _less_stretched(disk, seams)
        except MeshError:  # with that seam faces would vanish
            break
        if stretch > (1 - SEAM_GAIN) * least:
            break
        best, least = trial, stretch
    return best


def border_positions(disk: Disk) -> Float[np.ndarray, "b 2"]:
    """Place of each vertex of the disk's loop on the border of the square, counter-clockwise."""
    loop = disk.loop
    if len(loop) < 4:
        raise MeshError(f"the boundary of the mesh has {len(loop)} edges: a square needs 4 or more, refine it")
    areas, middles = face_areas(disk.points, disk.faces), disk.points[disk.faces].mean(axis=1)
    first = int(lengths(disk.points[loop] - areas @ middles / max(areas.sum(), np.finfo(float).tiny)).argmax())
    ring = disk.points[np.roll(loop, -first)]
    along = np.concatenate([[0.0], np.cumsum(lengths(np.roll(ring, -1, axis=0) - ring))])
    nearest = [int(np.abs(along[:-1] - share * along[-1]).argmin()) for share in (0.25, 0.5, 0.75)]
    # four corners of their own, in order, wherever the vertices crowd
    corners = [0, *(np.clip(at, number, len(loop) - 4 + number) for number, at in enumerate(nearest, 1)), len(loop)]
    for number in (2, 3):
        corners[number] = max(corners[number], corners[number - 1] + 1)
    place = np.interp(along[:-1], along[corners], np.arange(5))
    side, rest = np.divmod(place, 1)
    at = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=np.float64)
    low = side.astype(int)
    return np.roll(at[low] + (at[low + 1] - at[low]) * rest[:, None], first, axis=0)


def _on_border(disk: Disk) -> tuple[Disk, Float[np.ndarray, "b 2"], int, int]:
    """The disk with a vertex in the middle of each edge between two vertices of one side, and where its loop goes.

    Also how many edges got one, and how many faces with three corners on one side there were.
    """
    border = border_positions(disk)
    count = len(disk.points)
    sides = np.zeros((count, 4), dtype=bool)
    sides[disk.loop] = np.concatenate([border == 0, border == 1], axis=1)
    edges = build_edges(disk.faces, count)
    tail, head = edges.vertices.T
    split = np.flatnonzero((edges.faces_at == 2) & (sides[tail] & sides[head]).any(axis=1))
    flat = int(np.any(np.all(sides[disk.faces], axis=1), axis=1).sum())
    if not len(split):
        return disk, border, 0, flat
    middle = np.full(len(edges.start), -1)
    middle[split] = count + np.arange(len(split))
    at = np.full(3 * len(disk.faces), -1)
    at[edges.halfedge] = middle[edges.edge]  # new vertex after each corner
    faces, parent = _cut_faces(disk.faces, at.reshape(-1, 3))
    divided = with_means(disk, list(edges.vertices[split]))._replace(faces=faces, face_of=disk.face_of[parent])
    return divided, border, len(split), flat


def _cut_faces(
    faces: Int[np.ndarray, "m 3"], middle: Int[np.ndarray, "m 3"]
) -> tuple[Int[np.ndarray, "_ 3"], Int[np.ndarray, "_"]]:
    """Faces cut at the middles of some edges (middle[f, c] lies after corner c, -1 for none); which each was a part of.

    One middle makes two faces, two make three, three make four.
    """
    parts, parents = [], []
    has = middle >= 0
    for pattern in range(8):
        chosen = np.flatnonzero(has @ [1, 2, 4] == pattern)
        turn = {2: 1, 4: 2, 6: 1, 5: 2}.get(pattern, 0)  # so that the cut edges come first
        a, b, c = np.roll(faces[chosen], -turn, axis=1).T
        ab, bc, ca = np.roll(middle[chosen], -turn, axis=1).T
        cut = {
            0: [(a, b, c)],
            1: [(a, ab, c), (ab, b, c)],
            2: [(ab, b, bc), (a, ab, bc), (a, bc, c)],
            3: [(a, ab, ca), (ab, b, bc), (bc, c, ca), (ab, bc, ca)],
        }[int(pattern).bit_count()]
        parts += [np.stack(corners, axis=1) for corners in cut]
        parents += [chosen] * len(cut)
    return np.concatenate(parts), np.concatenate(parents)


def edge_weights(disk: Disk, name: Weights) -> sparse.csr_array:
    """Weights w_ij (module docstring), one row for each vertex i."""
    count, corners = len(disk.points), disk.points[disk.faces]
    ahead, behind = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    i, j, k = (np.roll(disk.faces, -turn, axis=1).ravel() for turn in range(3))
    if name == "uniform":
        joined = sparse.csr_array((np.ones(2 * len(i)), (np.append(i, i), np.append(j, k))), shape=(count, count))
        joined.data[:] = 1.0
        return joined
    cross = lengths(np.cross(ahead, behind).reshape(-1, 3))
    dot = (ahead * behind).sum(axis=2).ravel()
    if name == "cotangent":  # of the angle at i, for the edge from j to k
        half = dot / np.maximum(cross, np.finfo(float).tiny) / 2
        return sparse.csr_array((np.append(half, half), (np.append(j, k), np.append(k, j))), shape=(count, count))
    near, far = lengths(ahead.reshape(-1, 3)), lengths(behind.reshape(-1, 3))
    least = _LEAST_LENGTH * np.median(near)
    tangent = np.clip(np.tan(np.arctan2(cross, dot) / 2), _LEAST_TANGENT, 1 / _LEAST_TANGENT)
    values = np.concatenate([tangent / np.maximum(near, least), tangent / np.maximum(far, least)])
    return sparse.csr_array((values, (np.append(i, i), np.append(j, k))), shape=(count, count))


def solve_interior(
    weights: sparse.csr_array, loop: Int[np.ndarray, "b"], border: Float[np.ndarray, "b 2"]
) -> Float[np.ndarray, "n 2"]:
    """Positions of all vertices where those of the loop are given and each other is the weighted mean of its own."""
    count = len(weights.indptr) - 1
    inside = np.setdiff1d(np.arange(count), loop)
    uv = np.zeros((count, 2))
    uv[loop] = border
    if len(inside):
        rows = weights[inside]
        laplacian = sparse.diags_array(rows.sum(axis=1)) - rows[:, inside]
        uv[inside] = splu(sparse.csc_array(laplacian)).solve(rows[:, loop] @ border)
    return uv


def _first_valid(
    disk: Disk, border: Float[np.ndarray, "b 2"], names: tuple[Weights, ...]
) -> tuple[Float[np.ndarray, "n 2"], Weights]:
    """The map by the first weights that leave no face flipped or without area."""
    for name in names:
        try:
            uv = solve_interior(edge_weights(disk, name), disk.loop, border)
        except RuntimeError:  # a singular matrix
            continue
        if signed_areas(uv, disk.faces).min() > 0:
            return uv, name
    raise MeshError("faces of the mesh vanish in its map to the square, even with equal weights: simplify it first")


def _less_stretched(disk: Disk, seams: int) -> tuple[SquareMap, float]:
    """The map of less stretch of a disk, and what was lowered: the stretch of faces of evened areas."""
    disk, border, split, flat = _on_border(disk)
    uv, name = _first_valid(disk, border, ("mean value", "uniform"))
    weights, growth = edge_weights(disk, name), area_growth(disk)
    least, power, lowered = total_stretch(uv, disk.points, disk.faces, growth), POWER, 0
    for _ in range(MOST_STEPS):
        around = vertex_stretch(uv, disk.points, disk.faces, growth)
        trial = weights.copy()
        trial.data /= (around / np.median(around))[trial.indices] ** power
        trial = sparse.csr_array(sparse.diags_array(1 / trial.sum(axis=1)) @ trial)
        moved = solve_interior(trial, disk.loop, border)
        stretch = total_stretch(moved, disk.points, disk.faces, growth)
        if signed_areas(moved, disk.faces).min() > 0 and stretch < least:
            gain = 1 - stretch / least
            weights, uv, least, lowered = trial, moved, stretch, lowered + 1
            if gain < LEAST_GAIN:
                break
        elif power > POWER / 8:
            power /= 2
        else:
            break
    return SquareMap(uv, disk, name, lowered, seams, split, flat), least


def area_growth(disk: Disk) -> Float[np.ndarray, "m"]:
    """By what the areas of the faces are multiplied to come nearer to their mean (EVENNESS)."""
    areas = face_areas(disk.points, disk.faces)
    return np.maximum(areas / max(areas.mean(), np.finfo(float).tiny), 1e-6) ** -EVENNESS


def _most_stretched(found: SquareMap) -> int:
    """The vertex inside the disk, of those that the mesh has, around which the stretch is largest."""
    disk = found.disk
    around = vertex_stretch(found.uv, disk.points, disk.faces, area_growth(disk) * (disk.face_of >= 0))
    around[disk.loop] = 0
    return int(np.where(disk.made, 0, around).argmax())
