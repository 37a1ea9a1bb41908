"""`momo-prt` and `deform` as ONNX graphs. They are of one object, so the number of its vertices is that of the file."""

from typing import Any

import numpy as np

from gash_jax.apps.exports.directions import (
    components,
    cross,
    dot,
    rotate_coefficients,
    unit_vectors,
    unshadowed_transfer,
    zero_without_normal,
)
from gash_jax.apps.exports.graph import Graph, Value
from gash_jax.models.patch_levels import LEVELS
from gash_jax.models.surroundings import FAR, REACH


def write_momo(g: Graph, config: Any) -> Value:
    """Coefficients are linear in the pose."""
    rank, *shape = g.weights["basis"].shape
    scores = (_pose(g) - g.weight("middle")) @ g.weight("weights")
    return g.weight("mean") + (scores @ g.weight("basis").reshape(rank, -1)).reshape(*shape)


def write_deform(g: Graph, config: Any) -> Value:
    """Patch by patch, in frames that follow the skin."""
    count, size = g.weights["mean"].shape
    normals = g.input("normal", (count, 3), "unit normal of each vertex in the pose, 0 where it has none")
    local = _levels(g, _kernel(g))
    axes = _frames(g, components(_own_position(g)), components(normals))
    frames = g.stack([g.stack(axis) for axis in axes])
    turned = rotate_coefficients(g, local, frames, config.bands)
    whole = dot(axes[0], axes[0]).unsqueeze(1) > 0.0
    found = g.where(whole, turned, unshadowed_transfer(g, normals, config.bands))
    return zero_without_normal(g, found, normals)


def _kernel(g: Graph) -> Value:
    """The kernel of the pose and of the poses that each patch knows, (q, m)."""
    (patches, ways, known), groups = g.weights["known"].shape, g.weights["amounts"].shape[1]
    apart = (_seen_points(g) / g.weight("unit") - g.weight("still")).clip(-FAR, FAR).reshape(patches, 1, -1)
    told = (apart @ g.weight("into")).clip(-FAR, FAR).reshape(patches, ways, 1)
    missing = g.weight("known") - told
    squares = (missing * missing).reshape(patches, groups, -1, known).sum(2)
    amounts = g.weight("amounts")
    whole = amounts.take(np.array([0]), 1) * _matern(squares.sum(1))
    added = (amounts.unsqueeze(2) * _matern(squares)).sum(1)
    return g.where(g.weight("together").unsqueeze(1) > 0.0, whole, added)


def _matern(squares: Value) -> Value:
    """As `surroundings.matern`."""
    far = (squares.maximum(1e-12) * 3.0).apply("Sqrt") / REACH
    return (1.0 + far) * (-far).apply("Exp")


def _seen_points(g: Graph) -> Value:
    """Points in the axes of their patches, (q, n, 3)."""
    placed = _own_position(g).take(indices(g, "anchors"))
    middle = placed.mean(1, keep=True)
    vectors = g.weight("axes").transpose(0, 2, 1) @ (placed - middle)  # (q, 2, 3)
    long, second = (components(vectors.take(number, 1)) for number in range(2))
    x = unit_vectors(g, long)
    along = dot(second, x)
    y = unit_vectors(g, [s - along * f for s, f in zip(second, x, strict=True)])
    columns = g.stack([g.stack(axis) for axis in (x, y, cross(x, y))])
    return (_own_position(g).take(indices(g, "points")) - middle) @ columns


def _levels(g: Graph, kernel: Value) -> Value:
    """What the patches say, level by level, each of the first patches and rows."""
    rows, (vertices, k) = g.weight("mean"), g.weights["mean"].shape
    for level in range(len(LEVELS)):
        (patches, _, width), count = g.weights[f"weights/{level}"].shape, len(g.weights[f"directions/{level}"])
        if count:
            first = kernel.take(g.constant(np.arange(patches))).unsqueeze(1)
            scores = (first @ g.weight(f"weights/{level}")).reshape(-1, width)
            own = scores.take(g.constant(g.weights["patch"][:count].astype(np.int64))).unsqueeze(2)
            more = (g.weight(f"directions/{level}") @ own).reshape(count, k)
            rows = rows + g.add("Pad", more, np.array([0, 0, vertices - count, 0]))
    return rows.take(indices(g, "row"))


def pose_position(g: Graph, count: int) -> Value:
    """Positions of a pose, (v, 3), of the `count` vertices of the object."""
    return g.input("position", (count, 3), "position of each vertex in the pose, in the units of the fitted object")


def _own_position(g: Graph) -> Value:
    return pose_position(g, g.weights["mean"].shape[0])


def indices(g: Graph, name: str) -> Value:
    """Indices, which model files hold as float32."""
    return g.constant(g.weights[name].astype(np.int64))


def _pose(g: Graph) -> Value:
    """The numbers of the pose, (1, p), held to the range of training."""
    apart = _own_position(g).take(indices(g, "pose/sample")) - g.weight("pose/still")
    return (apart.reshape(1, -1) @ g.weight("pose/matrix")).clip(g.weight("pose/low"), g.weight("pose/high"))


def _frames(g: Graph, position: list[Value], normal: list[Value]) -> list[list[Value]]:
    """Axes of the frames, components of each: along an edge, across it, the normal; 0 where the edge has vanished."""
    neighbour = indices(g, "neighbour")
    edge = [component.take(neighbour) - component for component in position]
    upward = dot(edge, normal)
    first = unit_vectors(g, [e - upward * n for e, n in zip(edge, normal, strict=True)])
    return [first, cross(normal, first), normal]
