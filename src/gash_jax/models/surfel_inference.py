"""Predictions of the surfel network, a few vertices at a time.

No vertex knows of another, so memory stays bounded, the intermediates stay in the cache, and a few compiled functions
serve every mesh: one for each width of list up to what is pooled, and one for the rest. `apply_surfels` is the same as
a JAX function, for derivatives and `vmap`.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.algebra.sh import band_index
from gash_jax.files.cores import available_cores
from gash_jax.graph.surfel_graph import Part, SurfelGraph, with_surfels
from gash_jax.graph.surfel_lists import WIDTHS, call_size

# in a call of the second half
VERTICES = 1024


@partial(jax.jit, static_argnames="module")
def encode_part(module: nn.Module, params: Any, part: Part) -> tuple[Array, Array, Array]:
    """What `SurfelNet.encode` finds of some vertices whose lists have one width."""
    return module.apply({"params": params}, part, method="encode")  # type: ignore[return-value]


@partial(jax.jit, static_argnames="module")
def decode_found(module: nn.Module, params: Any, found: Any, normals: Array) -> Float[Array, "n m"]:
    """What the network says of some vertices, of lists of any width."""
    return module.apply({"params": params}, *found, normals, method="decode")  # type: ignore[return-value]


def _filled(arrays: Any, size: int) -> Any:
    """Arrays of some vertices, cut or with zeros to `size` of them."""
    return jax.tree.map(lambda a: a[:size] if len(a) >= size else _longer(a, size), arrays)


def _longer(a: np.ndarray, size: int) -> np.ndarray:
    return np.concatenate([a, np.zeros((size - len(a), *a.shape[1:]), a.dtype)])


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
    empty = [{name: array[:0] for name, array in part.items()} for part in graph.parts]
    parts = [_filled(with_surfels(part, graph.records), call_size(w)) for part, w in zip(empty, WIDTHS, strict=True)]
    found = [encode_part(module, params, part) for part in parts][-1]
    normals = np.zeros((VERTICES, 3), np.float32)
    jax.block_until_ready(decode_found(module, params, _filled(jax.tree.map(np.asarray, found), VERTICES), normals))


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
    """What the network says of all vertices of the parts in turn: calls of few sizes, spread over threads."""
    workers = workers or available_cores()
    calls = [
        (part, start, call_size(width))
        for part, width in zip(graph.parts, WIDTHS, strict=True)
        for start in range(0, len(part["normal"]), call_size(width))
    ]

    def encode(given: tuple[Part, int, int]) -> tuple[np.ndarray, ...]:
        part, start, size = given
        own = with_surfels({name: a[start : start + size] for name, a in part.items()}, graph.records)
        found = encode_part(module, params, _filled(own, size))
        return tuple(np.asarray(array)[: len(own["normal"])] for array in found)

    def decode(start: int) -> np.ndarray:
        found, own = (_filled(jax.tree.map(lambda a: a[start:], arrays), VERTICES) for arrays in (encoded, normals))
        return np.asarray(decode_found(module, params, found, own))[: len(normals) - start]

    if not calls:  # a mesh without vertices
        return np.zeros((0, (module.bounces + 1) * (module.bands**2 + module.bands)), np.float32)
    normals = np.concatenate([part["normal"] for part in graph.parts])
    with ThreadPoolExecutor(workers) as pool:
        encoded = tuple(np.concatenate(arrays) for arrays in zip(*pool.map(encode, calls), strict=True))
        return np.concatenate(list(pool.map(decode, range(0, len(normals), VERTICES))))
