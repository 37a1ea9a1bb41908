"""Spherical harmonics, their rotation and frames of vertices as ONNX nodes.

The mathematics is that of `algebra`, which has the derivations: `sh`, `sh_rotation`, `closed_forms`, `directions`.
"""

import math

import numpy as np

from gash_jax.algebra import cga
from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.directions import POLE
from gash_jax.algebra.sh import sh_components
from gash_jax.algebra.sh_rotation import fixed_system
from gash_jax.apps.exports.graph import Graph, Value

TINY = float(np.finfo(np.float32).tiny)


def components(vectors: Value, axis: int = -1) -> list[Value]:
    """x, y and z."""
    return [vectors.take(i, axis) for i in range(3)]


def dot(a: list[Value], b: list[Value]) -> Value:
    """Of vectors by component."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def has_normal(normals: Value) -> Value:
    """Whether a normal (v, 3) is not 0, (v, 1)."""
    return normals.apply("Abs").max(-1, keep=True) > 0.0


def zero_without_normal(g: Graph, x: Value, normals: Value) -> Value:
    """x (v, k), and exactly 0 where the normal is 0."""
    return g.where(has_normal(normals), x, 0.0)


def unshadowed_transfer(g: Graph, normals: Value, bands: int) -> Value:
    """The closed form A_l Y_k(n) / pi, (v, k); 0 where the normal is 0."""
    x, y, z = components(normals)
    basis = g.stack(sh_components(x, y, z, bands))
    return zero_without_normal(g, basis * (clamped_cosine_coefficients(bands) / math.pi), normals)


def rotate_coefficients(g: Graph, coefficients: Value, rotation: Value, bands: int) -> Value:
    """Coefficients (v, k) of the function turned by rotations (v, 3, 3), band by band."""
    parts = []
    for band in range(bands):
        part = coefficients.take(np.arange(band**2, (band + 1) ** 2), 1)
        if band == 1:
            order = np.array([1, 2, 0])
            matrix = rotation.take(order, 1).take(order, 2)
            part = (matrix * part.unsqueeze(1)).sum(2)
        elif band > 1:
            directions, inverse = fixed_system(band)
            turned = rotation @ directions.T  # (v, 3, n)
            x, y, z = components(turned, 1)
            basis = g.stack(sh_components(x, y, z, band + 1)[band * band :], 1)
            part = (basis * (part @ inverse.T).unsqueeze(1)).sum(2)
        parts.append(part)
    return g.concat(parts, 1) if bands > 1 else parts[0]


def rotor_matrices(g: Graph, motor: Value) -> Value:
    """Rotation (v, 3, 3) of the rotor of each motor (v, 32)."""
    w, x, y, z = (
        motor.take(cga.SCALAR, 1),
        -motor.take(cga.E23, 1),
        motor.take(cga.E13, 1),
        -motor.take(cga.E12, 1),
    )
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return g.stack([g.stack(row) for row in rows], 1)


def unit_vectors(g: Graph, vector: list[Value]) -> list[Value]:
    """Of length 1, or 0 where they are 0; divided by the largest component first, so that no square underflows."""
    x, y, z = (component.apply("Abs") for component in vector)
    largest = x.maximum(y).maximum(z)
    exists = largest > TINY
    scaled = [component / g.where(exists, largest, 1.0) for component in vector]
    length = dot(scaled, scaled).apply("Sqrt")
    return [g.where(exists, component / g.where(exists, length, 1.0), 0.0) for component in scaled]


def cross(a: list[Value], b: list[Value]) -> list[Value]:
    """Of vectors by component."""
    return [a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3)]


def any_tangent(g: Graph, normal: list[Value]) -> list[Value]:
    """The first column of the shortest turn from +z to the normal; at -z the half turn about y."""
    x, y, z = normal
    largest = x.apply("Abs").maximum(y.apply("Abs"))
    off_pole = largest > POLE
    scale = g.where(off_pole, largest, 1.0)
    u, v = g.where(off_pole, x / scale, 1.0), y / scale
    lower = (1.0 - z) / (u * u + v * v)
    upper = 1.0 / (1.0 + z.apply("Abs"))
    below = z < 0.0
    xx, xy = g.where(below, u * u * lower, x * x * upper), g.where(below, u * v * lower, x * y * upper)
    return [1.0 - xx, -xy, -x]
