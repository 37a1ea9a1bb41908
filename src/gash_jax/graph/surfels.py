"""The surface as a tree of surfels: what a vertex sees of far geometry, at the resolution that its distance asks for.

A *surfel* stands for a piece of surface by its moments (after Bunnell 2005, who used disks): centroid, area vector,
area, and the covariance of its points, which says how flat, how long and which way round it is. Leaves are the mesh's
faces, large and long ones cut (`surfel_pieces`); they are sorted along a space-filling curve in the surface's own
axes, and every FAN neighbours on the curve make a parent, up to at most TOP of them. Which leaf lies where is topology;
moments are functions of the vertices' positions alone, so that a mesh that deforms keeps its tree (`surfel_records`).

A record is 20 numbers: centroid (3), area vector (3, the mean normal times the area), area, size (the root of the
covariance's trace), covariance adjugate and covariance (6 each, in the order xx, yy, zz, xy, xz, yz). The projected
area of a flat ellipse with covariance S seen along u is 4 pi sqrt(u' adj(S) u).
"""

from types import ModuleType
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, UInt

from gash_jax.geometry.normalised import SHORT, long_product
from gash_jax.graph.record_kernel import write_records
from gash_jax.graph.surfel_pieces import PIECES, cut_faces

FAN = 4
TOP = 64
# bits of the curve's code that come before the octant of the normal: two sides of a thin plate part early
SURFACE_BITS = 9
CURVE_BITS = 30
# with the three of an octant 63 bits: all that an index and a code have together
INDEX_BITS = 30
# relative: moments closer to each other count as equal, smaller third moments as none
EQUAL = 1e-3
# relative: faces whose middles have no larger second moment lie on a line; their corners do not
COLLINEAR = 1e-12
FLAT = 1e-6  # relative: a surface that reaches no farther across a plane lies in it


class SurfelTree(NamedTuple):
    """Topology: leaf i is part `piece[i]` of face `face[i]` (-1: none); parents lie before children, level by level."""

    face: Int[np.ndarray, "l"]
    piece: Int[np.ndarray, "l"]
    first_child: Int[np.ndarray, "s"]
    level_sizes: tuple[int, ...]


def _spread(x: UInt[np.ndarray, "n"]) -> UInt[np.ndarray, "n"]:
    """Two zero bits between any two of the low 10 bits."""
    masks = ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249))
    for shift, mask in masks:
        x = (x | (x << np.uint32(shift))) & np.uint32(mask)
    return x


def curve_codes(
    positions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], lead_bits: int
) -> Int[np.ndarray, "n"]:
    """Morton codes of points in [-1, 1]³, with the octant of the normal after the first `lead_bits` bits."""
    x, y, z = (_spread(np.clip((positions[:, i] + 1) * 512, 0, 1023).astype(np.uint32)) for i in range(3))
    code = ((x << np.uint32(2)) | (y << np.uint32(1)) | z).astype(np.int64)
    octant = 4 * (normals[:, 0] > 0) + 2 * (normals[:, 1] > 0) + (normals[:, 2] > 0)
    low = CURVE_BITS - lead_bits
    return ((code >> low) << (low + 3)) | (octant << low) | (code & ((1 << low) - 1))


def curve_order(
    positions: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    axes: Float[np.ndarray, "3 3"],
    lead_bits: int,
) -> Int[np.ndarray, "n"]:
    """Order along the curve through the points' box in these axes, which turns with them."""
    # one contiguous array a coordinate
    turn = np.asarray(axes.T, np.float32)
    local = _turned(turn, positions)
    local -= (local.min(axis=1) + local.max(axis=1))[:, None] / 2
    local /= max(float(np.abs(local).max()), np.finfo(np.float32).tiny)
    codes = curve_codes(local.T, _turned(turn, normals).T, lead_bits)
    # NumPy sorts plain numbers faster than it finds their order: the index is in the lower bits
    return np.sort((codes << INDEX_BITS) | np.arange(len(codes))) & ((1 << INDEX_BITS) - 1)


def _turned(turn: Float[np.ndarray, "3 3"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3 n"]:
    """Points as columns, turned; no more at a time than BLAS takes without threads (see `long_product`)."""
    columns = np.asarray(points, np.float32).T
    return np.concatenate([turn @ columns[:, i : i + SHORT] for i in range(0, columns.shape[1], SHORT)], axis=1)


def surface_axes(
    positions: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], area: Float[np.ndarray, "f"]
) -> Float[np.ndarray, "3 3"]:
    """Principal axes of the surface as columns, each towards its heavier tail: they turn with the mesh.

    A body of threefold or higher symmetry has equal moments, and no principal axes: there the last of them points to
    the farthest face. What is too even to have a heavier tail looks where it reaches farther. Where the middles of the
    faces lie on a line, as those of two faces do, their corners stand for them.
    """
    corners = [np.take(np.asarray(positions, np.float32), faces[:, i], axis=0) for i in range(3)]
    offsets, moments, axes = _moments((corners[0] + corners[1] + corners[2]).astype(np.float64) / 3, area)
    if moments[1] <= COLLINEAR * moments[2]:  # across a line of middles there is nothing but rounding
        area = np.tile(area / 3, 3)
        offsets, moments, axes = _moments(np.concatenate(corners).astype(np.float64), area)
    equal = np.diff(moments) < EQUAL * moments[2]
    if equal.all():
        axes = _towards_farthest(offsets, axes)
    for i in np.flatnonzero(equal)[:1]:
        axes[:, i : i + 2] = _towards_farthest(offsets, axes[:, i : i + 2])
    local = np.concatenate([offsets[i : i + SHORT] @ axes for i in range(0, max(len(offsets), 1), SHORT)])
    cubes = local * local * local
    tail, reach = long_product(area, cubes), local.max(axis=0, initial=0) + local.min(axis=0, initial=0)
    axes = axes * np.where(np.where(np.abs(tail) < EQUAL * long_product(area, np.abs(cubes)), reach, tail) < 0, -1, 1)
    thickness = np.abs(local).max(axis=0, initial=0)
    flat = np.flatnonzero(thickness <= FLAT * thickness.max())[:1]
    axes[:, flat] *= np.sign(np.linalg.det(axes))  # across a plane there are no sides: the axes are right-handed there
    return axes


def _moments(points: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offsets of points from their mean, weighted by area, and the principal moments with their axes."""
    offsets = points - long_product(area, points) / max(area.sum(), np.finfo(float).tiny)
    moments, axes = np.linalg.eigh(long_product((offsets * area[:, None]).T, offsets))
    return offsets, moments, axes


def _towards_farthest(offsets: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Other orthonormal axes of the same span, the last of them towards the point that lies farthest along it."""
    local = offsets @ axes
    farthest = local[np.argmax(np.sum(local * local, axis=1))] if len(local) else np.eye(axes.shape[1])[-1]
    basis, _ = np.linalg.qr(np.concatenate([farthest[:, None], np.eye(axes.shape[1])], axis=1))
    return axes @ basis[:, ::-1]


def build_tree(
    positions: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    area: Float[np.ndarray, "f"],
    axes: Float[np.ndarray, "3 3"],
) -> SurfelTree:
    """Cut, sort and group the faces. Positions are centred and in units of the surface's radius."""
    face, piece = cut_faces(positions, faces, area)
    middle, normal = _leaf_middles(positions, faces, face, piece)
    order = curve_order(middle, normal, axes, SURFACE_BITS)
    sizes = [max(len(order), 1)]
    while sizes[0] > TOP:
        sizes.insert(0, -(-sizes[0] // FAN))
    # every level but the top is padded to whole families
    padded = [sizes[0], *(FAN * size for size in sizes[:-1])] if len(sizes) > 1 else sizes
    starts = np.cumsum([0, *padded])
    child = [starts[i + 1] + FAN * np.arange(padded[i]) for i in range(len(padded) - 1)]
    child = [np.where(np.arange(padded[i]) < sizes[i], c, -1) for i, c in enumerate(child)]
    first_child = np.concatenate([*child, np.full(padded[-1], -1)]).astype(np.int32)
    empty = padded[-1] - len(order)
    face = np.concatenate([face[order], np.full(empty, -1, np.int32)])
    return SurfelTree(face, np.concatenate([piece[order], np.zeros(empty, np.int32)]), first_child, tuple(padded))


def _leaf_middles(
    positions: np.ndarray, faces: np.ndarray, face: np.ndarray, piece: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Centroids and normals of any length of the parts, (l, 3) with contiguous columns."""
    columns = [np.ascontiguousarray(column, np.float32) for column in np.asarray(positions).T]
    corners = [[np.take(column, index) for column in columns] for index in faces.T]
    u, v = ([a - b for a, b in zip(corners[k], corners[0], strict=True)] for k in (1, 2))
    normal = [np.take(u[i - 2] * v[i - 1] - u[i - 1] * v[i - 2], face) for i in range(3)]
    weights = [np.take(column, piece) for column in np.ascontiguousarray(PIECES.mean(axis=1).T)]
    middle = [sum(w * np.take(c[i], face) for w, c in zip(weights, corners, strict=True)) for i in range(3)]
    return np.stack(middle).T, np.stack(normal).T


def surfel_records(
    tree: SurfelTree, positions: Float[Any, "v 3"], faces: Int[Any, "f 3"], xp: ModuleType = np
) -> Float[Any, "s 20"]:
    """Records of all surfels and, last, of an empty one; NumPy, or with `xp` = jax.numpy under jit.

    Moments of a parent follow from its children's by the parallel-axis theorem, relative to its own centroid, so
    float32 is enough.
    """
    if xp is np:
        records = np.empty((sum(tree.level_sizes) + 1, 20), np.float32)
        points, sizes = np.asarray(positions, np.float32), np.array(tree.level_sizes)
        write_records(tree.face, tree.piece, PIECES, np.asarray(faces), points, sizes, records)
        return records
    # one contiguous array a component: elementwise passes, no small matrices
    points, corner = jnp.asarray(positions, np.float32), np.maximum(tree.face, 0)
    columns = [points[:, i] for i in range(3)]
    p = [[jnp.take(column, index) for column in columns] for index in (faces[corner, a] for a in range(3))]
    if tree.piece.any():
        weight = PIECES[tree.piece]
        p = [[sum(weight[:, a, b] * p[b][i] for b in range(3)) for i in range(3)] for a in range(3)]
    real = (tree.face >= 0).astype(np.float32)
    p = [[real * component for component in corner] for corner in p]
    center = [(p[0][i] + p[1][i] + p[2][i]) / 3 for i in range(3)]
    e = [[p[a][i] - center[i] for i in range(3)] for a in range(3)]
    u, v = ([e[a][i] - e[0][i] for i in range(3)] for a in (1, 2))
    cross = [u[(i + 1) % 3] * v[(i + 2) % 3] - u[(i + 2) % 3] * v[(i + 1) % 3] for i in range(3)]
    vector = [0.5 * c for c in cross]
    area = _root(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    spread = [sum(e[a][i] * e[a][j] for a in range(3)) / 12 for i, j in PAIRS]
    level = [*center, *vector, area, *spread]
    levels = [level]
    for size in reversed(tree.level_sizes[:-1]):
        level = _parents(level, size)
        levels.insert(0, level)
    columns = [jnp.concatenate([level[i] for level in levels] + [jnp.zeros(1, np.float32)]) for i in range(13)]
    spread = columns[7:]
    xx, yy, zz, xy, xz, yz = spread
    adjugate = [yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy]
    adjugate += [xz * yz - xy * zz, xy * yz - xz * yy, xy * xz - xx * yz]
    size = _root(xx + yy + zz)
    return jnp.stack([*columns[:7], size, *adjugate, *spread]).T


PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def _parents(level: list[Any], size: int) -> list[Any]:
    """Moments of the first families of FAN as parents, with empty ones up to `size`."""
    children = [jnp.reshape(column, (-1, FAN)) for column in level]
    total = _over_family(children[6])
    share = children[6] / jnp.maximum(total, np.finfo(np.float32).tiny)[:, None]
    center = [_over_family(share * c) for c in children[:3]]
    offset = [c - m[:, None] for c, m in zip(children[:3], center, strict=True)]
    spread = [_over_family(share * (s + offset[i] * offset[j])) for s, (i, j) in zip(children[7:], PAIRS, strict=True)]
    vector = [_over_family(c) for c in children[3:6]]
    missing = size - len(total)
    columns = [*center, *vector, total, *spread]
    return [jnp.concatenate([c, jnp.zeros(missing, np.float32)]) for c in columns] if missing else columns


def _root(x: Any) -> Any:
    """The square root of what is not negative, with gradient 0 instead of infinity at 0."""
    return jnp.where(x > 0, jnp.sqrt(jnp.where(x > 0, x, 1)), 0)


def _over_family(x: Any) -> Any:
    """Sum over the FAN = 4 members: in the order of `record_kernel`."""
    return (x[:, 0] + x[:, 1]) + (x[:, 2] + x[:, 3])
