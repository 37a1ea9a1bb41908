"""Predict radiance transfer from a gash_jax model file with NumPy alone: one file, made to be ported.

    python gash_numpy.py model.npz mesh.npz out.npz     # mesh.npz: vertices, normals, faces; out.npz: a transfer file

    model = load_model("model.npz")
    coefficients = predict(model, vertices, normals, faces)      # (v, B*B), vertex order kept

The file format, every array and every formula are in docs/model_file.md; section names there are the ones used in the
comments here. Arrays: positions (v, 3), normals (v, 3) of length 1 or 0, faces (f, 3). Nothing is random but the
neighbours of a "rings" graph, which come from NumPy's PCG64 with a given seed. Of a `local` model,

    coefficients, error = predict_with_error(model, vertices, normals, faces)      # both (v, B*B)

also says how far it expects to be off. It may know more than the 3 bands that it says, and light that bounces:

    model = load_model("model.npz", bands=6)
    coefficients, error = predict_with_error(model, vertices, normals, faces, bounces=2, albedo=0.5)

Its tree rests on comparisons of floating-point numbers; they are made here in the order and the precision of the
package, so that both build the same.
"""

import json
import math
import os
import platform
import sys
import time
from typing import Any, NamedTuple

import numpy as np

# arrays of the error head by the names that the first files gave them
OLD_NAMES: dict[str, str] = {"doubt/kernel": "error_hidden/kernel", "doubt/bias": "error_hidden/bias"}
OLD_NAMES |= {"error/kernel": "error_head/kernel", "error/bias": "error_head/bias"}

FRAMES = ("mixed", "world", "vertex")


class Model(NamedTuple):
    """The "model" table of the metadata, the arrays by name in float32, what the weights are called, and "bound"."""

    config: dict[str, Any]
    arrays: dict[str, np.ndarray]
    name: str = ""
    bound: float | None = None  # 90 % of partly hidden vertices err by at most this times what is expected of them


def read_file(path: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Metadata and arrays of a file that gash export wrote, weights in float32. Raises ValueError for anything else."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {str(name): archive[name] for name in archive.files}
        metadata = json.loads(str(arrays.pop("metadata")))
    except Exception:
        raise ValueError(f"{path} is not a readable model file (.npz written by gash export)") from None
    return metadata, {name: array.astype(np.float32) for name, array in arrays.items()}


def load_model(path: str, bands: int | None = None) -> Model:
    """Read a model file, to say its own bands, or as many as are asked of those that it knows.

    Raises ValueError for anything else.
    """
    metadata, arrays = read_file(path)
    if metadata.get("format") != "gash-model" or metadata.get("version") != 1:
        raise ValueError(f"{path} is not a model file of version 1")
    arrays = {OLD_NAMES.get(name, name): array for name, array in arrays.items()}
    config = metadata["model"]
    if bands is not None and bands != config["bands"]:
        known = known_bands(config)
        if config["name"] != "local" or not 1 <= bands <= known:
            raise ValueError(f"bands={bands}: model {config['name']} knows {known}")
        config = {**config, "bands": bands, "known_bands": known}
    return Model(config, arrays, metadata.get("name", ""), metadata.get("bound"))


def known_bands(config: dict[str, Any]) -> int:
    """How many bands the arrays of a model are for."""
    return max(config["bands"], config.get("known_bands", 1))


# ---------------------------------------------------------------- spherical harmonics (section "Closed form")


def evaluate_sh(directions: np.ndarray, bands: int) -> np.ndarray:
    """Real orthonormal basis at unit vectors (n, 3) -> (n, B*B); polar axis z, no Condon-Shortley sign."""
    x, y, z = directions.T
    out = np.zeros((len(directions), bands * bands), directions.dtype)
    cosine, sine, sectoral = np.ones_like(x), np.zeros_like(x), math.sqrt(1 / (4 * math.pi))
    for m in range(bands):
        if m > 0:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
            sectoral *= math.sqrt((2 * m + 1) / (2 * m)) * (math.sqrt(2) if m == 1 else 1)
        legendre, previous = np.full_like(z, sectoral), np.zeros_like(z)
        for band in range(m, bands):
            if band > m:
                grow = math.sqrt((4 * band**2 - 1) / (band**2 - m**2))
                fade = grow * math.sqrt(((band - 1) ** 2 - m**2) / (4 * (band - 1) ** 2 - 1))
                legendre, previous = grow * z * legendre - fade * previous, legendre
            out[:, band * band + band + m] = legendre * cosine
            if m > 0:
                out[:, band * band + band - m] = legendre * sine
    return out


def closed_form(normals: np.ndarray, bands: int) -> np.ndarray:
    """Unshadowed transfer A_l / pi * Y_k(n); 0 at zero normals."""
    weights = []
    for band in range(bands):
        if band == 1:
            a = 2 * math.pi / 3
        elif band % 2:
            a = 0.0
        else:
            a = 2 * math.pi * (-1) ** (band // 2 - 1) / ((band + 2) * (band - 1)) * math.comb(band, band // 2) / 2**band
        weights += [a / math.pi] * (2 * band + 1)
    return np.array(weights) * evaluate_sh(normals, bands) * np.any(normals != 0, axis=1)[:, None]


def rotate_sh(coefficients: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Coefficients in each vertex's frame -> world: the unique f with f(F w) = g(w), fitted on fixed directions."""
    bands = math.isqrt(coefficients.shape[1])
    count = 4 * bands * bands
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * math.pi * (3 - math.sqrt(5))
    radius = np.sqrt(1 - z * z)
    world = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], -1)
    fit = np.linalg.pinv(evaluate_sh(world, bands))
    local = np.einsum("nj,vji->vni", world, frames.astype(np.float64))  # F^T w
    basis = evaluate_sh(local.reshape(-1, 3), bands).reshape(len(frames), count, -1)
    return np.einsum("kn,vnj,vj->vk", fit, basis, coefficients.astype(np.float64))


# ---------------------------------------------------------------- encoding (section "Motors")

# bit 0 e1, bit 1 e2, bit 2 e3, bit 3 e+, bit 4 e-
SCALAR, E12, E13, E23 = 0, 3, 5, 6
E1P, E2P, E3P, E123P, E1M, E2M, E3M, E123M = 9, 10, 12, 15, 17, 18, 20, 23


def motors(positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """M = T R of every vertex, (v, 32): R takes e_y to the normal, T the origin to the position."""
    x, y, z = normals.T
    upper = np.where(y < 0, (x * x + z * z) / (1 + np.abs(y)), 1 + y)  # 1 + y without cancellation
    half = np.stack([x, upper, z], -1)
    length = np.linalg.norm(half, axis=1, keepdims=True)
    half = half / np.where(length > 0, length, 1)
    pole = length[:, 0] == 0  # n = -e_y: the half turn about z
    # the rotor as quaternion (w, i, j, k) = (scalar, -e23, e13, -e12)
    w, i, j, k = half[:, 1], half[:, 2], np.zeros_like(x), -np.where(pole, 1.0, half[:, 0])
    # dual part -t/2 R as a quaternion product with a pure left factor
    a, b, c = (-0.5 * positions).T
    dual = -a * i - b * j - c * k, a * w + b * k - c * j, -a * k + b * w + c * i, a * j - b * i + c * w
    out = np.zeros((len(positions), 32), np.float32)
    out[:, SCALAR], out[:, E23], out[:, E13], out[:, E12] = w, -i, j, -k
    for plus, minus, part in ((E123P, E123M, 0), (E1P, E1M, 1), (E2P, E2M, 2), (E3P, E3M, 3)):
        out[:, plus] = out[:, minus] = dual[part]
    return out


def rotor_matrices(motor: np.ndarray) -> np.ndarray:
    """Rotation (v, 3, 3) of each motor's rotor; its columns are the axes of the vertex's frame."""
    w, x, y, z = motor[:, SCALAR], -motor[:, E23], motor[:, E13], -motor[:, E12]
    rows = [(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y))]
    rows += [(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x))]
    rows += [(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y))]
    return np.stack([np.stack(row, -1) for row in rows], axis=-2)


# ---------------------------------------------------------------- graph (section "Graphs")


def nearest(points: np.ndarray, serving: np.ndarray, k: int) -> np.ndarray:
    """The k nearest serving points of every point, itself left out, nearest first; fewer are repeated in turn."""
    count = min(k + 1, len(serving))
    table = np.empty((len(points), k), np.int64)
    for start in range(0, len(points), 256):
        rows = np.arange(start, min(start + 256, len(points)))
        squared = ((points[rows, None] - points[serving][None]) ** 2).sum(-1)
        found = np.argpartition(squared, count - 1, axis=1)[:, :count]
        distance, found = np.take_along_axis(squared, found, 1), serving[found]
        distance[found == rows[:, None]] = -1  # the point itself first, so that it can be skipped
        order = np.lexsort((found, distance), axis=-1)
        found = np.take_along_axis(found, order, 1)
        skip = (found[:, :1] == rows[:, None]) & (count > 1)
        column = np.arange(k) % np.minimum(count - skip, k) + skip
        table[rows] = np.take_along_axis(found, column, 1)
    return table


def draw(rng: np.random.Generator, rows: int, population: int, count: int) -> np.ndarray:
    """`count` different numbers below `population` per row (Floyd's algorithm)."""
    drawn = np.empty((rows, count), np.int32)
    for i, last in enumerate(range(population - count, population)):
        candidate = rng.integers(0, last + 1, rows, np.int32)
        taken = np.any(drawn[:, :i] == candidate[:, None], axis=1)
        drawn[:, i] = np.where(taken, last, candidate)
    return drawn


def rings(points: np.ndarray, serving: np.ndarray, neighbours: int, seed: int) -> np.ndarray:
    """A quarter of the neighbours each from about the nearest 8, 64, 256 and from all vertices."""
    rng, each, others = np.random.default_rng(seed), neighbours // 4, len(serving) - 1
    parts = []
    for share in (min(s, max(each, others)) for s in (8, 64, 256)):
        if share <= each:
            parts.append(nearest(points, serving, each))
            continue
        pool = min(2 * each, share)
        thinned = np.sort(rng.choice(serving, -(-len(serving) * pool // share), replace=False))
        near = nearest(points, thinned, pool)
        parts.append(np.take_along_axis(near, draw(rng, len(points), pool, each), axis=1))
    everyone = np.arange(len(points))[:, None]
    if others < 1:
        return np.concatenate([*parts, np.repeat(everyone, each, 1)], axis=1)
    drawn = draw(rng, len(points), others, min(each, others))
    drawn += drawn >= np.searchsorted(serving, everyone)  # leaves the receiver out
    parts.append(serving[drawn[:, np.arange(each) % drawn.shape[1]]])
    return np.concatenate(parts, axis=1)


def orthonormal_frame(n: np.ndarray) -> np.ndarray:
    """Columns tangent, bitangent, normal: the shortest turn from +z; at -z the half turn about y."""
    x, y, z = n.T
    pole = (np.abs(x) < 1e-20) & (np.abs(y) < 1e-20)
    square = np.where(pole, 1.0, x * x + y * y)
    factor = np.where(z < 0, (1 - z) / square, 1 / (1 + np.abs(z)))
    u = np.where(pole & (z < 0), 1.0, x)
    xx, xy, yy = u * u * factor, u * y * factor, y * y * factor
    rows = [np.stack(row, -1) for row in ([1 - xx, -xy, x], [-xy, 1 - yy, y], [-x, -y, z])]
    return np.stack(rows, axis=-2)


def vertex_frames(positions: np.ndarray, normals: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Frames (v, 3, 3) whose tangent is the tangential part of the mean unit offset to the neighbours."""
    offsets = positions[table] - positions[:, None]
    length = np.linalg.norm(offsets, axis=-1, keepdims=True)
    mean = (offsets / np.where(length > 0, length, 1)).mean(axis=1)
    tangent = mean - (mean * normals).sum(-1, keepdims=True) * normals
    size = np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = tangent / np.where(size > 0, size, 1)
    frames = np.stack([tangent, np.cross(normals, tangent), normals], axis=-1)
    frames = np.where(size[:, :, None] < 1e-3, orthonormal_frame(normals), frames)
    return np.where(np.any(normals != 0, axis=1)[:, None, None], frames, np.eye(3))


def edge_features(positions: np.ndarray, normals: np.ndarray, frames: np.ndarray, table: np.ndarray) -> np.ndarray:
    """16 numbers for every edge, (v, k, 16) (section "Edge features")."""
    offsets = positions[table] - positions[:, None]
    d = np.linalg.norm(offsets, axis=-1)
    direction = offsets / np.where(d > 0, d, 1)[..., None]
    x, y, z = np.moveaxis(np.einsum("vki,vij->vkj", direction, frames), -1, 0)
    facing = normals[table]
    local = np.einsum("vki,vij->vkj", facing, frames)
    zonal = np.where(d > 0, 1.5 * z * z - 0.5, 0.0)
    log_distance = 1 + np.log(d + 1e-4) / math.log(1e4)
    near = [s / (s + d) for s in (0.02, 0.1, 0.5)]
    quadratic = [x * y, y * z, zonal, x * z, 0.5 * (x * x - y * y)]
    return np.stack(
        [x, y, z, *quadratic, log_distance, *near, *np.moveaxis(local, -1, 0), (facing * direction).sum(-1)], -1
    )


# ---------------------------------------------------------------- surfels (section "Surfels")

FAN, TOP, LEAVES, MOST_PARTS, MOST_SLICES, MOST_SLICED = 4, 64, 8192, 8, 16, 32768
LEAD_BITS, CURVE_BITS = 9, 30
OPENING, NEGLIGIBLE, FULL, LONGEST = np.float32(0.08), np.float32(0.01), 128.0, 256
MIDDLE, TIPS = np.float32(0.6), np.float32(3)
CLOSE, TOUCHING = np.float32(0.03), np.float32(1e-5)
NEAR, TOGETHER = 8, 512  # near corners; vertices at a time, so that memory is bounded
# order of a symmetric matrix: xx, yy, zz, xy, xz, yz
ROW, COLUMN = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]


class Tree(NamedTuple):
    """Leaf i is part `piece[i]` of face `face[i]` (-1: none); parents come before children, level by level."""

    face: np.ndarray
    piece: np.ndarray
    first_child: np.ndarray
    level_sizes: list[int]


def triangle_parts(k: int) -> np.ndarray:
    """Barycentric corners of the k^2 equal parts of a triangle, (k^2, 3, 3)."""
    parts = [[(i, j), (i + 1, j), (i, j + 1)] for i in range(k) for j in range(k - i)]
    parts += [[(i + 1, j), (i + 1, j + 1), (i, j + 1)] for i in range(k) for j in range(k - i - 1)]
    return np.array([[(k - i - j, i, j) for i, j in part] for part in parts], np.float32) / np.float32(k)


def triangle_slices(m: int, tip: int) -> np.ndarray:
    """Barycentric corners of the 2 m - 1 triangles of m slices towards corner number `tip`."""
    parts = [[(m - i, 0, i), (0, m - i, i), (m - i - 1, 0, i + 1)] for i in range(m)]
    parts += [[(0, m - i, i), (0, m - i - 1, i + 1), (m - i - 1, 0, i + 1)] for i in range(m - 1)]
    return np.roll(np.array(parts, np.float32) / np.float32(m), tip - 2, axis=2)


WAYS = [triangle_parts(k) for k in range(1, MOST_PARTS + 1)]
WAYS += [triangle_slices(m, tip) for m in range(2, MOST_SLICES + 1) for tip in range(3)]
PIECES, PIECE_COUNT = np.concatenate(WAYS), np.array([len(way) for way in WAYS])
PIECE_START = np.cumsum(PIECE_COUNT) - PIECE_COUNT


def curve_order(points: np.ndarray, normals: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Order along a Morton curve through the points' box; after LEAD_BITS bits comes the octant of the normal."""
    turn = np.asarray(axes.T, np.float32)
    local = turn @ np.asarray(points, np.float32).T
    local = local - (local.min(axis=1) + local.max(axis=1))[:, None] / 2
    reach = max(float(np.abs(local).max()), np.finfo(np.float32).tiny)
    cell = np.clip((local.T / reach + 1) * 512, 0, 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(CURVE_BITS // 3):
        for i in range(3):
            code |= ((cell[:, i] >> bit) & 1) << (3 * bit + 2 - i)
    octant = np.array([4, 2, 1]) @ (turn @ np.asarray(normals, np.float32).T > 0)
    low = CURVE_BITS - LEAD_BITS
    code = ((code >> low) << (low + 3)) | (octant << low) | (code & ((1 << low) - 1))
    return np.argsort(code, kind="stable").astype(np.int32)


def first_of_repeated(places: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """For each vertex the first one at its place with its normal, within 1 / 4096."""
    rows = np.concatenate([places, np.rint(4096 * normals)], axis=1, dtype=np.float32)
    first, label = np.unique(rows, axis=0, return_index=True, return_inverse=True)[1:]
    return first[label.reshape(-1)]


def outward_faces(vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Each set of corners once, the first one given, turned to where its vertices' normals point."""
    faces = faces[np.sort(np.unique(np.sort(faces, axis=1), axis=0, return_index=True)[1])]
    mean = normals[faces[:, 0]] + normals[faces[:, 1]] + normals[faces[:, 2]]
    against = np.einsum("fi,fi->f", area_vectors(vertices, faces).astype(np.float32), mean) < 0
    return np.where(against[:, None], faces[:, ::-1], faces)


def surface_axes(points: np.ndarray, faces: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Principal axes of the surface as columns, each towards its heavier tail; `area` in any unit."""
    corners = [points[faces[:, i]] for i in range(3)]
    offsets, moments, axes = second_moments((corners[0] + corners[1] + corners[2]).astype(np.float64) / 3, area)
    if moments[1] <= 1e-12 * moments[2]:  # the middles lie on a line: corners stand for them
        area = np.tile(area / 3, 3)
        offsets, moments, axes = second_moments(np.concatenate(corners).astype(np.float64), area)
    equal = np.diff(moments) < 1e-3 * moments[2]
    if equal.all():
        axes = towards_farthest(offsets, axes)
    for i in np.flatnonzero(equal)[:1]:
        axes[:, i : i + 2] = towards_farthest(offsets, axes[:, i : i + 2])
    local = offsets @ axes
    cubes = local * local * local
    tail, reach = area @ cubes, local.max(axis=0, initial=0) + local.min(axis=0, initial=0)
    axes = axes * np.where(np.where(np.abs(tail) < 1e-3 * (area @ np.abs(cubes)), reach, tail) < 0, -1, 1)
    thickness = np.abs(local).max(axis=0, initial=0)
    flat = np.flatnonzero(thickness <= 1e-6 * thickness.max())[:1]
    axes[:, flat] *= np.sign(np.linalg.det(axes))  # of what lies in a plane they are right-handed
    return axes


def second_moments(points: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Offsets of points from their mean, and the principal moments with their axes."""
    offsets = points - area @ points / max(area.sum(), np.finfo(float).tiny)
    moments, axes = np.linalg.eigh((offsets * area[:, None]).T @ offsets)
    return offsets, moments, axes


def towards_farthest(offsets: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Other axes of the same span, the last towards the farthest point, the others by Gram and Schmidt."""
    local = offsets @ axes
    farthest = local[np.argmax(np.sum(local * local, axis=1))] if len(local) else np.eye(axes.shape[1])[-1]
    basis, _ = np.linalg.qr(np.concatenate([farthest[:, None], np.eye(axes.shape[1])], axis=1))
    return axes @ basis[:, ::-1]


def cut_faces(points: np.ndarray, faces: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Face and piece of every leaf, face by face: large faces in k^2 equal parts, slivers in slices."""
    even = np.sqrt(area.sum() / LEAVES) + np.finfo(float).tiny
    parts = np.clip(np.ceil(np.sqrt(area) / even), 1, MOST_PARTS).astype(int)
    sides = np.stack([np.linalg.norm(points[faces[:, i - 1]] - points[faces[:, i - 2]], axis=1) for i in range(3)])
    length, width = sides.max(0), sides.min(0)
    sliver = length > np.maximum(2 * width, 1.52 * even * parts)
    thick = np.maximum(width, max(1.52 * even, 2 * float(length[sliver].sum()) / MOST_SLICED))
    slices = np.clip(np.ceil(length / thick), 1, MOST_SLICES).astype(int)
    way = np.where(sliver & (slices > parts), MOST_PARTS + 3 * (slices - 2) + sides.argmin(0), parts - 1)
    face = np.repeat(np.arange(len(faces)), PIECE_COUNT[way])
    first = np.cumsum(PIECE_COUNT[way]) - PIECE_COUNT[way]
    return face, np.arange(len(face)) - np.repeat(first - PIECE_START[way], PIECE_COUNT[way])


def build_tree(points: np.ndarray, faces: np.ndarray, area: np.ndarray, axes: np.ndarray) -> Tree:
    """Cut the faces, sort the parts along the curve, and make families of FAN until at most TOP are left."""
    face, piece = cut_faces(points, faces, area)
    corners, weights = points[faces], PIECES.mean(axis=1)[piece]
    facing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[face]
    middle = sum(weights[:, i, None] * corners[face, i] for i in range(3))
    order = curve_order(np.asarray(middle), facing, axes)
    sizes = [max(len(order), 1)]
    while sizes[0] > TOP:
        sizes.insert(0, -(-sizes[0] // FAN))
    # every level but the top is padded to whole families
    padded = [sizes[0], *(FAN * size for size in sizes[:-1])] if len(sizes) > 1 else sizes
    starts = np.cumsum([0, *padded])
    first_child = np.full(starts[-1], -1, np.int32)
    for i, size in enumerate(sizes[:-1]):
        first_child[starts[i] : starts[i] + size] = starts[i + 1] + FAN * np.arange(size)
    empty = padded[-1] - len(order)
    face, piece = np.append(face[order], np.full(empty, -1)), np.append(piece[order], np.zeros(empty, int))
    return Tree(face, piece, first_child, padded)


def over_family(x: np.ndarray) -> np.ndarray:
    """Sum over the last axis, FAN = 4 members."""
    return (x[..., 0] + x[..., 1]) + (x[..., 2] + x[..., 3])


def surfel_records(tree: Tree, points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(s + 1, 20): moments of all surfels, and last an empty one."""
    corner = points[faces[np.maximum(tree.face, 0)]].transpose(1, 2, 0)  # (3 corners, 3, l)
    weight = PIECES[tree.piece].transpose(1, 2, 0)[:, :, None]
    real = (tree.face >= 0).astype(np.float32)
    p = real * (weight[:, 0] * corner[0] + weight[:, 1] * corner[1] + weight[:, 2] * corner[2])
    center = (p[0] + p[1] + p[2]) / 3
    e = p - center
    vector = 0.5 * np.cross(e[1] - e[0], e[2] - e[0], axis=0)
    area = np.sqrt(vector[0] ** 2 + vector[1] ** 2 + vector[2] ** 2)
    products = e[:, ROW] * e[:, COLUMN]
    level = np.concatenate([center, vector, area[None], (products[0] + products[1] + products[2]) / 12])
    levels = [level]
    for size in reversed(tree.level_sizes[:-1]):
        children = np.ascontiguousarray(level).reshape(13, -1, FAN)
        total = over_family(children[6])
        share = children[6] / np.maximum(total, np.finfo(np.float32).tiny)[:, None]
        center = over_family(share * children[:3])
        offset = children[:3] - center[:, :, None]
        spread = over_family(share * (children[7:] + offset[ROW] * offset[COLUMN]))
        level = np.concatenate([center, over_family(children[3:6]), total[None], spread])
        level = np.pad(level, ((0, 0), (0, size - len(total))))
        levels.insert(0, level)
    moments = np.concatenate([*levels, np.zeros((13, 1), np.float32)], axis=1)
    xx, yy, zz, xy, xz, yz = moments[7:]
    adjugate = [yy * zz - yz * yz, xx * zz - xz * xz, xx * yy - xy * xy]
    adjugate += [xz * yz - xy * zz, xy * yz - xz * yy, xy * xz - xx * yz]
    size = np.sqrt(np.maximum(xx + yy + zz, 0))
    return np.stack([*moments[:7], size, *adjugate, *moments[7:]], axis=1)


def importance(surfel: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """i and j of pairs: centroids and sizes (4, n) of surfels, positions and normals (6, n) of vertices."""
    x, y, z = surfel[:3] - own[:3]
    s = surfel[3]
    height = own[3] * x + own[4] * y + own[5] * z
    square = x * x + y * y + z * z + s * s + np.float32(1e-12)
    inverse = np.float32(1) / np.sqrt(square)
    filled = s * s * inverse * inverse
    middle, tips = (np.clip((rise * s + height) * inverse, 0, 1) * filled for rise in (MIDDLE, TIPS))
    return middle, tips


def list_pairs(tree: Tree, surfel: np.ndarray, own: np.ndarray, scale: np.ndarray) -> tuple[tuple, tuple]:
    """What some vertices see: vertex, surfel, weight, importance; `scale` multiplies the importance.

    And the leaves beside them: vertex, leaf, q.
    """
    count, top, leaves = own.shape[1], tree.level_sizes[0], sum(tree.level_sizes[:-1])
    vertex, node = np.repeat(np.arange(count), top), np.tile(np.arange(top), count)
    reached = np.ones(len(vertex), np.float32)  # how far the surfels above a surfel are open
    seen = [(vertex[:0], node[:0], scale[:0], scale[:0])]
    beside = [(vertex[:0], node[:0], scale[:0])]
    while len(vertex):
        middle, tips = (each * scale[vertex] for each in importance(surfel[:, node], own[:, vertex]))
        opened = np.clip(tips * (1 / OPENING) - 1, 0, 1) * (tree.first_child[node] >= 0)
        weight = np.clip(middle * (1 / NEGLIGIBLE) - 1, 0, 1) * (reached * (1 - opened))
        near = (node >= leaves) & (tips > CLOSE)
        q = np.minimum(tips * (1 / CLOSE) - 1, 1) * np.minimum(4 * reached, 1)
        beside.append((vertex[near], node[near] - leaves, q[near]))
        opened = opened * reached
        kept, parents = weight > 0, opened > 0
        seen.append((vertex[kept], node[kept], weight[kept], middle[kept]))
        vertex, reached = np.repeat(vertex[parents], FAN), np.repeat(opened[parents], FAN)
        node = (tree.first_child[node[parents]][:, None] + np.arange(FAN)).reshape(-1)
    together = (tuple(np.concatenate(parts) for parts in zip(*rows, strict=True)) for rows in (seen, beside))
    return next(together), next(together)


def list_surfels(
    tree: Tree, records: np.ndarray, points: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple]:
    """The list of each vertex, the most important first: rows of `records` and their weights, (v, n).

    Lists are filled up to the length of the longest, with the empty record and weight 0. Last the leaves beside the
    vertices: vertex, leaf, q.
    """
    size = np.where(records[:, 6] > 0, records[:, 7], 0)  # without area nothing is important
    surfel = np.stack([*records[:, :3].T, size])
    own = np.concatenate([points, normals], axis=1, dtype=np.float32).T
    count = len(points)
    pairs, beside = list_pairs(tree, surfel, own, np.ones(count, np.float32))
    total = np.bincount(pairs[0], pairs[2], count)
    crowded = np.flatnonzero(total > FULL)
    again, _ = list_pairs(tree, surfel, own[:, crowded], (FULL / total[crowded]).astype(np.float32))
    calm = total[pairs[0]] <= FULL
    again = (crowded[again[0]], *again[1:])
    vertex, node, weight, weighty = (np.concatenate([a[calm], b]) for a, b in zip(pairs, again, strict=True))
    # what is wholly below the horizon counts nothing
    x, y, z = normals[vertex].T
    height = x * (surfel[0, node] - own[0, vertex]) + y * (surfel[1, node] - own[1, vertex])
    height += z * (surfel[2, node] - own[2, vertex])
    extent = quadratic(records[node, 14:].T, (x, y, z))
    seen = (height > 0) | (height * height <= np.float32(1.0001) * extent)
    vertex, node, weight, weighty = vertex[seen], node[seen], weight[seen], weighty[seen]
    order = np.lexsort((-weighty, vertex))
    vertex, node, weight = vertex[order], node[order], weight[order]
    found = np.bincount(vertex, minlength=count)
    rank = np.arange(len(vertex)) - np.repeat(np.cumsum(found) - found, found)
    fits, length = rank < LONGEST, min(max(found.max(), 1), LONGEST)
    table, told = np.full((count, length), len(records) - 1), np.zeros((count, length), np.float32)
    table[vertex[fits], rank[fits]], told[vertex[fits], rank[fits]] = node[fits], weight[fits]
    return table, told, beside


def above_horizon(r: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the edges of what stands above the horizon of triangles (n, 3, 3) begin and end, (n, 4, 3) each."""
    height, following = (r * up[:, None]).sum(-1), np.roll(r, -1, axis=1)
    then = np.roll(height, -1, axis=1)
    first, second = height >= 0, then >= 0
    crosses = first != second
    share = np.where(crosses, height / np.where(crosses, height - then, 1), 0)
    horizon = r + share[..., None] * (following - r)
    start = np.where(first[..., None], r, horizon)
    end = np.where(second[..., None], following, horizon)
    # the last edge runs along the horizon, from where the outline goes below to where it comes back
    gone, back = ((horizon * (crosses & side)[..., None]).sum(1, keepdims=True) for side in (first, second))
    return np.concatenate([start, gone], axis=1), np.concatenate([end, back], axis=1)


def cover(
    tree: Tree, faces: np.ndarray, points: np.ndarray, own: np.ndarray, normals: np.ndarray, beside: tuple
) -> np.ndarray:
    """(n, 3): what the faces right beside the vertices `own` cover; `beside` as `list_surfels` gives it."""
    vertex, leaf, q = beside
    corner = faces[tree.face[leaf]]
    other = (corner != own[vertex, None]).all(axis=1)  # a vertex sees its own faces edge-on
    vertex, leaf, q, corner = vertex[other], leaf[other], q[other], corner[other]
    up = normals[vertex]
    r = PIECES[tree.piece[leaf]] @ (points[corner] - points[own[vertex], None])
    length = lambda x: np.sqrt((x * x).sum(-1) + np.float32(1e-20))  # noqa: E731
    start, end = above_horizon(r, up)
    crosses = np.cross(start, end)
    sine, cosine = length(crosses), (start * end).sum(-1)
    f = ((np.arctan2(sine, cosine) / (2 * np.float32(math.pi) * sine))[..., None] * crosses).sum(1)
    face = np.cross(r[:, 1] - r[:, 0], r[:, 2] - r[:, 0])
    away = (face * r[:, 0]).sum(-1) / length(face)
    towards = away / np.sqrt(away * away + TOUCHING * TOUCHING)
    above = np.maximum((f * up).sum(-1) / length(f) * towards, 0) * towards
    above = above * ((r * up[:, None]).sum(-1).max(axis=1) > np.float32(1e-6))  # else it lies in the horizon
    found = np.zeros((len(own), 3), np.float32)
    np.add.at(found, vertex, ((q * above)[:, None] * f).astype(np.float32))
    return found


def corner_table(faces: np.ndarray, n_vertices: int) -> np.ndarray:
    """The next corners of a vertex's first NEAR faces, in turn where it has fewer; itself where it has none."""
    corner, following = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    order = np.argsort(corner, kind="stable")
    found = np.bincount(corner, minlength=n_vertices)
    place = (np.cumsum(found) - found)[:, None] + np.arange(NEAR) % np.maximum(found, 1)[:, None]
    table = np.append(following[order], 0)[np.minimum(place, len(order))]
    return np.where(found[:, None] == 0, np.arange(n_vertices)[:, None], table)


# ---------------------------------------------------------------- layers (section "Layers")


def dense(a: dict[str, np.ndarray], name: str, x: np.ndarray) -> np.ndarray:
    """x kernel + bias, kernel (inputs, outputs); a layer without bias has no such array."""
    return x @ a[f"{name}/kernel"] + a.get(f"{name}/bias", np.float32(0))


def layer_norm(a: dict[str, np.ndarray], name: str, x: np.ndarray) -> np.ndarray:
    """Over the channels, epsilon 1e-6."""
    centred = x - x.mean(-1, keepdims=True)
    return centred / np.sqrt((centred**2).mean(-1, keepdims=True) + 1e-6) * a[f"{name}/scale"] + a[f"{name}/bias"]


def softmax(logits: np.ndarray) -> np.ndarray:
    """Over axis 1, the neighbours; -inf is a neighbour that does not count."""
    weights = np.exp(logits - logits.max(axis=1, keepdims=True))
    return weights / weights.sum(axis=1, keepdims=True)


def relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0)


def leaky_relu(x: np.ndarray) -> np.ndarray:
    return np.where(x >= 0, x, 0.2 * x)


def transformer_conv(a: dict[str, np.ndarray], name: str, x: np.ndarray, table: np.ndarray, heads: int) -> np.ndarray:
    """Dot-product attention with a root projection."""
    query, key, value = (dense(a, f"{name}/{n}", x).reshape(len(x), heads, -1) for n in ("query", "key", "value"))
    weights = softmax((query[:, None] * key[table]).sum(-1) / math.sqrt(query.shape[-1]))
    return (weights[..., None] * value[table]).sum(1).reshape(len(x), -1) + dense(a, f"{name}/root", x)


def gatv2_conv(a: dict[str, np.ndarray], name: str, x: np.ndarray, table: np.ndarray, heads: int) -> np.ndarray:
    """Attention through a nonlinearity; given self-loops are dropped, one is added."""
    source, target = (dense(a, f"{name}/{n}", x).reshape(len(x), heads, -1) for n in ("source", "target"))
    own = np.arange(len(x))[:, None]
    keep = np.concatenate([table != own, np.ones_like(own, bool)], axis=1)
    messages = source[np.concatenate([table, own], axis=1)]
    logits = (a[f"{name}/attention"] * leaky_relu(target[:, None] + messages)).sum(-1)
    weights = softmax(np.where(keep[..., None], logits, -np.inf))
    return (weights[..., None] * messages).sum(1).reshape(len(x), -1) + a[f"{name}/bias"]


# ---------------------------------------------------------------- networks (section "Models")


def visibility_net(
    a: dict[str, np.ndarray], motor: np.ndarray, table: np.ndarray, config: dict[str, Any]
) -> np.ndarray:
    """Stage 1 of two-stage: logits of every direction."""
    x = dense(a, "visibility/embed", motor)
    for i in range(config["visibility_layers"]):
        y = transformer_conv(a, f"visibility/conv_{i}", x, table, config["heads"])
        x = x + relu(layer_norm(a, f"visibility/norm_{i}", y))
    return dense(a, "visibility/head", x)


def coefficient_net(a: dict[str, np.ndarray], room: str, x: np.ndarray, table: np.ndarray, config: dict) -> np.ndarray:
    """Stage 2, the single-stage gnn and the teacher; `room` is the prefix of its arrays."""
    x = dense(a, f"{room}embed", x)
    for i in range(config["layers"]):
        x = x + relu(gatv2_conv(a, f"{room}conv_{i}", x, table, config["heads"]))
    return dense(a, f"{room}head", x)


def world_coefficients(config: dict[str, Any], said: np.ndarray, motor: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """What mlp, gnn, teacher and two-stage end in: turned out of the vertex's frame, added to the closed form."""
    frame = config.get("frame", "mixed")
    if frame not in FRAMES:
        raise ValueError(f"{config['name']} with the frame {frame}: this file knows {', '.join(FRAMES)}")
    if frame == "vertex":
        said = rotate_sh(said, rotor_matrices(motor))
    if config.get("residual", False):
        said = closed_form(normals.astype(np.float64), config["bands"]) + said
    return finished(said, normals)


def local_net(a: dict[str, np.ndarray], edges: np.ndarray, table: np.ndarray, config: dict[str, Any]) -> np.ndarray:
    """The residual to the closed form, in each vertex's own frame."""
    hidden = relu(edges @ a["pooling/kernel"] + a["pooling/bias"])
    x = dense(a, "pooling/mix", np.concatenate([hidden.mean(1), hidden.max(1)], axis=-1))
    heads = config["heads"]
    for i in range(config["layers"]):
        name, y = f"attention_{i}", layer_norm(a, f"norm_{i}", x)
        source, target = dense(a, f"{name}/source", y), dense(a, f"{name}/target", y)
        hidden = leaky_relu(edges @ a[f"{name}/edge"] + source[table] + target[:, None])
        weights = softmax(hidden @ a[f"{name}/attention"])
        messages = hidden.reshape(*table.shape, heads, -1)
        x = x + dense(a, f"out_{i}", (weights[..., None] * messages).sum(1).reshape(len(x), -1))
        x = x + dense(a, f"mlp_{i}", relu(dense(a, f"hidden_{i}", layer_norm(a, f"mlp_norm_{i}", x))))
    return dense(a, "head", layer_norm(a, "norm", x))


def dot(a: Any, b: Any) -> np.ndarray:
    """Of vectors given by component."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def quadratic(form: Any, u: Any) -> np.ndarray:
    """u' S u of S = (xx, yy, zz, xy, xz, yz)."""
    x, y, z = u
    mixed = form[3] * x * y + form[4] * x * z + form[5] * y * z
    return form[0] * x * x + form[1] * y * y + form[2] * z * z + 2 * mixed


def vertex_axes(normals: np.ndarray, u: Any, weight: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """Frames (v, 3, 3) whose first axis points to where most is hidden; `corner` (v, 3): where the first corner is."""

    def tangential(x: np.ndarray) -> np.ndarray:
        return x - (x * normals).sum(-1, keepdims=True) * normals

    tangent = tangential(np.stack([(weight * a).sum(-1) for a in u], axis=-1))
    length = np.sqrt((tangent * tangent).sum(-1) + np.float32(1e-20))
    missing = np.maximum(np.float32(0.1) * weight.sum(-1) + np.float32(1e-6) - length, 0)
    other = unit_vectors(tangential(corner))
    # turned by 0.3 about the normal: often the corner is just opposite to the tangent, and their sum could vanish
    other = np.float32(math.cos(0.3)) * other + np.float32(math.sin(0.3)) * np.cross(normals, other)
    tangent = tangent + missing[:, None] * other
    known = (tangent * tangent).sum(-1, keepdims=True) > 1e-16
    tangent = unit_vectors(np.where(known, tangent, orthonormal_frame(normals)[..., 0]))
    return np.stack([tangent, np.cross(normals, tangent), normals], axis=-1)


def root(distance: np.ndarray) -> np.ndarray:
    """The fourth root."""
    return np.sqrt(np.sqrt(np.maximum(distance, np.float32(1e-20))))


def encode(
    a: dict[str, np.ndarray],
    surfels: np.ndarray,
    weight: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    near: np.ndarray,
    covered_by: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pooled features, frames, and how much stands above the tangent plane, of vertices.

    `surfels` (v, n, 20), `weight` (v, n), `points`, `normals` and `covered_by` (v, 3), `near` (v, 8, 6).
    """
    record = np.moveaxis(surfels, -1, 0)  # (20, v, n)
    own = normals.T[:, :, None]
    offset = record[:3] - points.T[:, :, None]
    square = dot(offset, offset) + np.float32(1e-12)
    d = np.sqrt(square)
    u = offset / d
    vector, area, size = record[3:6], record[6], record[7]
    floor = (np.float32(0.03 / (4 * math.pi)) * area) ** 2 + np.float32(1e-36)
    projected = 4 * math.pi * np.sqrt(np.maximum(quadratic(record[8:14], u), 0) + floor)
    covered = np.minimum(projected, area)
    angle = covered / (covered + square)
    height = dot(u, own)
    counted = weight * angle
    above = counted * np.maximum(height - np.float32(1e-6) / d, 0)  # what is that low is in the tangent plane
    reach = np.minimum(np.sqrt(np.maximum(quadratic(record[14:], own), 0) + np.float32(1e-20)) / d, np.float32(4))
    corner = np.moveaxis(near, -1, 0)
    length = np.sqrt(dot(corner, corner) + np.float32(1e-12))
    v = corner[:3] / length
    partly = counted * np.clip(height + reach, 0, 1)
    frames = vertex_axes(normals, u, above + np.float32(1e-3) * partly, v[:, :, 0].T)
    axes = [[frames[:, i, j, None] for i in range(3)] for j in range(3)]

    x, y = dot(u, axes[0]), dot(u, axes[1])
    flux = np.clip(-dot(u, vector) / np.maximum(covered, np.float32(1e-18)), -2, 2)
    facing = [dot(vector, axis) / np.maximum(area, np.float32(1e-18)) for axis in axes]
    features = [x, y, height, x * y, y * height, 1.5 * height * height - 0.5, x * height, 0.5 * (x * x - y * y)]
    features += [np.sqrt(np.maximum(angle, np.float32(1e-20))), flux, reach, size / (size + d)]
    features += [facing[2], facing[0], facing[1], root(d)]
    h = relu(dense(a, "surfel", np.stack(features, axis=-1)))
    weights = np.stack([above, partly], axis=1)
    pooled = (weights @ h).reshape(len(points), -1)

    x, y, z = (dot(v, axis) for axis in axes)
    relative = length / (length.mean(-1, keepdims=True) + 1e-9)
    features = [x, y, z, x * y, y * z, x * z, 0.5 * (x * x - y * y), z * z, *(dot(corner[3:], axis) for axis in axes)]
    features += [dot(corner[3:], v), relative, root(length)]
    g = relu(dense(a, "near", np.stack(features, axis=-1)))
    total = above.sum(-1)
    beside = (covered_by[:, :, None] * frames).sum(1)  # along the axes
    extra = np.stack([total, above.max(-1), root(length.mean(-1)), *beside.T], axis=-1)
    z = np.concatenate([pooled, g.mean(1), g.max(1), extra], axis=-1)
    return z, frames, total + np.maximum(dot(v, own) - np.float32(1e-6) / length, 0).mean(-1) + beside[:, 2]


def log_errors(a: dict[str, np.ndarray], name: str, x: np.ndarray) -> np.ndarray:
    """Logarithms of mean square errors, between -14 and -3."""
    said = dense(a, f"{name}_head", np.tanh(dense(a, f"{name}_hidden", x)))
    return -14 + 11 / (1 + np.exp(-said.astype(np.float64)))


def decode(
    model: Model, z: np.ndarray, frames: np.ndarray, seen: np.ndarray, normals: np.ndarray, bounces: int
) -> tuple[np.ndarray, np.ndarray]:
    """What `surfel_net` returns, from what `encode` found."""
    config, a, bands = model.config, model.arrays, model.config["bands"]
    known = known_bands(config)
    base, k = min(3, known), bands * bands
    higher = known - base
    x = relu(dense(a, "mix", z))
    for i in range(config["layers"]):
        x = x + relu(dense(a, f"hidden_{i}", x))
    said, logs = dense(a, "head", x), log_errors(a, "error", x)
    own, formula = logs[:, :base], logs[:, base:]
    log_bounced: list[np.ndarray] = []
    if bands > base or bounces:
        y = relu(dense(a, "further_mix", z))
        y = y + relu(dense(a, "further_hidden", y))
        said, logs = np.concatenate([said, dense(a, "further_head", y)], axis=1), log_errors(a, "further_error", y)
        own = np.concatenate([own, logs[:, :higher]], axis=1)
        formula = np.concatenate([formula, logs[:, higher : 2 * higher]], axis=1)
        log_bounced = [logs[:, 2 * higher + i * known :][:, :bands] for i in range(bounces)]
    gate = (seen / (seen + np.float32(0.01)))[:, None]
    # first what is said of the direct light, then of each bounce
    terms = [rotate_sh(gate * said[:, i * known * known :][:, :k], frames) for i in range(bounces + 1)]
    own, formula = own[:, :bands], formula[:, :bands]
    trust = np.exp(np.minimum(formula - own, 0))  # drawn to the closed form where that is expected to be better
    errors = [np.sqrt(trust**2 * np.exp(own) + (1 - trust) ** 2 * np.exp(formula))]
    errors += [np.exp(log / 2) for log in log_bounced]
    each = 2 * np.arange(bands) + 1  # coefficients of a band
    terms[0] = closed_form(normals.astype(np.float64), bands) + np.repeat(trust, each, axis=1) * terms[0]
    errors = [np.repeat(gate * error, each, axis=1) for error in errors]
    return tuple(np.stack([finished(term, normals) for term in found]) for found in (terms, errors))  # type: ignore[return-value]


def surfel_net(
    model: Model, vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray, bounces: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """Of every vertex the direct coefficients and what each bounce adds off white surfaces; and their expected errors.

    Both (1 + bounces, v, B*B), after the fallback. Raises ValueError for more bounces than the model knows.
    """
    most = model.config.get("known_bounces", 0)
    if bounces > most:
        raise ValueError(f"bounces={bounces}: model local knows {most or 'none'}")
    unit = surface_radius(vertices, faces) or bounding_box(vertices, faces)[1]
    points = normalised_positions(vertices, faces, unit)[0]
    first = first_of_repeated(points, normals)
    faces = outward_faces(vertices, normals, first[faces])
    area = face_areas(vertices, faces) / unit**2
    tree = build_tree(points, faces, area, surface_axes(points, faces, area))
    records, corners = surfel_records(tree, points, faces), corner_table(faces, len(points))
    shape = bounces + 1, len(points), model.config["bands"] ** 2
    coefficients, errors = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    alone = np.flatnonzero(first == np.arange(len(first)))
    for start in range(0, len(alone), TOGETHER):
        own = alone[start : start + TOGETHER]
        place, facing, seen_from = points[own], normals[own], corners[own]
        near = np.concatenate([points[seen_from] - place[:, None], normals[seen_from]], axis=-1)
        table, weight, beside = list_surfels(tree, records, place, facing)
        covered = cover(tree, faces, points, own, facing, beside)
        found = encode(model.arrays, records[table], weight, place, facing, near, covered)
        coefficients[:, own], errors[:, own] = decode(model, *found, facing, bounces)
    return coefficients[:, first], errors[:, first]


def bounding_box(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Centre and half the diagonal of the referenced vertices' box, and who is referenced."""
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    points = vertices[used].astype(np.float64)
    low, high = points.min(0), points.max(0)
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2), used


def normalised_positions(vertices: np.ndarray, faces: np.ndarray, unit: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Positions about the box centre in units of `unit` or else half the box's diagonal; who is referenced."""
    center, half, used = bounding_box(vertices, faces)
    positions = (vertices.astype(np.float64) - center) / (unit or half)
    corner = np.abs(positions[used]).max(0)
    positions[~used] = np.clip(positions[~used], -corner, corner)
    return positions.astype(np.float32), used


def area_vectors(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area times normal of each face, float64."""
    a, b, c = points.astype(np.float64)[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a) / 2


def face_areas(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area of each face, float64."""
    vectors = area_vectors(points, faces)
    return np.sqrt(np.einsum("ni,ni->n", vectors, vectors))


def surface_radius(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Root mean square distance of the surface from its centroid, faces at their own centroids weighted by area."""
    middles, areas = vertices.astype(np.float64)[faces].mean(axis=1), face_areas(vertices, faces)
    total = max(areas.sum(), np.finfo(float).tiny)
    centroid = areas @ middles / total
    return float(np.sqrt(areas @ np.sum((middles - centroid) ** 2, axis=1) / total))


def predict(
    model: Model,
    vertices: np.ndarray,
    normals: np.ndarray,
    faces: np.ndarray,
    visibility: np.ndarray | None = None,
    seed: int = 0,
) -> np.ndarray:
    """Transfer coefficients (v, B*B), float32. `visibility` (v, 25), 0 or 1, is what a teacher is told,
    of the directions of its frame (section "Directions").
    """
    config, a = model.config, model.arrays
    normals = np.asarray(normals, np.float32)
    name, k = config["name"], config.get("neighbours", 0)
    if name == "versor":
        raise ValueError("versor is not among the networks that this file knows: run its ONNX file, or gash_jax")
    usual = {"rings": "relative", "local": "surfels"}.get(name, "motor")
    if config.get("encoding", usual) != usual:
        raise ValueError(f"{name} with the encoding {config['encoding']}: this file knows {usual} only")
    if name == "local":
        return surfel_net(model, vertices, normals, faces)[0][0]
    positions, used = normalised_positions(vertices, faces)
    motor = motors(positions, normals)
    if name == "mlp":
        x = motor
        for i in range(config["layers"]):
            x = relu(dense(a, f"dense_{i}", x))
        return world_coefficients(config, dense(a, "head", x), motor, normals)
    points, serving = vertices.astype(np.float64), np.flatnonzero(used)
    table = rings(points, serving, k, seed) if "rings" in (name, config.get("graph")) else nearest(points, serving, k)
    if name == "rings":
        # lengths in units of the surface itself: the bounding box would not turn with the mesh
        scale = bounding_box(vertices, faces)[1]
        units = positions * np.float32(scale / (surface_radius(vertices, faces) or scale))
        frames = vertex_frames(units.astype(np.float64), normals.astype(np.float64), table).astype(np.float32)
        edges = edge_features(units, normals, frames, table).astype(np.float32)
        residual = rotate_sh(local_net(a, edges, table, config), frames)
        return finished(closed_form(normals.astype(np.float64), config["bands"]) + residual, normals)
    if name == "gnn":
        return world_coefficients(config, coefficient_net(a, "", motor, table, config), motor, normals)
    if name == "teacher":
        if visibility is None:
            raise ValueError("a teacher needs visibility (v, 25): what every vertex sees along its directions")
        inputs = np.concatenate([motor, np.asarray(visibility, np.float32)], axis=1)
        return world_coefficients(config, coefficient_net(a, "", inputs, table, config), motor, normals)
    seen = 1 / (1 + np.exp(-visibility_net(a, motor, table, config)))
    inputs = np.concatenate([motor, seen.astype(np.float32)], axis=1)
    return world_coefficients(config, coefficient_net(a, "coefficient/", inputs, table, config), motor, normals)


def predict_with_error(
    model: Model, vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray, bounces: int = 0, albedo: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients and how far they are expected to be off, one number a band, both (v, B*B) float32.

    With `bounces` of light off surfaces of one grey albedo. Raises ValueError for a model other than `local`: only that
    one says so; and for more bounces than it knows.
    """
    if model.config["name"] != "local":
        raise ValueError(f"model {model.config['name']} does not predict its error: only local does")
    terms, errors = surfel_net(model, vertices, np.asarray(normals, np.float32), faces, bounces)
    powers = np.float32(albedo) ** np.arange(bounces + 1, dtype=np.float32)
    return np.tensordot(powers, terms, 1), np.tensordot(powers, errors, 1)


# ---------------------------------------------------------------- section "Models of one object that deforms"


def load_deforming(path: str) -> Model:
    """Read the file of a model of one object that deforms. Raises ValueError for anything else."""
    metadata, arrays = read_file(path)
    if metadata.get("format") != "gash-deforming-model" or metadata.get("version") != 1:
        raise ValueError(f"{path} is no model of an object that deforms, version 1")
    if metadata["model"]["name"] not in ("momo-prt", "deform"):
        raise ValueError(f"{path} is a {metadata['model']['name']}, which gash_jax alone can run: use gash animate")
    if "light" in arrays:
        raise ValueError(f"{path} says radiance under a light, which gash_jax alone can shade: use gash animate")
    return Model(metadata["model"], arrays, metadata.get("name", ""))


def predict_pose(model: Model, positions: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Coefficients (v, B*B) of a pose: positions of all vertices, and their normals."""
    a = model.arrays
    if model.config["name"] == "momo-prt":
        apart = positions[a["pose/sample"].astype(int)] - a["pose/still"]
        pose = np.clip(apart.reshape(-1) @ a["pose/matrix"], a["pose/low"], a["pose/high"])
        return a["mean"] + np.tensordot((pose - a["middle"]) @ a["weights"], a["basis"], axes=1)
    kernel, rows, level = pose_kernel(a, positions), a["mean"].astype(np.float32), 0
    while f"directions/{level}" in a:
        directions, weights = a[f"directions/{level}"], a[f"weights/{level}"]
        scores = np.einsum("qm,qmr->qr", kernel[: len(weights)], weights)[a["patch"][: len(directions)].astype(int)]
        rows[: len(directions)] += np.einsum("vkr,vr->vk", directions, scores)
        level += 1
    local = rows[a["row"].astype(int)]
    edge = positions[a["neighbour"].astype(int)] - positions
    tangent = unit_vectors(edge - (edge * normals).sum(axis=1, keepdims=True) * normals)
    turned = rotate_sh(local, np.stack([tangent, np.cross(normals, tangent), normals], axis=-1))
    whole = np.any(tangent != 0, axis=1)[:, None]
    return finished(np.where(whole, turned, closed_form(normals, model.config["bands"])), normals)


def unit_vectors(x: np.ndarray) -> np.ndarray:
    """Vectors of length 1 along the last axis; 0 where all components are 0 or subnormal."""
    largest = np.abs(x).max(axis=-1, keepdims=True)
    none = largest < np.finfo(np.float32).tiny
    scaled = x / np.where(none, 1, largest)  # so that no square underflows
    return np.where(none, 0, scaled / np.where(none, 1, np.linalg.norm(scaled, axis=-1, keepdims=True)))


def patch_axes(a: dict[str, np.ndarray], positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles (q, 3) of the anchors of the patches and axes (q, 3, 3), one a row."""
    placed = positions[a["anchors"].astype(int)]
    middle = placed.mean(axis=1)
    vectors = np.einsum("qaj,qai->qji", a["axes"], placed - middle[:, None])
    x = unit_vectors(vectors[:, 0])
    y = unit_vectors(vectors[:, 1] - (vectors[:, 1] * x).sum(axis=1, keepdims=True) * x)
    return middle, np.stack([x, y, np.cross(x, y)], axis=1)


def told_numbers(a: dict[str, np.ndarray], positions: np.ndarray) -> np.ndarray:
    """The numbers (q, w) that each patch reads of a pose."""
    middle, axes = patch_axes(a, positions)
    seen = np.einsum("qij,qnj->qni", axes, positions[a["points"].astype(int)] - middle[:, None])
    apart = np.clip(seen / a["unit"] - a["still"], -1e6, 1e6)
    return np.clip(np.einsum("qc,qcw->qw", apart.reshape(len(seen), -1), a["into"]), -1e6, 1e6)


def pose_kernel(a: dict[str, np.ndarray], positions: np.ndarray) -> np.ndarray:
    """How alike a pose is to each of those that a patch knows, (q, m)."""
    squares = (a["known"] - told_numbers(a, positions)[:, :, None]) ** 2
    count, groups = a["amounts"].shape
    squares = squares.reshape(count, groups, -1, squares.shape[2]).sum(axis=2)
    whole = a["amounts"][:, :1] * matern(squares.sum(axis=1))
    return np.where(a["together"][:, None] > 0, whole, (a["amounts"][:, :, None] * matern(squares)).sum(axis=1))


def matern(squares: np.ndarray) -> np.ndarray:
    """The kernel of squared distances."""
    far = np.sqrt(3 * squares) / 2
    return (1 + far) * np.exp(-far)


def finished(coefficients: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Exactly 0 where there is no normal."""
    return np.where(np.any(normals != 0, axis=1)[:, None], coefficients, 0).astype(np.float32)


# ---------------------------------------------------------------- section "The transfer file"

CONVENTIONS = (
    "world right-handed, +y up; real orthonormal SH, polar axis z, k = l*l + l + m, no Condon-Shortley sign; "
    "transfer (1/pi) integral V cos Y, albedo not included; vertex order of the input file"
)


def check_mesh(vertices: np.ndarray, normals: np.ndarray, faces: np.ndarray) -> None:
    """Raise ValueError, one line that says what is wrong, for arrays that are no mesh."""
    if vertices.ndim != 2 or vertices.shape[1] != 3 or normals.shape != vertices.shape:
        raise ValueError(f"vertices {vertices.shape} and normals {normals.shape}: give (v, 3) of both")
    if not (np.isfinite(vertices).all() and np.isfinite(normals).all()):
        raise ValueError("vertices or normals are not finite: repair the mesh")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu" or not len(faces):
        raise ValueError(f"faces have shape {faces.shape} {faces.dtype}: give at least one, (f, 3) integers")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"faces name vertices that do not exist: there are {len(vertices)}, numbered from 0")


def predict_transfer(
    model: Model,
    vertices: np.ndarray,
    normals: np.ndarray,
    faces: np.ndarray,
    visibility: np.ndarray | None = None,
    seed: int = 0,
) -> dict[str, np.ndarray]:
    """Everything that a transfer file holds, by name; of any model, that of one object that deforms included.

    Raises ValueError for arrays that are no mesh, or not that of the model.
    """
    check_mesh(vertices, normals, faces)
    started, arrays = time.perf_counter(), {}
    if "pose/sample" in model.arrays:
        if len(vertices) != len(model.arrays["mean"]):
            raise ValueError(f"{len(vertices)} vertices: the model is of one object with {len(model.arrays['mean'])}")
        arrays["coefficients"] = predict_pose(model, vertices.astype(np.float32), normals.astype(np.float32))
    elif model.config["name"] == "local":
        arrays["coefficients"], arrays["predicted_error"] = predict_with_error(model, vertices, normals, faces)
    else:
        arrays["coefficients"] = predict(model, vertices, normals, faces, visibility, seed)
    metadata = {
        "format": "gash-transfer",
        "version": 1,
        "bands": math.isqrt(arrays["coefficients"].shape[1]),
        "conventions": CONVENTIONS,
        "method": "predict",
        "parameters": {"model": model.config, "weights": model.name, "seed": seed},
        "rays_total": 0 if visibility is None else visibility.size,
        "seconds": {"total": time.perf_counter() - started},
        "software": {"python": platform.python_version(), "numpy": np.__version__},
    }
    if "predicted_error" in arrays and model.bound is not None:
        metadata["bound"] = model.bound
    arrays = {name: np.ascontiguousarray(array, "<f4") for name, array in arrays.items()}
    arrays |= {"vertices": np.ascontiguousarray(vertices, "<f4"), "normals": np.ascontiguousarray(normals, "<f4")}
    return {**arrays, "faces": np.ascontiguousarray(faces, "<i4"), "metadata": np.array(json.dumps(metadata))}


def write_transfer(path: str, arrays: dict[str, np.ndarray]) -> None:
    """Write a transfer file; the file of that name is replaced once the new one is whole."""
    temporary = f"{path}.{os.getpid()}.tmp"
    try:
        with open(temporary, "wb") as file:
            np.savez(file, allow_pickle=False, **arrays)  # type: ignore[arg-type]
        os.replace(temporary, path)
    finally:
        if os.path.exists(temporary):
            os.remove(temporary)


def main(arguments: list[str]) -> int:
    """The command line; every failure is one line."""
    if len(arguments) != 3:
        print("usage: python gash_numpy.py model.npz mesh.npz out.npz", file=sys.stderr)
        return 2
    try:
        deforms = read_file(arguments[0])[0].get("format") == "gash-deforming-model"
        model = (load_deforming if deforms else load_model)(arguments[0])
        vertices, normals, faces = read_mesh(arguments[1])
        write_transfer(arguments[2], predict_transfer(model, vertices, normals, faces))
    except (OSError, ValueError, KeyError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    return 0


def read_mesh(path: str) -> list[np.ndarray]:
    """Vertices, normals and faces of an .npz file. Raises ValueError for anything else."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as mesh:
            return [mesh[name] for name in ("vertices", "normals", "faces")]
    except Exception:
        raise ValueError(f"{path} is no mesh: give an .npz with vertices, normals and faces") from None


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
