"""Binary visibility in a few fixed directions of the hemisphere: what the two-stage network's first net learns.

The GNN paper (4.2.1) asks for 25 directions on the hemisphere and does not say which. Here they are spherical-
Fibonacci points, uniform in solid angle about +y, carried to each vertex by the rotor of its normal (the paper's
R = n' e_y), so that direction i means the same thing at every vertex up to the rotor's own twist.
"""

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from gash_jax.algebra.directions import fibonacci_hemisphere
from gash_jax.algebra.motors import rotor_from_normal, rotor_to_matrix
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.visibility import visibility

DIRECTIONS = 25


@jax.jit
def _rotations(normals: Float[Array | np.ndarray, "v 3"]) -> Float[Array, "v 3 3"]:
    return rotor_to_matrix(rotor_from_normal(normals))


def hemisphere_directions(normals: Float[np.ndarray, "v 3"], count: int = DIRECTIONS) -> Float[np.ndarray, "v n 3"]:
    """Directions of every vertex: Fibonacci points about +y turned by the rotor that takes +y to the normal."""
    about_z = fibonacci_hemisphere(count)
    about_y = np.stack([about_z[:, 0], about_z[:, 2], -about_z[:, 1]], -1).astype(np.float32)
    padded = np.zeros((1 << (max(len(normals), 2) - 1).bit_length(), 3), np.float32)
    padded[: len(normals)] = normals
    rotations = np.asarray(_rotations(padded))[: len(normals)]
    return np.einsum("vij,nj->vni", rotations, about_y)


def hemisphere_visibility(mesh: Mesh, count: int = DIRECTIONS, backend: str = "embree") -> Bool[np.ndarray, "v n"]:
    """True where a vertex sees out along its n-th direction; False everywhere at a vertex without a normal."""
    geometry = trace_geometry(mesh)
    visible = visibility(geometry.vertices, geometry.faces, backend)
    directions = hemisphere_directions(mesh.normals, count)
    origins = np.broadcast_to(geometry.origins[:, None], directions.shape)
    flat = (np.ascontiguousarray(a.reshape(-1, 3), np.float32) for a in (origins, directions))
    free = visible(*flat).reshape(len(mesh.vertices), count)
    return free & np.any(mesh.normals != 0, axis=1)[:, None]
