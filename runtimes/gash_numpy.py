"""Predict radiance transfer from a gash_jax model file with NumPy alone: one file, made to be ported.

    python gash_numpy.py model.npz mesh.npz out.npz     # mesh.npz: vertices, normals, faces

    model = load_model("model.npz")
    coefficients = predict(model, vertices, normals, faces)      # (v, B*B), vertex order kept

The file format, every array and every formula are in docs/model_file.md; section names there are the ones used in the
comments here. Arrays: positions (v, 3), normals (v, 3) of length 1 or 0, faces (f, 3). Nothing is random but the
neighbours of a "rings" graph, which come from NumPy's PCG64 with a given seed.
"""

import json
import math
import sys
from typing import Any, NamedTuple

import numpy as np


class Model(NamedTuple):
    """The "model" table of the metadata, and the arrays by name."""

    config: dict[str, Any]
    arrays: dict[str, np.ndarray]


def load_model(path: str) -> Model:
    """Read a model file. Raises ValueError for anything else."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        metadata = json.loads(str(arrays.pop("metadata")))
    except Exception:
        raise ValueError(f"{path} is not a readable model file (.npz written by gash export)") from None
    if metadata.get("format") != "gash-model" or metadata.get("version") != 1:
        raise ValueError(f"{path} is not a model file of version 1")
    return Model(metadata["model"], arrays)


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


def normalised_positions(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Positions in the unit ball about the box centre of the referenced vertices, the scale, who is referenced."""
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    points = vertices.astype(np.float64)
    low, high = points[used].min(0), points[used].max(0)
    scale = float(np.linalg.norm(high - low) / 2)
    positions = (points - (low + high) / 2) / scale
    corner = np.abs(positions[used]).max(0)
    positions[~used] = np.clip(positions[~used], -corner, corner)
    return positions.astype(np.float32), scale, used


def surface_radius(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Root mean square distance of the surface from its centroid, faces at their own centroids weighted by area."""
    corners = vertices.astype(np.float64)[faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    middle = corners.mean(1)
    total = area.sum() or 1.0
    centroid = area @ middle / total
    return math.sqrt(area @ ((middle - centroid) ** 2).sum(1) / total)


def predict(
    model: Model,
    vertices: np.ndarray,
    normals: np.ndarray,
    faces: np.ndarray,
    visibility: np.ndarray | None = None,
    seed: int = 0,
) -> np.ndarray:
    """Transfer coefficients (v, B*B), float32. `visibility` (v, 25), 0 or 1, is what a teacher is told."""
    config, a = model
    normals = np.asarray(normals, np.float32)
    positions, scale, used = normalised_positions(vertices, faces)
    motor, name, k = motors(positions, normals), config["name"], config["neighbours"]
    if name == "mlp":
        x = motor
        for i in range(config["layers"]):
            x = relu(dense(a, f"dense_{i}", x))
        return finished(dense(a, "head", x), normals)
    points, serving = vertices.astype(np.float64), np.flatnonzero(used)
    table = rings(points, serving, k, seed) if config["graph"] == "rings" else nearest(points, serving, k)
    if name == "local":
        # lengths in units of the surface itself: the bounding box would not turn with the mesh
        units = positions * np.float32(scale / (surface_radius(vertices, faces) or scale))
        frames = vertex_frames(units.astype(np.float64), normals.astype(np.float64), table).astype(np.float32)
        edges = edge_features(units, normals, frames, table).astype(np.float32)
        residual = rotate_sh(local_net(a, edges, table, config), frames)
        return finished(closed_form(normals.astype(np.float64), config["bands"]) + residual, normals)
    if name == "gnn":
        return finished(coefficient_net(a, "", motor, table, config), normals)
    if name == "teacher":
        if visibility is None:
            raise ValueError("a teacher needs visibility (v, 25): what every vertex sees along its directions")
        inputs = np.concatenate([motor, np.asarray(visibility, np.float32)], axis=1)
        return finished(coefficient_net(a, "", inputs, table, config), normals)
    seen = 1 / (1 + np.exp(-visibility_net(a, motor, table, config)))
    inputs = np.concatenate([motor, seen.astype(np.float32)], axis=1)
    return finished(coefficient_net(a, "coefficient/", inputs, table, config), normals)


def finished(coefficients: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Exactly 0 where there is no normal."""
    return np.where(np.any(normals != 0, axis=1)[:, None], coefficients, 0).astype(np.float32)


def main(arguments: list[str]) -> int:
    """The command line; every failure is one line."""
    if len(arguments) != 3:
        print("usage: python gash_numpy.py model.npz mesh.npz out.npz", file=sys.stderr)
        return 2
    try:
        model = load_model(arguments[0])
        with open(arguments[1], "rb") as file, np.load(file, allow_pickle=False) as mesh:
            vertices, normals, faces = (mesh[name] for name in ("vertices", "normals", "faces"))
        np.savez(arguments[2], coefficients=predict(model, vertices, normals, faces))
    except (OSError, ValueError, KeyError) as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
