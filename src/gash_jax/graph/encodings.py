"""What a network sees of a vertex and of an edge.

Vertex: the motor M = T R of its position and normal in R(4,1) (GNN paper, 2.2), 32 numbers.

Frame: at every vertex an orthonormal frame F, columns (t, b, n), maps local to world directions. n is the normal; t is
the tangential part of the mean unit offset to the neighbours, that is, of the mean offset weighted by 1/distance.
Where that vanishes t is arbitrary (`orthonormal_frame`), and where the normal is zero F is the identity. Because t
is a direction of the geometry, F turns with the mesh: the twist that a rotor of the normal leaves open is fixed.

Edge from j to i, with offset o = p_j - p_i, d = |o|, u = F_i^T o / d and m = F_i^T n_j, 16 numbers:

    0-2    u (u_z is the cosine to the receiver's normal)
    3-7    u_x u_y, u_y u_z, (3 u_z^2 - 1) / 2, u_x u_z, (u_x^2 - u_y^2) / 2
    8      1 + log(d + 1e-4) / log(1e4): 0 at d = 0, 1 at d = 1
    9-11   s / (s + d) for s = 0.02, 0.1, 0.5
    12-14  m (m_z = n_i . n_j)
    15     n_j . o / d

Lengths are in units that the mesh itself defines (`NormalisedMesh.radius`; the bounding box would not do, as it
changes with rotation). So the features do not change when the mesh is rotated, translated or scaled with the same
edges. Nothing absolute enters. Where d = 0 all terms with o / d are 0.

Relative motor of an edge: M_i^-1 M_j, the 8 numbers of a motor (r, d), of its two signs the one with a scalar part
that is not negative. With the motors of normals it does not change when the mesh is moved; with the motors of frames,
lengths as above, neither when it is turned or scaled.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.even import MOTOR_8
from gash_jax.algebra.motors import compose, inverse, matrix_to_rotor, motor, translator
from gash_jax.algebra.numerics import safe_norm, safe_normalize

DISTANCE_FLOOR = 1e-4
DISTANCE_SCALES = (0.02, 0.1, 0.5)
# a shorter mean unit offset has no direction to rely on in float32
VANISHING_OFFSET = 1e-3
# rows per compiled call: one size for every mesh, small enough for the cache
EDGE_BLOCK = 1 << 15
VERTEX_BLOCK = 1 << 12


_motor = jax.jit(motor)


@jax.jit
def _frame_motor(positions: Array, frames: Array) -> Array:
    return compose(translator(positions), matrix_to_rotor(frames))


@jax.jit
def _relative_motor(receiver: Array, sender: Array) -> Array:
    relative = compose(inverse(receiver), sender)[:, MOTOR_8]
    return jnp.where(relative[:, :1] < 0, -relative, relative)


def _in_blocks(
    function: Callable[..., Array], rows: Callable[[slice], tuple[np.ndarray, ...]], count: int, size: int
) -> np.ndarray:
    """`function` of `count` rows, `size` at a time with zeros after the last: it compiles once for all meshes."""
    results = []
    for start in range(0, max(count, 1), size):
        arrays = rows(slice(start, start + size))
        used = len(arrays[0])
        padded = [np.concatenate([a, np.zeros((size - used, *a.shape[1:]), a.dtype)]) for a in arrays]
        results.append(np.asarray(function(*padded))[:used])
    return np.concatenate(results)


def motor_nodes(positions: Float[np.ndarray, "v 3"], normals: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "v 32"]:
    """The motor of every vertex, float32; positions in units of the graph's scale."""
    arrays = positions.astype(np.float32), normals.astype(np.float32)
    return _in_blocks(_motor, lambda block: (arrays[0][block], arrays[1][block]), len(positions), VERTEX_BLOCK)


def _unit_offsets(positions: np.ndarray, senders: np.ndarray, receivers: np.ndarray) -> np.ndarray:
    offsets = np.take(positions, senders, axis=0) - np.take(positions, receivers, axis=0)
    length = np.sqrt(np.einsum("ec,ec->e", offsets, offsets))
    return offsets / np.where(length > 0, length, 1)[:, None]


def vertex_frames(
    positions: Float[np.ndarray, "v 3"],
    normals: Float[np.ndarray, "v 3"],
    senders: Int[np.ndarray, "e"],
    receivers: Int[np.ndarray, "e"],
) -> Float[np.ndarray, "v 3 3"]:
    """Orthonormal right-handed frames, columns (tangent, bitangent, normal), float32; see the module docstring."""
    normals = np.asarray(normals, np.float64)
    units = _unit_offsets(np.asarray(positions, np.float64), senders, receivers)
    count = np.maximum(np.bincount(receivers, minlength=len(positions)), 1)
    mean = np.stack([np.bincount(receivers, units[:, i], len(positions)) for i in range(3)], -1) / count[:, None]
    tangent = mean - np.einsum("vc,vc->v", mean, normals)[:, None] * normals
    length = np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent = tangent / np.where(length > 0, length, 1)
    frames = np.stack([tangent, np.cross(normals, tangent), normals], axis=-1)
    vanishing = np.flatnonzero(length[:, 0] < VANISHING_OFFSET)
    frames[vanishing] = orthonormal_frame(normals[vanishing])
    frames[~np.any(normals, axis=1)] = np.eye(3)
    return frames.astype(np.float32)


def edge_features(
    offsets: Float[Array, "e 3"], sender_normals: Float[Array, "e 3"], frames: Float[Array, "e 3 3"]
) -> Float[Array, "e 16"]:
    """The 16 numbers of every edge from its offset, its sender's normal and its receiver's frame; differentiable."""
    d, direction = safe_norm(offsets), safe_normalize(offsets)
    x, y, z = (jnp.sum(frames[:, :, i] * direction, -1) for i in range(3))
    normal = [jnp.sum(frames[:, :, i] * sender_normals, -1) for i in range(3)]
    quadratic = [x * y, y * z, 1.5 * z * z - 0.5, x * z, 0.5 * (x * x - y * y)]
    # (3 z^2 - 1) / 2 of no direction is 0, not -1/2
    quadratic[2] = jnp.where(d > 0, quadratic[2], 0.0)
    log_distance = 1.0 - jnp.log(d + DISTANCE_FLOOR) / np.log(DISTANCE_FLOOR)
    near = [s / (s + d) for s in DISTANCE_SCALES]
    facing = jnp.sum(sender_normals * direction, -1)
    return jnp.stack([x, y, z, *quadratic, log_distance, *near, *normal, facing], axis=-1)


_edge_features = jax.jit(edge_features)


def relative_edges(
    positions: Float[np.ndarray, "v 3"],
    normals: Float[np.ndarray, "v 3"],
    frames: Float[np.ndarray, "v 3 3"],
    senders: Int[np.ndarray, "e"],
    receivers: Int[np.ndarray, "e"],
) -> Float[np.ndarray, "e 16"]:
    """`edge_features` of an edge list, float32."""

    def rows(block: slice) -> tuple[np.ndarray, ...]:
        to, origin = receivers[block], senders[block]
        offsets = np.take(positions, origin, axis=0) - np.take(positions, to, axis=0)
        return offsets, np.take(normals, origin, axis=0), np.take(frames, to, axis=0)

    return _in_blocks(_edge_features, rows, len(senders), EDGE_BLOCK)


def frame_motors(positions: Float[np.ndarray, "v 3"], frames: Float[np.ndarray, "v 3 3"]) -> Float[np.ndarray, "v 32"]:
    """The motor that takes the origin and the axes to every vertex and its frame, float32."""
    arrays = positions.astype(np.float32), frames.astype(np.float32)
    return _in_blocks(_frame_motor, lambda block: (arrays[0][block], arrays[1][block]), len(positions), VERTEX_BLOCK)


def relative_motors(
    motors: Float[np.ndarray, "v 32"], senders: Int[np.ndarray, "e"], receivers: Int[np.ndarray, "e"]
) -> Float[np.ndarray, "e 8"]:
    """M_i^-1 M_j of every edge from j to i (module docstring), float32."""

    def rows(block: slice) -> tuple[np.ndarray, ...]:
        return np.take(motors, receivers[block], axis=0), np.take(motors, senders[block], axis=0)

    return _in_blocks(_relative_motor, rows, len(senders), EDGE_BLOCK)
