"""Few-ray estimates of a whole mesh through the network of `nn.reconstruction`.

Vertices are worked off in blocks by threads, gathered on the host: one compiled program then serves meshes of all
sizes, and a block stays in the cache. Where nothing is hidden around a vertex there is nothing to do: on many meshes
that is a third to two thirds of the vertices.
"""

from collections.abc import Callable
from functools import cache, partial
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax.traverse_util import unflatten_dict
from jaxtyping import Array, Bool, Float, Int

from gash_jax.algebra.closed_forms import clamped_cosine_coefficients
from gash_jax.algebra.sh import bands_of, sh_components
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.npz import read_npz
from gash_jax.graph.edge_table import edge_table
from gash_jax.nn.reconstruction import (
    Around,
    Reconstruction,
    Seen,
    bands_used,
    edge_features,
    reference_noise,
    rough_variance,
)
from gash_jax.prt.few_rays import FewRays
from gash_jax.prt.tracing import in_threads

WEIGHTS = Path(str(resources.files("gash_jax"))) / "weights" / "reconstruction" / "guided.npz"
# vertices of a block, and up to how many vertices it is so small: few blocks leave a core idle, small ones take longer
BLOCKS = ((1024, 4096), (2048, 16384), (4096, None))
QUIET_STEP = 32  # of the vertices that have nothing hidden around them one in so many is looked at
PLACE, NORMAL, RAYS, SHARE, RESIDUAL = slice(0, 3), slice(3, 6), 6, 7, slice(8, None)


class Network(NamedTuple):
    """The module and its weights."""

    module: Reconstruction
    params: Any


class Surface(NamedTuple):
    """What the network reads of a mesh: its active vertices, in trace space, their frames, the ends of their edges.

    The table is that of `edge_table` turned over: the network has vertices as the last axis.
    """

    places: Float[np.ndarray, "a 3"]
    normals: Float[np.ndarray, "a 3"]
    frames: Float[np.ndarray, "a 3 3"]
    table: Int[np.ndarray, "m a"]
    found: Bool[np.ndarray, "m a"]

    def unshadowed(self, bands: int) -> Float[np.ndarray, "a k"]:
        """Transfer without shadows: of many normals NumPy is as fast as anything, one component after the other."""
        factors = (clamped_cosine_coefficients(bands) / np.pi).astype(np.float32)
        x, y, z = np.ascontiguousarray(self.normals.T, np.float32)
        return np.stack([f * c for f, c in zip(factors, sh_components(x, y, z, bands), strict=True)], axis=1)


class Rebuilt(NamedTuple):
    """Coefficients in world axes, and the mean square error that is expected of each."""

    coefficients: Float[np.ndarray, "a k"]
    variance: Float[np.ndarray, "a k"]


@cache
def shipped_network() -> Network:
    """The network that ships. Raises FileError where its file is damaged."""
    return load_network(WEIGHTS)


def load_network(path: Path) -> Network:
    """A network of a file of weights by `experiments.guided.train`. Raises FileError."""
    arrays, metadata = read_npz(path, "reconstruction", ())
    params = unflatten_dict({tuple(name.split("/")): jnp.asarray(array) for name, array in arrays.items()})
    return Network(Reconstruction(*metadata["sizes"]), params)


def make_surface(
    places: Float[np.ndarray, "v 3"],
    normals: Float[np.ndarray, "v 3"],
    frames: Float[np.ndarray, "a 3 3"],
    faces: Int[np.ndarray, "f 3"],
    active: Int[np.ndarray, "a"],
) -> Surface:
    """The active vertices of a mesh, with their frames, and the edges between them."""
    if len(active) < len(places):
        number = np.full(len(places), -1, np.int32)
        number[active] = np.arange(len(active), dtype=np.int32)
        faces = number[faces]
        faces = faces[(faces >= 0).all(axis=1)]
        places, normals = places[active], normals[active]
    table, found = edge_table(faces, len(places))
    return Surface(places, normals, frames, np.ascontiguousarray(table.T), np.ascontiguousarray(found.T))


@jax.jit
def _residuals(local: Array, frames: Array) -> Array:
    """Residuals "k c" in world axes to the transfer without shadows, of estimates in the frames of their vertices."""
    bands = bands_of(local.shape[-1])
    upright = clamped_cosine_coefficients(bands) / np.pi * np.array(sh_components(0.0, 0.0, 1.0, bands))
    return rotate_coefficients(local - jnp.asarray(upright, local.dtype)[None], frames).T


def _seen(rows: Float[Array, "d *v"], bands: int) -> Seen:
    """What the rows of the first gather say."""
    rays, share = rows[RAYS], rows[SHARE]
    return Seen(rows[RESIDUAL], reference_noise(rays, share, bands), rays, share)


@partial(jax.jit, static_argnames="module")
def _look(module: Reconstruction, params: Any, own: Array, near: Array, found: Array) -> tuple[Array, Around]:
    """The first pass on a block, "d c" and "d m c" -> residual, noise, rays and share one below the other; edges."""
    around = Around(edge_features(own[PLACE], own[NORMAL], near[PLACE], near[NORMAL], found), found)
    both = _seen(own, module.bands), _seen(near, module.bands)
    seen: Any = module.apply({"params": params}, *both, around, method="look")
    return jnp.concatenate([seen.residual, seen.noise, seen.rays[None], seen.share[None]]), around


@partial(jax.jit, static_argnames=("module", "k"))
def _look_again(module: Reconstruction, k: int, params: Any, own: Array, near: Array, around: Around) -> Array:
    """The second pass on what the first gave -> residual "k c", and below it the variance expected in each band."""
    both = (Seen(rows[:k], rows[k:-2], rows[-2], rows[-1]) for rows in (own, near))
    found: Any = module.apply({"params": params}, *both, around, method="look_again")
    return jnp.concatenate(found)


def _around_hidden(surface: Surface, share: Float[np.ndarray, "a"]) -> Bool[np.ndarray, "a"]:
    """Vertices with something hidden from them or from one within two edges; passes leave the others as they are."""
    near = share < 1
    for _ in range(2):
        near = _and_neighbours(near, surface)
    return near


def _and_neighbours(chosen: Bool[np.ndarray, "a"], surface: Surface) -> Bool[np.ndarray, "a"]:
    return chosen | chosen[surface.table].any(axis=0)  # a blank of the table is the vertex itself


def reconstruct(network: Network, surface: Surface, few: FewRays) -> Rebuilt:
    """Coefficients of a mesh of which every active vertex has some rays; of at least three bands."""
    module, params = network
    count, k = few.local.shape
    used = min(module.bands, bands_of(k))
    rows = np.empty((RESIDUAL.start + k, count), np.float32)
    rows[PLACE], rows[NORMAL], rows[RAYS], rows[SHARE] = surface.places.T, surface.normals.T, few.rays, few.share
    rows[RESIDUAL] = 0  # as it is where all rays are free
    law = rough_variance(rows[RAYS], rows[SHARE])
    once = np.concatenate([rows[RESIDUAL], np.broadcast_to(law, (used, count)), rows[[RAYS, SHARE]]])
    twice = np.zeros((k + used, count), np.float32)
    changes = _around_hidden(surface, few.share)
    quiet = np.flatnonzero(~changes)
    asked = changes.copy()
    asked[quiet[::QUIET_STEP]] = True  # the error that is expected of them serves for all such
    hidden, chosen = np.flatnonzero(few.share < 1), np.flatnonzero(_and_neighbours(asked, surface))
    size = next(size for size, most in BLOCKS if most is None or len(chosen) <= most)
    arounds: dict[int, Around] = {}

    def in_blocks(index: np.ndarray, work: Callable[[int, np.ndarray], Any], results: np.ndarray) -> None:
        """Write what `work` makes of blocks of vertices; the last block is filled up with its last vertex."""

        def of_block(start: int) -> None:
            own = index[start : start + size]
            results[:, own] = np.asarray(work(start, np.pad(own, (0, size - len(own)), "edge")))[:, : len(own)]

        in_threads(of_block, range(0, len(index), size))

    def residuals(_: int, own: np.ndarray) -> Array:
        return _residuals(few.local[own], surface.frames[own])

    def look(start: int, own: np.ndarray) -> Array:
        near = np.take(rows, surface.table[:, own], axis=1)
        found, arounds[start] = _look(module, params, rows[:, own], near, surface.found[:, own])
        return found

    def look_again(start: int, own: np.ndarray) -> Array:
        near = np.take(once, surface.table[:, own], axis=1)
        return _look_again(module, k, params, once[:, own], near, arounds[start])

    in_blocks(hidden, residuals, rows[RESIDUAL])
    in_blocks(chosen, look, once)
    in_blocks(chosen, look_again, twice)
    if len(quiet):
        some = quiet[::QUIET_STEP]
        twice[:k, quiet] = 0
        twice[k:, quiet] = (twice[k:, some] / law[some]).mean(axis=1, keepdims=True) * law[quiet]
    return Rebuilt(twice[:k].T + surface.unshadowed(bands_of(k)), twice[k:].T[:, bands_used(k, used)])
