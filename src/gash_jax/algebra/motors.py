"""Points, rotors, translators and motors (rigid motions) of R(4,1).

A point x is the null vector X = x + x^2 e_inf/2 + e_o, with X . Y = -|x - y|^2 / 2. A rotor R turns x to R x ~R.
The rotor of a unit normal n turns e_y = e2 to n by the half-angle method:

    R = n' e_y,  n' = (n + e_y) / |n + e_y|,  so  R = n'_y + n'_x e12 - n'_z e23.

A translator is T = 1 - t e_inf/2; a motor M = T R is even with M ~M = 1 and moves a point by first turning, then
shifting it. M and -M are the same motion.

Every motor reads M = R - (t R) e_inf/2. With the pseudoscalar I = e123, central in the algebra of e1, e2, e3, both
parts are quaternions w + x i + y j + z k, i = -e23, j = e13, k = -e12: R = r and -(t R)/2 = d I, d = -t r / 2. This
dual quaternion (r, d) is how motors are composed and read here. The dense product would sum terms of size
|t1| |t2| that cancel only in exact arithmetic (e_inf^2 = 0); the dual quaternion never forms them.

float32 error, u = 2^-24, for |x|, |y|, |t| <= r:
    extract_point(embed_point(x))               below 2 u (r + r^3); nothing is left from r = 4096 on, where the
                                                weight (e- minus e+ coefficient) is lost beneath r^2/2
    -2 X . Y against |x - y|^2                  below 2 u (1 + r^2)^2: 1e-3 in a short distance at r = 1
    extract_point(sandwich(M, embed_point(x)))  below 40 u r (1 + r^2): 2e-3 at r = 10, 2 at r = 100
    apply_motor(M, x)                           below 16 u r, at any r
So distances come from positions, and points are moved by `apply_motor`.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra import cga
from gash_jax.algebra.arguments import check_last_axis
from gash_jax.algebra.numerics import safe_norm, safe_normalize

Points = Float[Array | np.ndarray, "... 3"]
Multivector = Float[Array | np.ndarray, "... 32"]


def _multivector(parts: dict[int, Array]) -> Float[Array, "... 32"]:
    """Place arrays of one shape at their blades, zero elsewhere."""
    zero = jnp.zeros_like(next(iter(parts.values())))
    return jnp.stack([parts.get(blade, zero) for blade in range(32)], axis=-1)


@jax.jit
def embed_point(x: Points) -> Float[Array, "... 32"]:
    """Conformal point X = x + x^2 e_inf/2 + e_o.

    >>> points = gash_jax.embed_point(np.array([[1.0, 2.0, 3.0]]))
    >>> float(gash_jax.geometric_product(points, points)[0, 0])
    0.0
    """
    x = jnp.asarray(x)
    check_last_axis("points", x, 3)
    half_square = 0.5 * jnp.sum(x * x, axis=-1)
    return _multivector(
        {
            cga.E1: x[..., 0],
            cga.E2: x[..., 1],
            cga.E3: x[..., 2],
            cga.EP: half_square - 0.5,
            cga.EM: half_square + 0.5,
        }
    )


@jax.jit
def extract_point(point: Multivector) -> Float[Array, "... 3"]:
    """Position of a conformal point of any weight -X . e_inf other than zero."""
    point = jnp.asarray(point)
    weight = point[..., cga.EM] - point[..., cga.EP]
    return jnp.stack([point[..., blade] / weight for blade in (cga.E1, cga.E2, cga.E3)], axis=-1)


@jax.jit
def rotor_from_normal(normals: Points) -> Float[Array, "... 32"]:
    """Rotor that turns e_y to each unit normal along the shortest arc.

    Near -e_y the sum 1 + n_y is taken as (n_x^2 + n_z^2)/(1 - n_y), which does not cancel. At n = -e_y itself every
    half turn about a horizontal axis would do; the one about z is taken, R = e12. A zero normal gives R = 1.

    >>> gash_jax.rotor_from_normal(np.array([0.0, 1.0, 0.0]))[0].item()
    1.0
    """
    n = jnp.asarray(normals)
    check_last_axis("normals", n, 3)
    x, y, z = n[..., 0], n[..., 1], n[..., 2]
    one_plus_y = jnp.where(y < 0.0, (x * x + z * z) / (1.0 + jnp.abs(y)), 1.0 + y)
    half = safe_normalize(jnp.stack([x, one_plus_y, z], axis=-1))
    at_pole = jnp.all(half == 0.0, axis=-1)
    return _multivector(
        {
            cga.SCALAR: half[..., 1],
            cga.E12: jnp.where(at_pole, 1.0, half[..., 0]),
            cga.E23: -half[..., 2],
        }
    )


def _from_dual_quaternion(real: Array, dual: Array) -> Float[Array, "... 32"]:
    """Multivector of r + d I e_inf, quaternions (w, x, y, z) on the last axis."""
    d_w, d_x, d_y, d_z = (dual[..., axis] for axis in range(4))
    parts = {
        cga.SCALAR: real[..., 0],
        cga.E23: -real[..., 1],
        cga.E13: real[..., 2],
        cga.E12: -real[..., 3],
    }
    for plus, minus, part in (
        (cga.E1P, cga.E1M, d_x),
        (cga.E2P, cga.E2M, d_y),
        (cga.E3P, cga.E3M, d_z),
        (cga.E123P, cga.E123M, d_w),
    ):
        parts[plus] = parts[minus] = part
    return _multivector(parts)


def _quaternion(m: Multivector) -> Float[Array, "... 4"]:
    """Rotor part of a motor as quaternion (w, x, y, z)."""
    m = jnp.asarray(m)
    check_last_axis("motors", m, 32)
    return jnp.stack([m[..., cga.SCALAR], -m[..., cga.E23], m[..., cga.E13], -m[..., cga.E12]], axis=-1)


def _dual_quaternion(m: Multivector) -> tuple[Float[Array, "... 4"], Float[Array, "... 4"]]:
    """Motor as r + d I e_inf; the e_inf part is the mean of the e+ and e- coefficients."""
    m = jnp.asarray(m)
    check_last_axis("motors", m, 32)
    blades = ((cga.E123P, cga.E123M), (cga.E1P, cga.E1M), (cga.E2P, cga.E2M), (cga.E3P, cga.E3M))
    dual = jnp.stack([0.5 * (m[..., plus] + m[..., minus]) for plus, minus in blades], axis=-1)
    return _quaternion(m), dual


def _multiply(a: Array, b: Array) -> Float[Array, "... 4"]:
    """Quaternion product."""
    (aw, ax, ay, az), (bw, bx, by, bz) = (tuple(q[..., axis] for axis in range(4)) for q in (a, b))
    return jnp.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def _conjugate(q: Array) -> Float[Array, "... 4"]:
    return jnp.concatenate([q[..., :1], -q[..., 1:]], axis=-1)


def _pure(vector: Array) -> Float[Array, "... 4"]:
    return jnp.concatenate([jnp.zeros_like(vector[..., :1]), vector], axis=-1)


@jax.jit
def translator(t: Points) -> Float[Array, "... 32"]:
    """Translator T = 1 - t e_inf/2."""
    dual = _pure(-0.5 * jnp.asarray(t))
    return _from_dual_quaternion(jnp.zeros_like(dual).at[..., 0].set(1.0), dual)


@jax.jit
def motor(positions: Points, normals: Points) -> Float[Array, "... 32"]:
    """Motor M = T R that takes the origin to a position and e_y to a unit normal; shapes are equal.

    >>> m = gash_jax.motor(np.array([[1.0, 2.0, 3.0]]), np.array([[0.0, 1.0, 0.0]]))
    >>> m.shape
    (1, 32)
    """
    shapes = np.shape(positions), np.shape(normals)
    if shapes[0] != shapes[1]:
        raise ValueError(f"positions have shape {shapes[0]}, normals {shapes[1]}: give a normal for each position")
    real = _quaternion(rotor_from_normal(normals))
    return _from_dual_quaternion(real, _multiply(_pure(-0.5 * jnp.asarray(positions)), real))


@jax.jit
def compose(m1: Multivector, m2: Multivector) -> Float[Array, "... 32"]:
    """Geometric product m1 m2 of two motors: the motion m2 followed by m1. Leading shapes broadcast."""
    m1, m2 = jnp.asarray(m1), jnp.asarray(m2)
    shape = jnp.broadcast_shapes(m1.shape, m2.shape)
    (r1, d1), (r2, d2) = (_dual_quaternion(jnp.broadcast_to(m, shape)) for m in (m1, m2))
    return _from_dual_quaternion(_multiply(r1, r2), _multiply(r1, d2) + _multiply(d1, r2))


def inverse(m: Multivector) -> Float[Array, "... 32"]:
    """Inverse of a unit motor, which is its reverse."""
    return cga.reverse(m)


@jax.jit
def rotor_to_matrix(rotor: Multivector) -> Float[Array, "... 3 3"]:
    """Rotation matrix of a unit rotor, or of the rotor part of a unit motor.

    >>> rotor = gash_jax.rotor_from_normal(np.array([1.0, 0.0, 0.0]))
    >>> (gash_jax.rotor_to_matrix(rotor) @ np.array([0.0, 1.0, 0.0])).round(6).tolist()
    [1.0, 0.0, 0.0]
    """
    return jnp.asarray(quaternion_to_matrix(_quaternion(rotor)))


def quaternion_to_matrix(quaternion: Float[Array | np.ndarray, "... 4"]) -> Float[Array | np.ndarray, "... 3 3"]:
    """Rotation matrix of a unit quaternion (w, x, y, z); NumPy in, NumPy out; JAX in, JAX out."""
    xp = jnp if isinstance(quaternion, jax.Array) else np
    w, x, y, z = (quaternion[..., axis] for axis in range(4))
    rows = (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )
    return xp.stack([xp.stack(row, axis=-1) for row in rows], axis=-2)


@jax.jit
def turn_vectors(rotor: Multivector, vectors: Points) -> Float[Array, "... 3"]:
    """Vectors turned by unit rotors, x -> R x ~R; leading shapes broadcast.

    The sandwich written out: of R = w - I u, with u a vector and I = e123, R x ~R = x + w a + u x a, a = 2 u x x. So no
    matrix is formed, and of the 2 x 1024 products of two geometric products only 18 remain.

    >>> from gash_jax.algebra.motors import rotor_from_normal, turn_vectors
    >>> turn_vectors(rotor_from_normal(np.array([1.0, 0.0, 0.0])), np.array([0.0, 1.0, 0.0])).round(6).tolist()
    [1.0, 0.0, 0.0]
    """
    quaternion, vectors = _quaternion(rotor), jnp.asarray(vectors)
    check_last_axis("vectors", vectors, 3)
    shape = (*jnp.broadcast_shapes(quaternion.shape[:-1], vectors.shape[:-1]), 3)
    axis, vectors = jnp.broadcast_to(quaternion[..., 1:], shape), jnp.broadcast_to(vectors, shape)
    across = 2.0 * jnp.cross(axis, vectors)
    return vectors + jnp.broadcast_to(quaternion[..., :1], shape) * across + jnp.cross(axis, across)


@jax.jit
def matrix_to_rotor(rotation: Float[Array | np.ndarray, "... 3 3"]) -> Float[Array, "... 32"]:
    """Unit rotor of a rotation matrix, its scalar part not negative.

    The matrix fixes 4 q q^T of the quaternion q; the row with the largest diagonal element is q up to a factor of at
    least 1, so half turns lose no accuracy.
    """
    m = jnp.asarray(rotation)
    m00, m01, m02, m10, m11, m12, m20, m21, m22 = (m[..., row, column] for row in range(3) for column in range(3))
    rows = (
        (1.0 + m00 + m11 + m22, m21 - m12, m02 - m20, m10 - m01),
        (m21 - m12, 1.0 + m00 - m11 - m22, m10 + m01, m02 + m20),
        (m02 - m20, m10 + m01, 1.0 - m00 + m11 - m22, m21 + m12),
        (m10 - m01, m02 + m20, m21 + m12, 1.0 - m00 - m11 + m22),
    )
    outer = jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
    best = jnp.argmax(jnp.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    q = safe_normalize(jnp.take_along_axis(outer, best[..., None, None], axis=-2)[..., 0, :])
    q = jnp.where(q[..., :1] < 0.0, -q, q)
    return _from_dual_quaternion(q, jnp.zeros_like(q))


@jax.jit
def motor_to_rigid(m: Multivector) -> tuple[Float[Array, "... 3 3"], Float[Array, "... 3"]]:
    """Rotation matrix and translation of a unit motor: x -> rotation x + translation.

    >>> m = gash_jax.motor(np.array([[1.0, 2.0, 3.0]]), np.array([[1.0, 0.0, 0.0]]))
    >>> rotation, translation = gash_jax.motor_to_rigid(m)
    >>> translation.round(6).tolist(), (rotation[0] @ np.array([0.0, 1.0, 0.0])).round(6).tolist()
    ([[1.0, 2.0, 3.0]], [1.0, 0.0, 0.0])
    """
    real, dual = _dual_quaternion(m)
    return rotor_to_matrix(m), -2.0 * _multiply(dual, _conjugate(real))[..., 1:]


@jax.jit
def apply_motor(m: Multivector, points: Points) -> Float[Array, "... 3"]:
    """Move points by unit motors; leading shapes broadcast.

    They are moved by the extracted rotation and translation, accurate at any distance: the pure sandwich m X ~m
    carries squared distances, and its float32 error (module docstring) passes 1e-3 from |x| = 10 on.
    """
    points = jnp.asarray(points)
    rotation, translation = motor_to_rigid(m)
    shape = (*jnp.broadcast_shapes(translation.shape[:-1], points.shape[:-1]), 3)
    rotation = jnp.broadcast_to(rotation, (*shape, 3))
    turned = jnp.sum(rotation * jnp.broadcast_to(points, shape)[..., None, :], axis=-1)
    return turned + jnp.broadcast_to(translation, shape)


@jax.jit
def renormalize(m: Multivector) -> Float[Array, "... 32"]:
    """Nearest unit motor: removes the drift of M ~M that rounding builds up over many compositions."""
    real, dual = _dual_quaternion(m)
    length = safe_norm(real)[..., None]
    real, dual = real / length, dual / length
    # The dual part of a motor is orthogonal to its rotor: t = -2 d ~r has no scalar part.
    along = jnp.sum(real * dual, axis=-1, keepdims=True)
    return _from_dual_quaternion(real, dual - real * along)
