"""Few-ray estimates of a whole mesh through the network of `nn.reconstruction`.

Vertices are worked off in blocks by threads, gathered on the host: one compiled program then serves meshes of all
sizes, and a block stays in the cache.
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

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.sh import band_index, bands_of
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.npz import read_npz
from gash_jax.graph.edge_table import edge_table
from gash_jax.nn.reconstruction import Around, Reconstruction, Seen, edge_features, reference_noise
from gash_jax.prt.few_rays import FewRays
from gash_jax.prt.tracing import in_threads

WEIGHTS = Path(str(resources.files("gash_jax"))) / "weights" / "reconstruction" / "guided.npz"
SMALL_BLOCK, BLOCK = 1024, 4096  # vertices of a block, of meshes of up to FEW vertices and of larger ones
FEW = 16384
PLACE, NORMAL, RAYS, SHARE, RESIDUAL = slice(0, 3), slice(3, 6), 6, 7, slice(8, None)


class Network(NamedTuple):
    """The module and its weights."""

    module: Reconstruction
    params: Any


class Surface(NamedTuple):
    """What the network reads of a mesh: its active vertices, in trace space, their frames, the ends of their edges."""

    places: Float[np.ndarray, "a 3"]
    normals: Float[np.ndarray, "a 3"]
    frames: Float[np.ndarray, "a 3 3"]
    table: Int[np.ndarray, "a m"]
    found: Bool[np.ndarray, "a m"]


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
    return Surface(places, normals, frames, *edge_table(faces, len(places)))


def seen_of(
    local: Float[Array, "v k"], frames: Float[Array, "v 3 3"], normals: Float[Array, "v 3"]
) -> Float[Array, "v k"]:
    """Residuals in world axes to the transfer without shadows, of estimates in the frames of their vertices."""
    world = rotate_coefficients(local, frames)
    return world - unshadowed_transfer(normals, bands_of(local.shape[-1]))


_residuals = jax.jit(seen_of)


def _seen(rows: Float[Array, "*v d"], bands: int) -> Seen:
    """What a row of the first gather says."""
    return Seen(
        rows[..., RESIDUAL],
        reference_noise(rows[..., RAYS], rows[..., SHARE], bands),
        rows[..., RAYS],
        rows[..., SHARE],
    )


@partial(jax.jit, static_argnames="module")
def _first_pass(
    module: Reconstruction, params: Any, own: Array, near: Array, found: Array
) -> tuple[Array, Array, Array]:
    """The first pass on a block -> residual and noise side by side, spread, features of the edges."""
    edges = edge_features(own[:, PLACE], own[:, NORMAL], near[..., PLACE], near[..., NORMAL], found)
    around = Around(edges, found)
    seen, spread = module.apply(
        {"params": params}, 0, _seen(own, module.bands), _seen(near, module.bands), around, method="look"
    )
    return jnp.concatenate([seen.residual, seen.noise], -1), spread, edges


@partial(jax.jit, static_argnames=("module", "index"))
def _next_pass(
    module: Reconstruction,
    index: int,
    params: Any,
    own: Array,
    near: Array,
    rest: tuple[Array, Array],
    near_rest: tuple[Array, Array],
    around: Around,
) -> tuple[Array, Array]:
    """A further pass on a block; `rest` are rays and free share."""
    k = own.shape[-1] - module.bands
    seen, spread = module.apply(
        {"params": params},
        index,
        Seen(own[..., :k], own[..., k:], *rest),
        Seen(near[..., :k], near[..., k:], *near_rest),
        around,
        method="look",
    )
    return jnp.concatenate([seen.residual, seen.noise], -1), spread


@partial(jax.jit, static_argnames="module")
def _finish(
    module: Reconstruction, params: Any, own: Array, rest: tuple[Array, Array], spread: Array, normals: Array
) -> tuple[Array, Array]:
    """Coefficients and the variance expected of each."""
    k = own.shape[-1] - module.bands
    seen = Seen(own[:, :k], own[:, k:], *rest)
    variance = module.apply({"params": params}, seen, spread, method="expected_error")
    bands = bands_of(k)
    coefficients = own[:, :k] + unshadowed_transfer(normals, bands)
    return coefficients, variance[:, np.minimum(band_index(bands), module.bands - 1)]


def reconstruct(network: Network, surface: Surface, few: FewRays) -> Rebuilt:
    """Coefficients of a mesh of which every active vertex has some rays; of at least three bands."""
    module, params = network
    count, k = few.local.shape
    rest = few.rays.astype(np.float32), few.share.astype(np.float32)
    size = SMALL_BLOCK if count <= FEW else BLOCK
    starts = [slice(start, min(start + size, count)) for start in range(0, count, size)]
    rows = np.empty((count, RESIDUAL.start + k), np.float32)
    rows[:, PLACE], rows[:, NORMAL], rows[:, RAYS], rows[:, SHARE] = surface.places, surface.normals, *rest
    tables, spreads = {}, np.empty((count, 3), np.float32)
    passed = [np.empty((count, k + module.bands), np.float32) for _ in range(module.count)]
    coefficients, variance = np.empty((count, k), np.float32), np.empty((count, k), np.float32)

    def each(work: Callable[[slice, np.ndarray], None]) -> None:
        in_threads(lambda own: work(own, np.minimum(np.arange(own.start, own.start + size), count - 1)), starts)

    def prepare(own: slice, index: np.ndarray) -> None:
        found = _residuals(few.local[index], surface.frames[index], surface.normals[index])
        rows[own, RESIDUAL] = np.asarray(found)[: own.stop - own.start]

    def first(own: slice, index: np.ndarray) -> None:
        table, found = surface.table[index], surface.found[index]
        result, spread, edges = _first_pass(module, params, rows[index], np.take(rows, table, axis=0), found)
        _keep(own, (passed[0], result), (spreads, spread))
        tables[own.start] = table, Around(edges, found)

    def further(number: int, own: slice, index: np.ndarray) -> None:
        (table, around), before = tables[own.start], passed[number - 1]
        other, near_rest = tuple(a[index] for a in rest), tuple(a[table] for a in rest)
        arguments = before[index], np.take(before, table, axis=0), other, near_rest, around
        _keep(own, *zip((passed[number], spreads), _next_pass(module, number, params, *arguments), strict=True))

    def finish(own: slice, index: np.ndarray) -> None:
        other = tuple(a[index] for a in rest)
        done = _finish(module, params, passed[-1][index], other, spreads[index], surface.normals[index])
        _keep(own, *zip((coefficients, variance), done, strict=True))

    each(prepare)
    each(first)
    for number in range(1, module.count):
        each(partial(further, number))
    each(finish)
    return Rebuilt(coefficients, variance)


def _keep(own: slice, *results: tuple[np.ndarray, Array]) -> None:
    """The rows of a block that are its own, into the arrays of the mesh."""
    for whole, block in results:
        whole[own] = np.asarray(block)[: own.stop - own.start]
