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
from gash_jax.models.deform import REACH


def write_momo(g: Graph, config: Any) -> Value:
    """Coefficients are linear in the pose."""
    rank, *shape = g.weights["basis"].shape
    scores = (_pose(g) - g.weight("middle")) @ g.weight("weights")
    return g.weight("mean") + (scores @ g.weight("basis").reshape(rank, -1)).reshape(*shape)


def write_deform(g: Graph, config: Any) -> Value:
    """Patch by patch, in frames that follow the skin."""
    count, size = g.weights["mean"].shape
    normals = g.input("normal", (count, 3), "unit normal of each vertex in the pose, 0 where it has none")
    apart = (_pose(g) - g.weight("poses")).unsqueeze(0) @ g.weight("relevance")  # (q, t, w)
    far = ((apart * apart).sum(2).maximum(1e-12) * 3.0).apply("Sqrt") / REACH
    kernel = (1.0 + far) * (-far).apply("Exp")
    scores = (kernel.unsqueeze(1) @ g.weight("weights")).reshape(-1, g.weights["weights"].shape[2])
    of_vertex = scores.take(indices(g, "patch")).unsqueeze(2)
    local = g.weight("mean") + (g.weight("basis") @ of_vertex).reshape(count, size)
    axes = _frames(g, components(_own_position(g)), components(normals))
    frames = g.stack([g.stack(axis) for axis in axes])
    turned = rotate_coefficients(g, local, frames, config.bands)
    whole = dot(axes[0], axes[0]).unsqueeze(1) > 0.0
    found = g.where(whole, turned, unshadowed_transfer(g, normals, config.bands))
    return zero_without_normal(g, found, normals)


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
