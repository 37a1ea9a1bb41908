"""The table of visibility backends: a name becomes a function here and nowhere else."""

import numpy as np
from jaxtyping import Float, Int

from gash_jax.prt.brute_force import brute_force_visibility
from gash_jax.prt.embree import embree_visibility
from gash_jax.prt.rays import VisibilityFn

BACKENDS = {"embree": embree_visibility, "jax": brute_force_visibility}


def visibility(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], backend: str = "embree"
) -> VisibilityFn:
    """Build the scene for a backend, "embree" or "jax" (every ray against every triangle: small meshes only)."""
    if backend not in BACKENDS:
        raise ValueError(f"unknown visibility backend {backend!r}: choose one of {', '.join(BACKENDS)}")
    return BACKENDS[backend](vertices, faces)
