"""`local` as an ONNX graph: vertices and the surfels of their lists, `nn.surfel_net` number for number.

Of v vertices with n surfels and m near corners; arrays of one component are (v, n) for pairs with surfels, (v, m) for
corners, (v,) for vertices. Lists may be as long as whoever runs the graph likes: a surfel of weight 0 changes nothing.
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
from gash_jax.apps.exports.inputs import VERTICES
from gash_jax.apps.exports.layers import dense
from gash_jax.graph.surfel_graph import NEAR
from gash_jax.nn.surfel_net import BASE, GATE, LOG_RANGE
from gash_jax.nn.surfel_pairs import ASIDE, EDGE_ON, EVEN, FAINT, FARTHEST, FLOOR, ROUNDING, SMALLEST_AREA, TINY

SURFELS = "surfels"
KNOWN = 1e-16  # of squared lengths: a tangent below is none

Vector = list[Value]


def write_surfel_net(g: Graph, config: Any) -> tuple[Value, Value]:
    """Coefficients and expected errors of the bands of the config, both (v, k), in the order of the inputs."""
    position = g.input("position", (VERTICES, 3), "position of each vertex, (p - c) / r (Surfels)")
    normal = g.input("normal", (VERTICES, 3), "unit normal of each vertex, 0 where it has none (Input)")
    near = g.input("near", (VERTICES, NEAR * 6), "offsets and normals of each vertex's near corners (Surfels)")
    cover = g.input("cover", (VERTICES, 3), "what the faces right beside each vertex cover (Surfels)")
    surfel = g.input("surfel", (VERTICES, SURFELS, 20), "records of the surfels of each vertex's list (Surfels)")
    weight = g.input("weight", (VERTICES, SURFELS), "weight of each, 0 where a list has ended (Surfels)")
    pooled, axes, seen = _encode(g, surfel, weight, components(position), components(normal), near, cover)
    gate = (seen / (seen + GATE)).unsqueeze(1)
    said, own, formula = _heads(g, config, pooled)
    frames = g.stack([g.stack(axis) for axis in axes])
    residual = zero_without_normal(g, rotate_coefficients(g, gate * said, frames, config.bands), normal)
    trust = (formula - own).minimum(0.0).apply("Exp")
    rest = 1.0 - trust
    error = (trust * trust * own.apply("Exp") + rest * rest * formula.apply("Exp")).apply("Sqrt")
    trust, error = (each.take(band_index(config.bands), 1) for each in (trust, gate * error))
    coefficients = unshadowed_transfer(g, normal, config.bands) + trust * residual
    return coefficients, zero_without_normal(g, error, normal)


def _heads(g: Graph, config: Any, pooled: Value) -> tuple[Value, Value, Value]:
    """The residual (v, at least k), and logarithms of mean square errors of it and of the closed form, both (v, b)."""
    bands, base = config.bands, min(BASE, config.learnt_bands)
    x = dense(g, "mix", pooled).apply("Relu")
    for i in range(config.layers):
        x = x + dense(g, f"hidden_{i}", x).apply("Relu")
    said, logs = dense(g, "head", x), _log_errors(g, "error", x)
    first = np.arange(min(bands, base))
    own, formula = logs.take(first, 1), logs.take(first + base, 1)
    if bands > base:
        y = dense(g, "further_mix", pooled).apply("Relu")
        y = y + dense(g, "further_hidden", y).apply("Relu")
        said, logs = g.concat([said, dense(g, "further_head", y)], 1), _log_errors(g, "further_error", y)
        rest = np.arange(bands - base)
        own = g.concat([own, logs.take(rest, 1)], 1)
        formula = g.concat([formula, logs.take(rest + config.learnt_bands - base, 1)], 1)
    return said, own, formula


def _log_errors(g: Graph, name: str, x: Value) -> Value:
    low, high = LOG_RANGE
    said = dense(g, f"{name}_head", dense(g, f"{name}_hidden", x).apply("Tanh"))
    return said.apply("Sigmoid") * (high - low) + low


def _encode(
    g: Graph, surfel: Value, weight: Value, position: Vector, normal: Vector, near: Value, cover: Value
) -> tuple[Value, list[Vector], Value]:
    """Pooled features (v, c), axes of the frames, and how much stands above the tangent planes (v,)."""
    record = [surfel.take(i, 2) for i in range(20)]
    facing = [n.unsqueeze(1) for n in normal]
    offset = [record[i] - position[i].unsqueeze(1) for i in range(3)]
    square = dot(offset, offset) + FLOOR
    distance = square.apply("Sqrt")
    u = [o / distance for o in offset]
    vector, area, size = record[3:6], record[6], record[7]
    covered = _projected_area(record, u).minimum(area)
    angle = covered / (covered + square)
    counted = weight * angle
    height = dot(u, facing)
    above = counted * (height - ROUNDING / distance).maximum(0.0)
    reach = ((_quadratic(record[14:20], facing).maximum(0.0) + TINY).apply("Sqrt") / distance).minimum(FARTHEST)
    corners = near.reshape(0, NEAR, 6)
    corner = [corners.take(i, 2) for i in range(6)]
    away = (dot(corner[:3], corner[:3]) + FLOOR).apply("Sqrt")
    v = [c / away for c in corner[:3]]
    partly = counted * (height + reach).clip(0.0, 1.0)
    axes = _axes(g, normal, u, above + 1e-3 * partly, [c.take(0, 1) for c in v])
    wide = [[component.unsqueeze(1) for component in axis] for axis in axes]

    x, y = dot(u, wide[0]), dot(u, wide[1])
    flux = (-dot(u, vector) / covered.maximum(SMALLEST_AREA)).clip(-2.0, 2.0)
    turned = [dot(vector, axis) / area.maximum(SMALLEST_AREA) for axis in wide]
    features = [x, y, height, x * y, y * height, 1.5 * height * height - 0.5, x * height, 0.5 * (x * x - y * y)]
    features += [angle.maximum(TINY).apply("Sqrt"), flux, reach, size / (size + distance)]
    features += [turned[2], turned[0], turned[1], _root(distance)]
    h = dense(g, "surfel", g.stack(features)).apply("Relu")  # (v, n, c)
    weights = g.stack([above, partly], 1)
    sums = (weights @ h).reshape(0, 2 * g.weights["surfel/kernel"].shape[1])
    corner_states = dense(g, "near", g.stack(_near_features(corner[3:], v, away, wide))).apply("Relu")
    total = above.sum(1)
    beside = [dot(components(cover), axis) for axis in axes]
    extra = g.stack([total, above.max(1), _root(away.mean(1)), *beside])
    rise = (dot(v, facing) - ROUNDING / away).maximum(0.0)
    pooled = g.concat([sums, corner_states.mean(1), corner_states.max(1), extra], 1)
    return pooled, axes, total + rise.mean(1) + beside[2]


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


def _axes(g: Graph, normal: Vector, u: Vector, weight: Value, corner: Vector) -> list[Vector]:
    """Axes of frames whose first looks where most is hidden, components of each (v,); `corner`: where the first is."""
    first = _tangential([(weight * a).sum(1) for a in u], normal)
    length = (dot(first, first) + TINY).apply("Sqrt")
    missing = (EVEN * weight.sum(1) + FAINT - length).maximum(0.0)
    other = unit_vectors(g, _tangential(corner, normal))
    aside = zip(other, cross(normal, other), strict=True)
    other = [math.cos(ASIDE) * o + math.sin(ASIDE) * a for o, a in aside]
    first = [f + missing * o for f, o in zip(first, other, strict=True)]
    known = dot(first, first) > KNOWN
    any_axis = any_tangent(g, normal)
    first = unit_vectors(g, [g.where(known, f, o) for f, o in zip(first, any_axis, strict=True)])
    return [first, cross(normal, first), normal]


def _tangential(x: Vector, normal: Vector) -> Vector:
    upward = dot(x, normal)
    return [a - upward * n for a, n in zip(x, normal, strict=True)]


def _near_features(normal: Vector, v: Vector, away: Value, axes: list[Vector]) -> Vector:
    x, y, z = (dot(v, axis) for axis in axes)
    turned = [dot(normal, axis) for axis in axes]
    relative = away / (away.mean(1, keep=True) + 1e-9)
    features = [x, y, z, x * y, y * z, x * z, 0.5 * (x * x - y * y), z * z, *turned, dot(normal, v), relative]
    return [*features, _root(away)]
