"""Predictions of the surfel network, a few vertices at a time.

No vertex knows of another, so memory stays bounded, the intermediates stay in the cache, and two compiled functions
serve every mesh: up to what is pooled one of Numba (`nn.surfel_encode`), and for the rest one of JAX, for so many
vertices at a time. `apply_surfels` is the same as a JAX function, for derivatives and `vmap`.
"""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.algebra.sh import band_index
from gash_jax.files.cores import in_threads
from gash_jax.graph.surfel_graph import Part, SurfelGraph, with_surfels
from gash_jax.graph.surfel_lists import call_size
from gash_jax.nn.surfel_encode import encode_on_host

# vertices in a call; meshes of few take small ones
FEW, VERTICES = 256, 1024


@partial(jax.jit, static_argnames="module")
def decode_found(module: nn.Module, params: Any, found: Any, normals: Array) -> Float[Array, "n m"]:
    """What the network says of some vertices, of lists of any width."""
    return module.apply({"params": params}, *found, normals, method="decode")  # type: ignore[return-value]


class Terms(NamedTuple):
    """Of every vertex the direct coefficients and what each bounce adds off white surfaces, and their RMS errors."""

    coefficients: Any  # (i, v, k)
    errors: Any  # (i, v, k), the same for all coefficients of a band


def by_vertex(output: Any, slot: Any, bands: int, bounces: int = 0) -> Terms:
    """What the network says, in the order of the mesh."""
    chosen, k, each = output[slot], bands**2, range(bounces + 1)
    errors = [chosen[:, k * (bounces + 1) + i * bands + band_index(bands)] for i in each]
    xp = np if isinstance(output, np.ndarray) else jnp
    return Terms(xp.stack([chosen[:, i * k : (i + 1) * k] for i in each]), xp.stack(errors))


def apply_surfels(module: nn.Module, params: Any, graph: SurfelGraph) -> tuple[Array, Array]:
    """Coefficients and predicted error of every vertex, as one JAX function of parameters and arrays of the graph."""
    variables, records = {"params": params}, jnp.asarray(graph.records)

    def encode(part: Part) -> Any:
        return module.apply(variables, with_surfels(part, records, jnp), method="encode")

    def encoded(part: Part) -> Any:
        count, width = part["weight"].shape
        size = call_size(width)
        if count <= size:
            return encode(part)
        # a few vertices at a time, whose pairs stay in the cache
        filled = jax.tree.map(lambda a: jnp.pad(jnp.asarray(a), ((0, -count % size), *((0, 0),) * (a.ndim - 1))), part)
        grouped = jax.tree.map(lambda a: a.reshape(-1, size, *a.shape[1:]), filled)
        found = jax.lax.map(encode, grouped)
        return jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:])[:count], found)

    parts = [part for part in graph.parts if len(part["normal"])] or graph.parts[:1]
    found = jax.tree.map(lambda *arrays: jnp.concatenate(arrays), *(encoded(part) for part in parts))
    normals = jnp.concatenate([jnp.asarray(part["normal"]) for part in parts])
    output = module.apply(variables, *found, normals, method="decode")
    terms = by_vertex(output, graph.slot, module.bands)
    return terms.coefficients[0], terms.errors[0]


def compile_calls(module: nn.Module, params: Any, graph: SurfelGraph) -> None:
    """Compile the calls that predictions are made of, so that none has to: any graph of the model will do."""
    none = {name: array[:0] for name, array in graph.parts[0].items()}
    found = encode_on_host(params, none, graph.records)
    for size in (FEW, VERTICES):
        jax.block_until_ready(decode_found(module, params, *_filled(found, none["normal"], size)))


def predict_surfels(
    module: nn.Module, params: Any, graph: SurfelGraph, workers: int | None = None
) -> tuple[Array, Array]:
    """The same on all cores, for arrays that are not traced."""
    coefficients, error = predict_on_host(module, params, graph, workers)
    return jnp.asarray(coefficients), jnp.asarray(error)


def predict_on_host(
    module: nn.Module, params: Any, graph: SurfelGraph, workers: int | None = None
) -> tuple[Float[np.ndarray, "v k"], Float[np.ndarray, "v k"]]:
    """The same as NumPy arrays.

    Nothing is compiled for a number of vertices, which even `jnp.asarray` does.
    """
    terms = by_vertex(_outputs(module, params, graph, workers), graph.slot, module.bands)
    return terms.coefficients[0], terms.errors[0]


def predict_bounces(module: nn.Module, params: Any, graph: SurfelGraph, bounces: int) -> Terms:
    """Direct transfer and what each of so many bounces adds, as NumPy arrays."""
    module = module.clone(bounces=bounces)
    return by_vertex(_outputs(module, params, graph, None), graph.slot, module.bands, bounces)


def _outputs(module: nn.Module, params: Any, graph: SurfelGraph, workers: int | None) -> Float[np.ndarray, "n m"]:
    """What the network says of all vertices of the parts in turn, in calls of one size."""
    normals = np.concatenate([part["normal"] for part in graph.parts])
    if not len(normals):
        return np.zeros((0, (module.bounces + 1) * (module.bands**2 + module.bands)), np.float32)
    starts = np.cumsum([0, *(len(part["normal"]) for part in graph.parts)]).tolist()
    size = FEW if len(normals) <= VERTICES // 2 else VERTICES

    def call(start: int) -> np.ndarray:
        stop = min(start + size, len(normals))
        found = [
            encode_on_host(params, {name: a[max(start - first, 0) : stop - first] for name, a in part.items()}, records)
            for part, first, end in zip(graph.parts, starts[:-1], starts[1:], strict=True)
            if first < stop and start < end
        ]
        # seldom of more than one part
        together = tuple(np.concatenate(a) for a in zip(*found, strict=True)) if len(found) > 1 else found[0]
        return np.asarray(decode_found(module, params, *_filled(together, normals[start:stop], size)))[: stop - start]

    records = np.require(graph.records, np.float32, ["C", "W"])  # copied here, if at all, and not in every call
    return np.concatenate(in_threads(call, range(0, len(normals), size), workers))


def _filled(found: tuple[np.ndarray, ...], normals: np.ndarray, size: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """What was found of some vertices, and their normals, with zeros to the size of a call."""
    missing = size - len(normals)
    if not missing:
        return found, normals
    longer = [np.concatenate([a, np.zeros((missing, *a.shape[1:]), a.dtype)]) for a in (*found, normals)]
    return tuple(longer[:-1]), longer[-1]
