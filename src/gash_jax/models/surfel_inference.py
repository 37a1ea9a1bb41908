"""Predictions of the surfel network, a few blocks of vertices at a time.

No block knows of another, so memory stays bounded, the intermediates stay in the cache, and one compiled function
serves every mesh. `apply_surfels` is the same as a JAX function, for derivatives and for `vmap`.
"""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.algebra.sh import band_index
from gash_jax.files.cores import available_cores
from gash_jax.graph.surfel_graph import SurfelGraph
from gash_jax.nn.surfel_net import Blocks, fall_back

# blocks that stay in the cache together, blocks per compiled call, and about how many of them a call itself costs
GROUP, CALLS, OVERHEAD = 4, (64, 32, 16, 8), 4


@partial(jax.jit, static_argnames="module")
def run_blocks(module: nn.Module, params: Any, blocks: Blocks) -> Float[Array, "v m"]:
    """Output of all vertices in the order of the blocks: encoded GROUP blocks at a time, decoded all together."""
    variables = {"params": params}
    grouped = jax.tree.map(lambda a: jnp.asarray(a).reshape(-1, GROUP, *a.shape[1:]), blocks)
    found = jax.lax.map(lambda part: module.apply(variables, part, method="encode"), grouped)
    found = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), found)
    normals = jnp.asarray(blocks["normal"]).reshape(-1, 3)
    output = module.apply(variables, *found, normals, method="decode")
    return fall_back(jnp.asarray(output), normals, module.bands)


def _filled(blocks: Blocks, size: int, xp: Any) -> dict[str, Any]:
    """The blocks, and empty ones up to `size`."""
    return {
        name: xp.concatenate([a, xp.zeros((size - len(a), *a.shape[1:]), a.dtype)]) if len(a) < size else a
        for name, a in blocks.items()
    }


def by_vertex(output: Any, slot: Any, bands: int) -> tuple[Any, Any]:
    """Coefficients and predicted error, both "v k", in the order of the mesh."""
    chosen = output[slot]
    return chosen[:, : bands**2], chosen[:, bands**2 + band_index(bands)]


def apply_surfels(module: nn.Module, params: Any, graph: SurfelGraph) -> tuple[Array, Array]:
    """Coefficients and predicted error of every vertex, as one JAX function of parameters and arrays of the graph."""
    size = -(-len(graph.blocks["normal"]) // GROUP) * GROUP
    blocks = _filled(jax.tree.map(jnp.asarray, graph.blocks), size, jnp)
    return by_vertex(run_blocks(module, params, blocks), graph.slot, module.bands)


def call_size(blocks: int, workers: int) -> int:
    """How many blocks to a call: 64, or where they are too few what keeps all workers busy with little padding."""
    if blocks >= workers * CALLS[0]:
        return CALLS[0]
    return min(CALLS, key=lambda size: -(-blocks // (size * workers)) * (size + OVERHEAD))


def compile_calls(module: nn.Module, params: Any, graph: SurfelGraph) -> None:
    """Compile the calls that predictions are made of, so that none has to: any graph of the model will do."""
    for size in CALLS:
        part = {name: a[:size] for name, a in graph.blocks.items()}
        jax.block_until_ready(run_blocks(module, params, _filled(part, size, np)))


def predict_surfels(
    module: nn.Module, params: Any, graph: SurfelGraph, workers: int | None = None
) -> tuple[Array, Array]:
    """The same on all cores, for arrays that are not traced."""
    coefficients, error = predict_on_host(module, params, graph, workers)
    return jnp.asarray(coefficients), jnp.asarray(error)


def predict_on_host(
    module: nn.Module, params: Any, graph: SurfelGraph, workers: int | None = None
) -> tuple[Float[np.ndarray, "v k"], Float[np.ndarray, "v k"]]:
    """The same as NumPy arrays: calls of one size, spread over threads.

    Nothing is compiled for a number of vertices, which even `jnp.asarray` does.
    """
    blocks, workers = graph.blocks, workers or available_cores()
    count = len(blocks["normal"])
    size = call_size(count, workers)

    def call(start: int) -> np.ndarray:
        part = {name: a[start : start + size] for name, a in blocks.items()}
        used = len(part["normal"])
        output = np.asarray(run_blocks(module, params, _filled(part, size, np)))
        return output.reshape(size, -1, output.shape[-1])[:used]

    starts = range(0, count, size)
    if workers > 1 and len(starts) > 1:
        with ThreadPoolExecutor(workers) as pool:
            outputs = list(pool.map(call, starts))
    else:
        outputs = [call(start) for start in starts]
    return by_vertex(np.concatenate(outputs).reshape(-1, outputs[0].shape[-1]), graph.slot, module.bands)
