"""Möller–Trumbore in JAX: every ray against every triangle. Slow, simple, the oracle of the fast one.

Möller & Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", JGT 1997. Two-sided. A ray o + t d meets
triangle (a, b, c) where t > 0, u >= 0, v >= 0, u + v <= 1 in

    o + t d = (1 - u - v) a + u b + v c.

Rays in the plane of a triangle (determinant 0) do not meet it. Of triangles at one distance the first is the nearest.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from gash_jax.prt.rays import ClosestHitFn, Hits, VisibilityFn

RAYS_PER_BLOCK = 256


def intersect(
    origin: Float[Array, "3"], direction: Float[Array, "3"], corners: Float[Array, "f 3 3"]
) -> tuple[Float[Array, "f"], Float[Array, "f"], Float[Array, "f"], Float[Array, "f"]]:
    """(determinant, t, u, v) of one ray with every triangle; t is infinite where the determinant is 0."""
    edge1 = corners[:, 1] - corners[:, 0]
    edge2 = corners[:, 2] - corners[:, 0]
    p = jnp.cross(direction[None], edge2)
    determinant = jnp.sum(p * edge1, -1)
    inverse = jnp.where(determinant == 0, 0.0, 1.0 / jnp.where(determinant == 0, 1.0, determinant))
    s = origin[None] - corners[:, 0]
    q = jnp.cross(s, edge1)
    u = jnp.sum(s * p, -1) * inverse
    v = jnp.sum(q * direction[None], -1) * inverse
    t = jnp.where(determinant == 0, jnp.inf, jnp.sum(edge2 * q, -1) * inverse)
    return determinant, t, u, v


def _meets(
    determinant: Float[Array, "f"], t: Float[Array, "f"], u: Float[Array, "f"], v: Float[Array, "f"]
) -> Bool[Array, "f"]:
    return (determinant != 0) & (t > 0) & (u >= 0) & (v >= 0) & (u + v <= 1)


@partial(jax.jit, static_argnames="block")
def _occluded(
    origins: Float[Array, "r 3"], directions: Float[Array, "r 3"], corners: Float[Array, "f 3 3"], block: int
) -> Bool[Array, "r"]:
    def one(ray: Float[Array, "2 3"]) -> Bool[Array, ""]:
        return jnp.any(_meets(*intersect(ray[0], ray[1], corners)))

    return jax.lax.map(one, jnp.stack([origins, directions], 1), batch_size=block)


@partial(jax.jit, static_argnames="block")
def _nearest(
    origins: Float[Array, "r 3"], directions: Float[Array, "r 3"], corners: Float[Array, "f 3 3"], block: int
) -> tuple[Int[Array, "r"], Float[Array, "r"], Float[Array, "r"], Float[Array, "r"]]:
    def one(ray: Float[Array, "2 3"]) -> tuple[Array, Array, Array, Array]:
        determinant, t, u, v = intersect(ray[0], ray[1], corners)
        distance = jnp.where(_meets(determinant, t, u, v), t, jnp.inf)
        face = jnp.argmin(distance)
        hit = jnp.isfinite(distance[face])
        return (
            jnp.where(hit, face, -1).astype(jnp.int32),
            jnp.where(hit, u[face], 0.0),
            jnp.where(hit, v[face], 0.0),
            distance[face],
        )

    return jax.lax.map(one, jnp.stack([origins, directions], 1), batch_size=block)


def brute_force_visibility(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> VisibilityFn:
    """The same contract as `embree_visibility`, for small meshes: cost is rays times faces."""
    corners = jnp.asarray(np.asarray(vertices, np.float32)[faces])

    def visible(origins: Float[np.ndarray, "r 3"], directions: Float[np.ndarray, "r 3"]) -> Bool[np.ndarray, "r"]:
        occluded = _occluded(jnp.asarray(origins), jnp.asarray(directions), corners, block=RAYS_PER_BLOCK)
        return ~np.asarray(occluded)

    return visible


def brute_force_closest_hit(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> ClosestHitFn:
    """The same contract as `embree_closest_hit`, for small meshes: cost is rays times faces."""
    corners = jnp.asarray(np.asarray(vertices, np.float32)[faces])

    def closest(origins: Float[np.ndarray, "r 3"], directions: Float[np.ndarray, "r 3"]) -> Hits:
        found = _nearest(jnp.asarray(origins), jnp.asarray(directions), corners, block=RAYS_PER_BLOCK)
        return Hits(*(np.asarray(a) for a in found))

    return closest
