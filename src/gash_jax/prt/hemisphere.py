"""Binary visibility in a few fixed directions: what the two-stage network's first net learns.

The GNN paper (4.2.1) asks for 25 directions on the hemisphere and does not say which. Here they are spherical-
Fibonacci points, uniform in solid angle, in one of two frames:

    of the vertex   about +y, carried to each vertex by the rotor of its normal (the paper's R = n' e_y), so that
                    direction i means the same thing at every vertex up to the rotor's own twist
    of the world    over the whole sphere, the same for every vertex; those below its horizon are not visible
"""

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from gash_jax.algebra.directions import fibonacci_hemisphere, spherical_fibonacci
from gash_jax.algebra.motors import rotor_from_normal, rotor_to_matrix
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.visibility import visibility

DIRECTIONS = 25


@jax.jit
def _rotations(normals: Float[Array | np.ndarray, "v 3"]) -> Float[Array, "v 3 3"]:
    return rotor_to_matrix(rotor_from_normal(normals))


def hemisphere_directions(
    normals: Float[np.ndarray, "v 3"], count: int = DIRECTIONS, *, world: bool = False
) -> Float[np.ndarray, "v n 3"]:
    """Directions of every vertex: Fibonacci points about +y turned by the rotor that takes +y to the normal.

    With `world` those of the whole sphere, the same at every vertex (and one array in memory).
    """
    if world:
        return np.broadcast_to(spherical_fibonacci(count).astype(np.float32), (len(normals), count, 3))
    about_z = fibonacci_hemisphere(count)
    about_y = np.stack([about_z[:, 0], about_z[:, 2], -about_z[:, 1]], -1).astype(np.float32)
    padded = np.zeros((1 << (max(len(normals), 2) - 1).bit_length(), 3), np.float32)
    padded[: len(normals)] = normals
    rotations = np.asarray(_rotations(padded))[: len(normals)]
    return np.einsum("vij,nj->vni", rotations, about_y)


def above_horizon(
    normals: Float[np.ndarray, "v 3"], count: int = DIRECTIONS, *, world: bool = False
) -> Bool[np.ndarray, "v n"]:
    """Which directions can be visible at all: all of the vertex's, about half of the world's; none without a normal."""
    if world:
        return normals @ spherical_fibonacci(count).astype(np.float32).T > 0
    return np.repeat(np.any(normals != 0, axis=1)[:, None], count, axis=1)


def hemisphere_visibility(
    mesh: Mesh, count: int = DIRECTIONS, backend: str = "embree", *, world: bool = False
) -> Bool[np.ndarray, "v n"]:
    """True where a vertex sees out along its n-th direction; False everywhere at a vertex without a normal.

    The directions are those of the vertex, or with `world` those of the world.
    """
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces, backend)
    directions = hemisphere_directions(mesh.normals, count, world=world)
    origins = np.broadcast_to(geometry.origins[:, None], directions.shape)
    flat = (np.ascontiguousarray(a.reshape(-1, 3), np.float32) for a in (origins, directions))
    free = visible(*flat).reshape(len(mesh.vertices), count)
    return free & above_horizon(mesh.normals, count, world=world)
