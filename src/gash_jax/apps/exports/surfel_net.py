"""`local` as an ONNX graph: blocks of vertices and the surfels they share, `nn.surfel_net` number for number.

b blocks of w vertices with n surfels and m near corners; arrays of one component are (b, w, n) for pairs with surfels,
(b, w, m) for corners, (b, w) for vertices.
"""

import math
from typing import Any

import numpy as np

from gash_jax.algebra.sh import band_index
from gash_jax.apps.exports.directions import (
    any_tangent,
    components,
    cross,
    dot,
    rotate_coefficients,
    unit_vectors,
    unshadowed_transfer,
    zero_without_normal,
)
from gash_jax.apps.exports.graph import Graph, Value
from gash_jax.apps.exports.layers import dense
from gash_jax.graph.surfel_graph import NEAR
from gash_jax.graph.surfel_selection import BLOCK
from gash_jax.nn.surfel_net import (
    EDGE_ON,
    FARTHEST,
    FLOOR,
    GATE,
    LOG_RANGE,
    ROUNDING,
    SMALLEST_AREA,
    TINY,
)

Vector = list[Value]


def write_surfel_net(g: Graph, config: Any) -> tuple[Value, Value]:
    """Coefficients and expected errors of every vertex, both (v, k), in the order of the mesh."""
    blocks, bands = "blocks", config.bands
    position = g.input("position", (blocks, BLOCK, 3), "positions (p - c) / r of the block's vertices (Surfels)")
    normal = g.input("normal", (blocks, BLOCK, 3), "their unit normals, 0 where there is none (Input)")
    near = g.input("near", (blocks, BLOCK, NEAR * 6), "offsets and normals of their near corners (Surfels)")
    surfel = g.input("surfel", (blocks, config.neighbours, 20), "records of the block's surfels (Surfels)")
    slot = g.input("slot", ("vertices",), "place of each vertex of the mesh among those of all blocks", "int32")
    corners = near.reshape(0, 0, NEAR, 6)
    state, axes, seen = _encode(g, surfel, components(position), components(normal), corners)
    x = dense(g, "mix", state.reshape(-1, g.weights["mix/kernel"].shape[0])).apply("Relu")
    for i in range(config.layers):
        x = x + dense(g, f"hidden_{i}", x).apply("Relu")
    normals, seen = normal.reshape(-1, 3), seen.reshape(-1, 1)
    frames = g.stack([g.stack(axis) for axis in axes]).reshape(-1, 3, 3)
    residual = rotate_coefficients(g, seen / (seen + GATE) * dense(g, "head", x), frames, bands)
    log_mse = dense(g, "error_head", dense(g, "error_hidden", x).apply("Tanh")).apply("Sigmoid")
    log_mse = log_mse * (LOG_RANGE[1] - LOG_RANGE[0]) + LOG_RANGE[0]
    coefficients, error = _fall_back(g, zero_without_normal(g, residual, normals), log_mse, normals, bands)
    return coefficients.take(slot), error.take(slot)


def _encode(
    g: Graph, surfel: Value, position: Vector, normal: Vector, corners: Value
) -> tuple[Value, list[Vector], Value]:
    """Pooled features (b, w, c), axes of the frames, and how much stands above the tangent planes (b, w)."""
    record = [surfel.take(i, 2).unsqueeze(1) for i in range(20)]
    own = [n.unsqueeze(2) for n in normal]
    offset = [record[i] - position[i].unsqueeze(2) for i in range(3)]
    square = dot(offset, offset) + FLOOR
    distance = square.apply("Sqrt")
    u = [o / distance for o in offset]
    vector, area, size = record[3:6], record[6], record[7]
    covered = _projected_area(record, u).minimum(area)
    angle = covered / (covered + square)
    height = dot(u, own)
    above = angle * (height - ROUNDING / distance).maximum(0.0)
    reach = ((_quadratic(record[14:20], own).maximum(0.0) + TINY).apply("Sqrt") / distance).minimum(FARTHEST)
    corner = [corners.take(i, 3) for i in range(6)]
    away = (dot(corner[:3], corner[:3]) + FLOOR).apply("Sqrt")
    v = [c / away for c in corner[:3]]
    axes = _axes(g, normal, u, above + 1e-3 * angle, v)
    wide = [[component.unsqueeze(2) for component in axis] for axis in axes]

    x, y = dot(u, wide[0]), dot(u, wide[1])
    flux = (-dot(u, vector) / covered.maximum(SMALLEST_AREA)).clip(-2.0, 2.0)
    facing = [dot(vector, axis) / area.maximum(SMALLEST_AREA) for axis in wide]
    features = [x, y, height, x * y, y * height, 1.5 * height * height - 0.5, x * height, 0.5 * (x * x - y * y)]
    features += [angle.maximum(TINY).apply("Sqrt"), flux, reach, size / (size + distance)]
    features += [facing[2], facing[0], facing[1], _root(distance)]
    h = dense(g, "surfel", g.stack(features)).apply("Relu")  # (b, w, n, c)
    weights = g.stack([above, angle * (height + reach).clip(0.0, 1.0)], 2)
    pooled = (weights @ h).reshape(0, 0, 2 * g.weights["surfel/kernel"].shape[1])
    corner_states = dense(g, "near", g.stack(_near_features(corner[3:], v, away, wide))).apply("Relu")
    total = above.sum(2)
    extra = [total, above.max(2), _root(away.mean(2))]
    state = g.concat([pooled, corner_states.mean(2), corner_states.max(2), g.stack(extra)], 2)
    rise = (dot(v, own) - ROUNDING / away).maximum(0.0)
    return state, axes, total + rise.mean(2)


def _projected_area(record: Vector, u: Vector) -> Value:
    """Of each surfel along the direction to it."""
    floor = record[6] * (EDGE_ON / (4 * math.pi))
    seen = _quadratic(record[8:14], u).maximum(0.0) + (floor * floor + SMALLEST_AREA**2)
    return seen.apply("Sqrt") * (4 * math.pi)


def _quadratic(form: Vector, u: Vector) -> Value:
    """u' S u of S = (xx, yy, zz, xy, xz, yz)."""
    x, y, z = u
    mixed = form[3] * x * y + form[4] * x * z + form[5] * y * z
    return form[0] * x * x + form[1] * y * y + form[2] * z * z + 2.0 * mixed


def _root(distance: Value) -> Value:
    return distance.maximum(TINY).apply("Sqrt").apply("Sqrt")


def _axes(g: Graph, normal: Vector, u: Vector, weight: Value, near: Vector) -> list[Vector]:
    """Axes of frames whose first looks where most is hidden, components of each (b, w)."""
    hidden = [(weight * a).sum(2) + 1e-4 * b.mean(2) for a, b in zip(u, near, strict=True)]
    upward = dot(hidden, normal)
    tangent = [h - upward * n for h, n in zip(hidden, normal, strict=True)]
    known = dot(tangent, tangent) > 1e-16
    other = any_tangent(g, normal)
    first = unit_vectors(g, [g.where(known, t, o) for t, o in zip(tangent, other, strict=True)])
    return [first, cross(normal, first), normal]


def _near_features(normal: Vector, v: Vector, away: Value, axes: list[Vector]) -> Vector:
    x, y, z = (dot(v, axis) for axis in axes)
    turned = [dot(normal, axis) for axis in axes]
    relative = away / (away.mean(2, keep=True) + 1e-9)
    features = [x, y, z, x * y, y * z, x * z, 0.5 * (x * x - y * y), z * z, *turned, dot(normal, v), relative]
    return [*features, _root(away)]


def _fall_back(g: Graph, residual: Value, log_mse: Value, normals: Value, bands: int) -> tuple[Value, Value]:
    """Drawn to the closed form where that is expected to be better; and the error to expect."""
    own, formula = (log_mse.take(np.arange(start, start + bands), 1) for start in (0, bands))
    trust = (formula - own).minimum(0.0).apply("Exp")
    rest = 1.0 - trust
    error = (trust * trust * own.apply("Exp") + rest * rest * formula.apply("Exp")).apply("Sqrt")
    trust, error = (each.take(band_index(bands), 1) for each in (trust, error))
    coefficients = unshadowed_transfer(g, normals, bands) + trust * residual
    return coefficients, zero_without_normal(g, error, normals)
