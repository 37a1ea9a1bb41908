"""Glossy transfer: what a vertex sees, in 2B-1 bands, and the matrices that follow.

    M_ij(v) = integral of V(v,w) [n_v.w > 0] Y_i(w) Y_j(w) dw

takes light of B bands to the radiance that arrives at a vertex, in B bands; both are in the world. M multiplies by V
[n.w > 0], so it follows from the coefficients of that function in 2B-1 bands (`algebra.gaunt`), and these are what is
baked and stored: (2B-1)² numbers in place of B^4, which have standard errors and turn with the mesh as any other
coefficients do. A convex body has the hemisphere's H_l Y_lm(n).

With light that bounces, surfaces send back what they receive: M_ij += integral of (1 - V) Y_i(w) albedo(y) t_j(y) dw,
y what w meets first, t the diffuse transfer of all bounces but the last (`bounces`). Such matrices are not symmetric,
and are stored themselves. Light that meets a face from behind is lost, as in diffuse transfer.

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
from gash_jax.algebra.sh import evaluate_sh
from gash_jax.prt.error_bars import standard_error_floor
from gash_jax.prt.integrands import glossy, to_world
from gash_jax.prt.rays import Hits, RayQuery
from gash_jax.prt.reflection import Reflected, values_at_hits
from gash_jax.prt.sampling import UNIFORM
from gash_jax.prt.tracing import Chunk, Integrand, ProgressFn, Rows, trace_rows
from gash_jax.prt.transfer import Transfer

RAY_WEIGHT = 2 * pi  # of one of n uniform rays, times n: the hemisphere


def check_reflections(glossy: bool, coloured: bool) -> None:
    """Raise ValueError for glossy transfer off coloured surfaces: matrices are of one colour."""
    if glossy and coloured:
        raise ValueError(
            "glossy transfer has no room for coloured reflections: give a grey albedo, one number a vertex"
        )


def gloss_sums(bands: int, reflected: Reflected | None = None) -> Integrand:
    """Visibility in 2 bands - 1 bands, in the world, or with reflected light matrices, flat: for each vertex the mean
    of its replicates and its scatter, the standard error of that mean; of one replicate 0."""
    return Integrand(UNIFORM, "any" if reflected is None else "closest", partial(_mean_and_scatter, bands, reflected))


def _mean_and_scatter(bands: int, reflected: Reflected | None, chunk: Chunk) -> Float[Array, "c 2 j"]:
    hits = chunk.answer
    free = chunk._replace(answer=hits.face < 0) if isinstance(hits, Hits) else chunk
    seen = to_world(glossy(bands).integrate(free), chunk.rows.frames)
    if reflected is None:
        return _summary(seen)
    assert isinstance(hits, Hits)
    found = [_values(reflected, hits, chunk.directions, row) for row in range(chunk.directions.shape[1])]
    return _summary(_matrices(seen, chunk.directions, np.stack(found, axis=1), bands))


def _values(reflected: Reflected, hits: Hits, directions: np.ndarray, row: int) -> Float[np.ndarray, "c n k"]:
    """What the rays of one replicate find, in that replicate's own chain."""
    own = Hits(*(answer[:, row] for answer in hits))
    return values_at_hits(reflected.surface, own, directions[:, row], reflected.sent[:, row])


@partial(jax.jit, static_argnames="bands")
def _matrices(
    seen: Float[Array, "c r j"],
    directions: Float[Array | np.ndarray, "c r n 3"],
    found: Float[Array | np.ndarray, "c r n k"],
    bands: int,
) -> Float[Array, "c r m"]:
    """Matrices of what is seen, plus the mean over rays of 2 pi Y_i(w) times what is found there."""
    weight = RAY_WEIGHT / found.shape[2]
    bounced = jnp.einsum("crni,crnj->crij", evaluate_sh(directions, bands), found, precision="highest") * weight
    return (product_matrices(seen) + bounced).reshape(*seen.shape[:2], -1)


@jax.jit
def _summary(replicas: Float[Array, "c r j"]) -> Float[Array, "c 2 j"]:
    mean, count = replicas.mean(1), replicas.shape[1]
    variance = jnp.sum((replicas - mean[:, None]) ** 2, axis=1) / max(count * (count - 1), 1)
    return jnp.stack([mean, jnp.sqrt(variance)], axis=1)


def bake_gloss(
    rows: Rows,
    bands: int,
    rays: int,
    query: RayQuery,
    part: slice = slice(None),
    reflected: Reflected | None = None,
    progress: ProgressFn | None = None,
) -> tuple[Float[np.ndarray, "a j"], Float[np.ndarray, "a j"] | None]:
    """Visibility of the rows `part` in 2 bands - 1 bands, N = `rays` uniform rays in all, and its standard error; with
    `reflected` light matrices (bands² x bands², flat) in its place.

    One replicate is the plain mean, without an error.
    """
    count = rows.shifts.shape[1]
    plain = np.zeros(len(rows.origins), np.float32) if count == 1 else None
    integrand = gloss_sums(bands, reflected)
    sums, share = trace_rows(rows, integrand, rays // count, query, share=plain, part=part, progress=progress)
    mean, scatter = np.moveaxis(sums[part], 1, 0)
    if count == 1 or reflected is not None:
        return mean, None if count == 1 else scatter
    return mean, np.maximum(scatter, standard_error_floor(2 * bands - 1, rays, share[part], RAY_WEIGHT))


def gloss_entries(found: Float[np.ndarray, "a j"], error: Float[np.ndarray, "a j"] | None) -> dict[str, Any]:
    """What metadata says of baked visibility or matrices: their standard error, and what rounding to float16 adds."""
    rounding = np.abs(found.astype(np.float16).astype(np.float32) - found)
    entries = {"dtype": "float16", "rounding_rms": _rms(rounding), "rounding_largest": float(rounding.max(initial=0.0))}
    if error is None:
        return entries
    size = _rms(found)
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
