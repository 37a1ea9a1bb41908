"""`SurfelNet.encode` on the host, by compiled loops: `surfel_kernel` over pairs, `corner_kernel` over corners.

XLA compiles the same formulas for whoever needs derivatives, `vmap` or an accelerator.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from gash_jax.nn import corner_kernel, surfel_kernel
from gash_jax.nn import surfel_pairs as given
from gash_jax.nn.corner_kernel import CORNERS
from gash_jax.nn.surfel_kernel import MOST
from gash_jax.nn.surfel_pairs import Part


def _layer(params: Any, features: int) -> np.ndarray:
    """W and b of a layer, one channel a row."""
    kernel, bias = (np.asarray(params[name], np.float32) for name in ("kernel", "bias"))
    if len(kernel) != features:
        raise ValueError(f"a layer of {len(kernel)} features: `surfel_encode` knows {features}, use `SurfelNet.encode`")
    return np.ascontiguousarray(np.concatenate([kernel, bias[None]]).T)


def encode_on_host(
    params: Any, part: Part, records: Any
) -> tuple[Float[np.ndarray, "v c"], Float[np.ndarray, "v 3 3"], Float[np.ndarray, "v"]]:
    """What `SurfelNet.encode` finds of a part with its `table`, rows of the `records` (s, 20).

    Raises ValueError for lists, corners or layers that it is not made for.
    """
    width, corners = part["table"].shape[1], part["near"].shape[1] // 6
    if width > MOST or corners != CORNERS:
        raise ValueError(
            f"lists of {width} surfels and {corners} corners: `surfel_encode` takes up to {MOST} and {CORNERS}"
        )
    names = ("position", "normal", "near", "cover", "weight")
    # read-only arrays, as those of JAX are, would be compiled for anew
    position, normal, near, cover, weight = (np.require(part[name], np.float32, ["C", "W"]) for name in names)
    table, records = np.require(part["table"], np.int32, ["C", "W"]), np.require(records, np.float32, ["C", "W"])
    layer, corner_layer = (
        _layer(params["surfel"], surfel_kernel.FEATURE_COUNT),
        _layer(params["near"], corner_kernel.FEATURE_COUNT),
    )
    count, channels = len(position), 2 * (len(layer) + len(corner_layer)) + 6
    pooled, frames = np.empty((count, channels), np.float32), np.empty((count, 3, 3), np.float32)
    seen, rise = np.empty(count, np.float32), np.empty(count, np.float32)
    floor, tiny, rounding = map(np.float32, (given.FLOOR, given.TINY, given.ROUNDING))
    edge_on = np.float32(given.EDGE_ON / (4 * np.pi))
    constants = (floor, tiny, rounding, np.float32(given.SMALLEST_AREA), np.float32(given.FARTHEST), edge_on)
    turning = (given.TINY, given.EVEN, given.FAINT, np.cos(given.ASIDE), np.sin(given.ASIDE))
    arrays = (records, position, normal, near, cover, table, weight)
    surfel_kernel.encode(arrays, layer, constants, tuple(map(np.float32, turning)), pooled, frames, seen)
    corner_kernel.pool_corners(near, normal, frames, corner_layer, constants[:3], 2 * len(layer), pooled, rise)
    return pooled, frames, seen + rise
