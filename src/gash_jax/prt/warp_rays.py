"""Rays by NVIDIA Warp's mesh queries, on a GPU where JAX has one: the only file that imports it.

https://github.com/NVIDIA/warp, an extra, called through its JAX interface on the first device of JAX. On a CPU it gives
the same answers several times slower than Embree. How fast it is on a GPU was not measured.
"""

from collections.abc import Callable
from functools import cache
from typing import Any, no_type_check

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.prt.rays import ClosestHitFn, Hits, VisibilityFn

FAR = 1e10  # beyond anything in trace space, where a mesh has size 1


def _library() -> Any:
    try:
        import warp  # type: ignore[import-not-found]
    except ImportError:
        raise ValueError(
            'the ray backend "warp" needs NVIDIA Warp, which is not installed: pip install warp-lang '
            '(or gash-jax[warp]), or take "embree"'
        ) from None
    warp.config.log_level = warp.LOG_ERROR  # else it says what it found and compiled
    return warp


@cache
def _kernels() -> tuple[Any, Any]:
    """Functions of origins, directions and the number of a mesh: whether a ray meets it; face, and weights with t."""
    warp = _library()

    @no_type_check  # Warp reads its source, which nothing may wrap
    def meets(origins: Any, directions: Any, number: Any, hit: Any):
        i = warp.tid()
        mesh = warp.uint64(number[0]) | (warp.uint64(number[1]) << warp.uint64(32))
        hit[i] = warp.int32(warp.mesh_query_ray(mesh, origins[i], directions[i], FAR).result)

    @no_type_check
    def nearest(origins: Any, directions: Any, number: Any, face: Any, where: Any):
        i = warp.tid()
        mesh = warp.uint64(number[0]) | (warp.uint64(number[1]) << warp.uint64(32))
        found = warp.mesh_query_ray(mesh, origins[i], directions[i], FAR)
        face[i] = warp.where(found.result, found.face, -1)
        where[i] = warp.vec3(found.u, found.v, found.t)

    vectors, numbers = warp.array(dtype=warp.vec3), warp.array(dtype=warp.int32)
    rays = {"origins": vectors, "directions": vectors, "number": warp.array(dtype=warp.uint32)}
    meets.__annotations__ = {**rays, "hit": numbers}
    nearest.__annotations__ = {**rays, "face": numbers, "where": vectors}
    return warp.jax_kernel(warp.Kernel(meets)), warp.jax_kernel(warp.Kernel(nearest), num_outputs=2)


def _scene(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], kernel: Any) -> Callable[..., Any]:
    """The kernel for a mesh, whose tree is on the device of JAX and lives as long as the function."""
    warp = _library()
    device = warp.device_from_jax(jax.devices()[0])
    points = warp.array(vertices.astype(np.float32), dtype=warp.vec3, device=device)
    corners = warp.array(faces.astype(np.int32).ravel(), dtype=warp.int32, device=device)
    mesh = warp.Mesh(points=points, indices=corners)

    def ask(origins: np.ndarray, directions: np.ndarray) -> list[np.ndarray]:
        # 64 bits, which JAX has not, in two halves
        number = jnp.asarray(np.array([mesh.id], np.uint64).view(np.uint32))
        rays = jnp.asarray(origins), jnp.asarray(directions)
        dims = {"launch_dims": len(origins), "output_dims": len(origins)}
        return [np.asarray(found) for found in kernel(*rays, number, **dims)]

    return ask


def warp_visibility(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> VisibilityFn:
    """The same contract as `embree_visibility`. Raises ValueError where Warp is not installed."""
    meets = _scene(vertices, faces, _kernels()[0])

    def visible(origins: Float[np.ndarray, "r 3"], directions: Float[np.ndarray, "r 3"]) -> Bool[np.ndarray, "r"]:
        if not len(origins):
            return np.ones(0, bool)
        return meets(origins, directions)[0] == 0

    return visible


def warp_closest_hit(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> ClosestHitFn:
    """The same contract as `embree_closest_hit`. Raises ValueError where Warp is not installed."""
    nearest = _scene(vertices, faces, _kernels()[1])

    def closest(origins: Float[np.ndarray, "r 3"], directions: Float[np.ndarray, "r 3"]) -> Hits:
        if not len(origins):
            return Hits(np.zeros(0, np.int32), *(np.zeros(0, np.float32) for _ in range(3)))
        face, where = nearest(origins, directions)
        missed, (first, second, distance) = face < 0, where.T
        # Warp's weights are those of the first and second corner
        u, v = np.where(missed, 0, second), np.where(missed, 0, 1 - first - second)
        return Hits(face, u, v, np.where(missed, np.float32(np.inf), distance))

    return closest
