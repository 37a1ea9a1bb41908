"""Transfer turned by a rotation, mesh and all, as if the turned mesh had been baked.

Coefficients and visibility turn by D(R), matrices M by D M D^T, places and normals by R. Coefficients that rays
estimated have errors whose variances turn by D as well, if one knows how the errors of a band go together:

    Var(c'_i) = sum over j, k of D_ij D_ik Cov(c_j, c_k)

The file holds standard errors only. So `standard_error` and `predicted_error` turn as if errors within a band were
uncorrelated, s'_i^2 = sum_j D_ij^2 s_j^2. As D is orthogonal, the sum of squares over a band, and with it the rms error
of a transfer, is right whatever the correlations; half turns about the axes and the identity give the old errors back;
and one coefficient's error is never too small by more than a factor sqrt(2l+1). experiments/rotation measures how much
it is on bakes.
"""

from collections.abc import Callable
from typing import Any, overload

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from gash_jax.algebra.arguments import ArrayLike
from gash_jax.algebra.rotations import rotation_matrix, with_rotation
from gash_jax.algebra.sh import PRODUCT_BANDS, bands_of
from gash_jax.algebra.sh_rotation import rotate_coefficients, sh_rotation_blocks
from gash_jax.prt.transfer import Transfer, TransferLike, transfer_coefficients


@overload
def rotate_transfer(transfer: Transfer, rotation: ArrayLike | Array) -> Transfer: ...
@overload
def rotate_transfer(transfer: ArrayLike | Array, rotation: ArrayLike | Array) -> Array: ...
def rotate_transfer(transfer: TransferLike, rotation: ArrayLike | Array) -> Transfer | Array:
    """The transfer of the mesh turned by a rotation R about the origin: as baked there, but for rounding.

    `rotation` is as for `rotate_light`; turning both leaves the radiance as it is. Turned are coefficients, vertices,
    normals, `visibility` and `matrices` where there are any; standard errors as if those of a band were
    uncorrelated, so that the rms error of each band stays. `metadata["rotation"]` is the matrix that leads from
    the baked mesh to this one. An array for an array; works under jit, vmap and grad. Raises ValueError for what is no
    proper rotation.

    >>> transfer = gash_jax.bake_transfer("bunny.ply", rays=64)
    >>> light, quarter = gash_jax.load_light("studio.hdr"), np.array([0.5**0.5, 0.0, 0.5**0.5, 0.0])  # about +y
    >>> both = gash_jax.rotate_transfer(transfer, quarter), gash_jax.rotate_light(light, quarter)
    >>> bool(np.allclose(gash_jax.shade(*both), gash_jax.shade(transfer, light), atol=1e-5))
    True
    """
    matrix = rotation_matrix(rotation)
    turn = jnp.asarray(matrix, jnp.float32)
    turned = _along_bands(transfer_coefficients(transfer), turn)
    if not isinstance(transfer, Transfer):
        return turned
    return transfer._replace(
        coefficients=turned,
        standard_error=_as_kept(_turned_error, transfer.standard_error, turn),
        predicted_error=_as_kept(_turned_error, transfer.predicted_error, turn),
        visibility=_as_kept(_along_bands, transfer.visibility, turn),
        visibility_error=_as_kept(_turned_error, transfer.visibility_error, turn),
        matrices=_as_kept(_turned_matrices, transfer.matrices, turn),
        vertices=_turned_points(transfer.vertices, turn),
        normals=_turned_points(transfer.normals, turn),
        metadata=with_rotation(transfer.metadata, matrix),
    )


def _along_bands(values: Float[Array | np.ndarray, "v k *c"], turn: Array) -> Float[Array, "v k *c"]:
    """D c for coefficients on axis 1."""
    rows = jnp.moveaxis(jnp.asarray(values, jnp.float32), 1, -1)
    return jnp.moveaxis(rotate_coefficients(rows, turn), -1, 1)


def _turned_matrices(matrices: Float[Array | np.ndarray, "v k k"], turn: Array) -> Float[Array, "v k k"]:
    """D M D^T."""
    columns = rotate_coefficients(jnp.asarray(matrices, jnp.float32), turn)
    return _along_bands(columns, turn)


def _as_kept(function: Callable[[Any, Array], Array], values: Any, turn: Array) -> Array | None:
    """Turned in float32, if there are any; what was kept in float16 is so again."""
    if values is None:
        return None
    turned = function(values, turn)
    return turned.astype(jnp.float16) if values.dtype == jnp.float16 else turned


def _turned_error(error: Float[Array | np.ndarray, "v k *c"], turn: Array) -> Float[Array, "v k *c"]:
    """Square root of D_ij^2 times the squared errors."""
    variance = jnp.moveaxis(jnp.asarray(error, jnp.float32) ** 2, 1, -1)
    parts = []
    for band, block in enumerate(sh_rotation_blocks(turn, bands_of(variance.shape[-1], PRODUCT_BANDS))):
        part = variance[..., band**2 : (band + 1) ** 2]
        parts.append(jnp.matmul(part, (block**2).T, precision="highest"))
    return jnp.moveaxis(jnp.sqrt(jnp.concatenate(parts, axis=-1)), -1, 1)


def _turned_points(points: Float[Array | np.ndarray, "v 3"], turn: Array) -> Float[Array, "v 3"]:
    return jnp.matmul(jnp.asarray(points, jnp.float32), turn.T, precision="highest")
