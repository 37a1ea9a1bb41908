"""What a patch of the surface reads of a pose: where other points are, seen from it, and how alike two poses are to it.

*Axes.* Of a patch some vertices are anchors. With c their middle and r their places in the rest, along its two longest
axes, the vectors d_j = sum_n r_nj (p_n - c) go with the patch; x is along d_1, y along what of d_2 is across it, z
along x cross y. Seen in these axes from c nothing changes when the body moves as a whole.

*Groups.* A patch reads `POINTS` points, and makes of their places, in diagonals of the rest and less the means over
the training, `WAYS` numbers, in `GROUPS` groups. Either the points are those nearest to the patch, the numbers are the
directions in which they vary most, nearer ones counting more, and poses are alike if all of them agree; or a group is a
part of the body, told by the three directions in which its points vary most, and what each part does to the patch is
added up. The first suits a face, whose lips and eyelids change in many ways, the second limbs, of which each throws a
shadow of its own. `surroundings_fit` takes for each patch that which errs less on poses left out.

With f the numbers that a kernel compares and f' those of a training pose, it is Matern's of order 3/2, (1 + s) exp(-s)
with s = sqrt(3) |f - f'| / REACH (Rasmussen & Williams 2006, 4.17).
"""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from gash_jax.algebra.numerics import safe_normalize

GROUPS, WAYS, POINTS = 8, 24, 32
REACH = 2.0
FAR = 1e6  # no coordinate, in diagonals of the rest, and no number counts beyond it: sums of squares are finite

SURROUNDINGS: dict[str, tuple[int | str, ...]] = {
    "anchors": ("q", "a"),
    "axes": ("q", "a", 2),
    "unit": (1,),
    "points": ("q", POINTS),
    "still": ("q", POINTS, 3),
    "into": ("q", 3 * POINTS, WAYS),
    "together": ("q",),
    "amounts": ("q", GROUPS),
    "known": ("q", WAYS, "m"),
}


def matern(squares: Float[Any, "..."]) -> Float[Any, "..."]:
    """The kernel of squared distances of f (module docstring)."""
    xp = squares.__array_namespace__()
    far = xp.sqrt(3 * xp.maximum(squares, 1e-12)) / REACH  # the root of 0 has no gradient
    return (1 + far) * xp.exp(-far)


def patch_axes(
    positions: Float[Array, "v 3"], anchors: Int[Any, "q a"], axes: Float[Any, "q a 2"]
) -> tuple[Float[Array, "q 3"], Float[Array, "q 3 3"]]:
    """Middles of the patches and their axes, one a row; 0 where the anchors have collapsed."""
    placed = positions[anchors]
    middle = placed.mean(axis=1)
    vectors = jnp.einsum("qaj,qai->qji", axes, placed - middle[:, None])
    first = safe_normalize(vectors[:, 0])
    across = vectors[:, 1] - jnp.sum(vectors[:, 1] * first, axis=1, keepdims=True) * first
    second = safe_normalize(across)
    return middle, jnp.stack([first, second, jnp.cross(first, second)], axis=1)


def seen_points(
    positions: Float[Array, "v 3"], anchors: Int[Any, "q a"], axes: Float[Any, "q a 2"], points: Int[Any, "q n"]
) -> Float[Array, "q n 3"]:
    """Points as they are seen from their patches."""
    middle, rows = patch_axes(positions, anchors, axes)
    return jnp.einsum("qij,qnj->qni", rows, positions[points] - middle[:, None])


def pose_kernel(arrays: Mapping[str, Any], positions: Float[Array, "v 3"]) -> Float[Array, "q m"]:
    """The kernel of a pose and of the poses that each patch knows."""
    anchors, points = (arrays[name].astype(jnp.int32) for name in ("anchors", "points"))
    apart = seen_points(positions, anchors, arrays["axes"], points) / arrays["unit"][None, None] - arrays["still"]
    told = jnp.einsum("qc,qcw->qw", jnp.clip(apart, -FAR, FAR).reshape(len(apart), -1), arrays["into"])
    told = jnp.clip(told, -FAR, FAR)
    squares = (arrays["known"] - told[:, :, None]) ** 2  # (q, w, m)
    squares = jnp.sum(squares.reshape(len(told), GROUPS, -1, squares.shape[-1]), axis=2)
    whole = arrays["amounts"][:, :1] * matern(jnp.sum(squares, axis=1))
    added = jnp.sum(arrays["amounts"][:, :, None] * matern(squares), axis=1)
    return jnp.where(arrays["together"][:, None] > 0, whole, added)
