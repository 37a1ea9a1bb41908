"""Glossy transfer: what a vertex sees, in 2B-1 bands, and the matrices that follow.

    M_ij(v) = integral of V(v,w) [n_v.w > 0] Y_i(w) Y_j(w) dw

takes light of B bands to the radiance that arrives at a vertex, in B bands; both are in the world. M multiplies by V
[n.w > 0], so it follows from the coefficients of that function in 2B-1 bands (`algebra.gaunt`), and these are what is
baked and stored: (2B-1)² numbers in place of B^4, which have standard errors and turn with the mesh as any other
coefficients do. A convex body has the hemisphere's H_l Y_lm(n).

Each row's replicates are turned into the world and averaged within its chunk, so that no more than two numbers for
each coefficient are kept, and compilation does not depend on the size of the mesh.
"""

from functools import partial
from math import pi
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from gash_jax.algebra.gaunt import product_matrices
from gash_jax.prt.integrands import glossy, to_world
from gash_jax.prt.tracing import Chunk, Integrand
from gash_jax.prt.transfer import Transfer

RAY_WEIGHT = 2 * pi  # of one of n uniform rays, times n: the hemisphere


def visibility_sums(bands: int) -> Integrand:
    """Visibility in 2 bands - 1 bands, in the world: for each vertex the mean of its replicates and its scatter, the
    standard error of that mean; of one replicate 0."""
    integrand = glossy(bands)
    return integrand._replace(integrate=partial(_mean_and_scatter, integrand))


def _mean_and_scatter(integrand: Integrand, chunk: Chunk) -> Float[Array, "c 2 j"]:
    return _summary(to_world(integrand.integrate(chunk), chunk.rows.frames))


@jax.jit
def _summary(replicas: Float[Array, "c r j"]) -> Float[Array, "c 2 j"]:
    mean, count = replicas.mean(1), replicas.shape[1]
    variance = jnp.sum((replicas - mean[:, None]) ** 2, axis=1) / max(count * (count - 1), 1)
    return jnp.stack([mean, jnp.sqrt(variance)], axis=1)


def visibility_entries(visibility: Float[np.ndarray, "v j"], error: Float[np.ndarray, "v j"] | None) -> dict[str, Any]:
    """What metadata says of baked visibility: its standard error, and what rounding to float16 adds to it."""
    rounding = np.abs(visibility.astype(np.float16).astype(np.float32) - visibility)
    entries = {"dtype": "float16", "rounding_rms": _rms(rounding), "rounding_largest": float(rounding.max(initial=0.0))}
    if error is None:
        return entries
    size = _rms(visibility)
    return {"relative_error": _rms(error) / size if size else None, "standard_error_rms": _rms(error), **entries}


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64)))) if values.size else 0.0


def glossy_matrices(transfer: Transfer) -> Float[Array, "v k k"]:
    """M_ij of every vertex of a glossy bake, float32: rows i are radiance that arrives, columns j light.

    Made from `visibility` by Gaunt coefficients, then symmetric, or the `matrices` that the transfer has. Works under
    jit, vmap and grad. Raises ValueError for a transfer that is not glossy.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", rays=64, glossy=True)
    >>> gash_jax.glossy_matrices(transfer).shape
    (362, 9, 9)
    """
    visibility, matrices = glossy_arrays(transfer)
    return product_matrices(visibility) if matrices is None else matrices


def glossy_arrays(transfer: object) -> tuple[Any, Any]:
    """`visibility` and `matrices` of a transfer in float32, one of them None: matrices, which may hold bounced light,
    before visibility. Raises ValueError for a transfer that has neither."""
    if not isinstance(transfer, Transfer) or (transfer.visibility is None and transfer.matrices is None):
        raise ValueError(
            "the transfer has no visibility to make gloss of: bake it with glossy=True (gash bake --glossy)"
        )
    if transfer.matrices is not None:
        return None, jnp.asarray(transfer.matrices, jnp.float32)
    return jnp.asarray(transfer.visibility, jnp.float32), None
