"""How many directions each patch of `deform` keeps, and how they are stored.

Most of a surface hardly changes its shadows, and a few patches (lips, eyelids) change them in many ways, so the bytes
of a model go where they take away most error: directions come in levels of 1, 1, 2, 4, ... of them, and the level that
takes away most per byte is added until the size is reached. A direction of a patch costs a byte for each coefficient of
its vertices and 4 for each pose that the patch knows: its entries are whole numbers up to 127, and what one of them is
worth is in its weights.

Patches are numbered by how many levels they have, most first, and the rows of the tables are sorted by patch. So a
level belongs to the first patches and to the first rows, and its table ends there.
"""

import heapq
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

LEVELS = (1, 1, 2, 4, 8, 16, 32)
ENDS = tuple(np.cumsum((0, *LEVELS)).tolist())  # directions before each level, and of all
MEGABYTE = 1e6
LARGEST = 127  # entry of a direction
LEVEL_SHAPES: dict[str, tuple[int | str, ...]] = {
    name: shape
    for number, width in enumerate(LEVELS)
    for name, shape in (
        (f"directions/{number}", (f"rows {number}", "k", width)),
        (f"weights/{number}", (f"patches {number}", "m", width)),
    )
}


class Patches(NamedTuple):
    """Regressions of all patches with all their directions."""

    patch: Int[np.ndarray, "v"]
    mean: Float[np.ndarray, "v k"]
    basis: Float[np.ndarray, "v k r"]  # float16
    weights: Float[np.ndarray, "q m r"]
    energy: Float[np.ndarray, "q r"]  # of each direction over the training poses


def share_levels(
    energy: Float[np.ndarray, "q r"], vertices: Int[np.ndarray, "q"], k: int, poses: int, room: float
) -> Int[np.ndarray, "q"]:
    """How many levels each patch gets, of so many vertices each, for `room` bytes in all."""
    given = np.zeros(len(energy), int)

    def entry(patch: int) -> tuple[float, float, int]:
        level = int(given[patch])
        gain = float(energy[patch, ENDS[level] : ENDS[level + 1]].sum())
        cost = float(LEVELS[level] * (k * vertices[patch] + 4 * poses))
        return -gain / cost, cost, patch

    waiting = [entry(patch) for patch in np.flatnonzero(vertices).tolist()]
    heapq.heapify(waiting)
    while waiting:
        gain, cost, patch = heapq.heappop(waiting)
        if gain == 0 or cost > room:
            continue
        room -= cost
        given[patch] += 1
        if given[patch] < len(LEVELS):
            heapq.heappush(waiting, entry(patch))
    return given


def as_whole_numbers(patches: Patches) -> tuple[Int[np.ndarray, "v k r"], Float[np.ndarray, "q m r"]]:
    """Directions as whole numbers from -127 to 127, and the weights for them."""
    largest = np.zeros((len(patches.weights), patches.basis.shape[-1]), np.float32)
    np.maximum.at(largest, patches.patch, np.abs(patches.basis).max(axis=1).astype(np.float32))
    worth = np.maximum(largest, 1e-30) / LARGEST
    numbers = np.rint(patches.basis / worth[patches.patch][:, None]).astype(np.int8)
    return numbers, patches.weights * worth[:, None]


def level_arrays(patches: Patches, room: float) -> dict[str, np.ndarray]:
    """The tables of a model of so many bytes, and the order of its patches."""
    count, k, poses = len(patches.energy), patches.mean.shape[1], patches.weights.shape[1]
    given = share_levels(patches.energy, np.bincount(patches.patch, minlength=count), k, poses, room)
    order = np.argsort(-given, kind="stable")
    patch = np.argsort(order)[patches.patch]  # in the new numbers
    rows = np.argsort(patch, kind="stable")
    numbers, weights = as_whole_numbers(patches)
    found = {"order": order, "patch": patch[rows], "row": np.argsort(rows), "mean": patches.mean[rows]}
    for level in range(len(LEVELS)):
        kept, part = int((given > level).sum()), slice(ENDS[level], ENDS[level + 1])
        found[f"weights/{level}"] = weights[order[:kept], :, part]
        found[f"directions/{level}"] = numbers[rows[: int((patch < kept).sum())], :, part]
    return found


def say_levels(arrays: dict[str, Any], kernel: Float[Array, "q m"]) -> Float[Array, "v k"]:
    """What all patches say, given their kernels of a pose; a row for each vertex."""
    patch, found = arrays["patch"].astype(jnp.int32), arrays["mean"]
    for level in range(len(LEVELS)):
        weights, directions = arrays[f"weights/{level}"], arrays[f"directions/{level}"]
        scores = jnp.einsum("qm,qmr->qr", kernel[: len(weights)], weights)
        if count := len(directions):
            found = found.at[:count].add(jnp.sum(directions * scores[patch[:count]][:, None], axis=-1))
    return found[arrays["row"].astype(jnp.int32)]
