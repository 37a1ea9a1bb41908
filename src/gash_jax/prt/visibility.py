"""The table of ray backends: a name becomes a function here and nowhere else."""

from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from gash_jax.prt.brute_force import brute_force_closest_hit, brute_force_visibility
from gash_jax.prt.embree import embree_closest_hit, embree_visibility
from gash_jax.prt.rays import ClosestHitFn, RayQuery, VisibilityFn
from gash_jax.prt.warp_rays import warp_closest_hit, warp_visibility

VISIBILITY = {"embree": embree_visibility, "jax": brute_force_visibility, "warp": warp_visibility}
CLOSEST_HIT = {"embree": embree_closest_hit, "jax": brute_force_closest_hit, "warp": warp_closest_hit}


def _known(backend: str) -> str:
    if backend not in VISIBILITY:
        raise ValueError(f"unknown ray backend {backend!r}: choose one of {', '.join(VISIBILITY)}")
    return backend


def visibility(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], backend: str = "embree"
) -> VisibilityFn:
    """Build the scene for a backend: "embree", "jax" (every ray against every triangle: small meshes only) or "warp"
    (NVIDIA Warp, on a GPU where there is one; the extra `warp`).

    Raises ValueError for another, and for one that is not installed.
    """
    return VISIBILITY[_known(backend)](vertices, faces)


def closest_hit(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], backend: str = "embree"
) -> ClosestHitFn:
    """As `visibility`, but the function says which face a ray meets first, and where."""
    return CLOSEST_HIT[_known(backend)](vertices, faces)


def ray_query(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    query: Literal["any", "closest"],
    backend: str = "embree",
) -> RayQuery:
    """The scene's function for what an integrand asks: `visibility` for "any", `closest_hit` for "closest"."""
    return (visibility if query == "any" else closest_hit)(vertices, faces, backend)
