"""Batches and inference of the surfel network, whose graph falls into independent blocks of vertices.

Because no block knows of another, a training batch is drawn from the blocks of all shapes alike, and a prediction goes
through the mesh a few blocks at a time: memory stays bounded, the intermediates stay in the cache, and one compiled
function serves every mesh.

Shapes weigh in the loss by 1 / (their closed form's MSE + SOFTENING x its median), so that it is their skill that is
minimised and not the error of the darkest. In some blocks all area vectors are hidden, in others some are reversed:
the winding of real meshes cannot be relied on.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, cast

import jax
import jax.numpy as jnp
import jraph
import numpy as np
from flax import linen as nn
from jaxtyping import Array, Float

from gash_jax.models.batches import Batch, Example
from gash_jax.nn.surfel_net import BLOCK, fall_back
from gash_jax.prt.transfer import unshadowed_transfer

SOFTENING = 0.1
HIDDEN, REVERSED = 0.08, 0.04
# blocks that stay in the cache together, blocks per compiled call, and about how many of them a call itself costs
GROUP, CALLS, OVERHEAD = 4, (64, 32, 16, 8), 4
# a batch can be spread over this many devices, or a divisor of it
SHARES = 8


def block_graph(arrays: dict[str, Any], surfels: Any) -> jraph.GraphsTuple:
    """The graph of blocks from nodes (b, w, ...) and surfels (b, n, d); NumPy or traced."""
    blocks, count = surfels.shape[:2]
    ends = np.zeros(blocks * count, np.int32)
    fields: dict[str, Any] = {
        "nodes": {name: a.reshape(blocks * BLOCK, *a.shape[2:]) for name, a in arrays.items()},
        "edges": {"surfel": surfels.reshape(blocks * count, -1)},
        "senders": ends,
        "receivers": ends,
        "globals": {"scale": np.ones(1, np.float32)},
        "n_node": np.array([blocks * BLOCK], np.int32),
        "n_edge": np.array([blocks * count], np.int32),
    }
    return jraph.GraphsTuple(**fields)


def _split(graph: jraph.GraphsTuple) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Nodes (b, w, ...) and surfels (b, n, d) of a surfel graph."""
    nodes, edges = cast(dict[str, np.ndarray], graph.nodes), cast(dict[str, np.ndarray], graph.edges)
    blocks = len(nodes["position"]) // BLOCK
    surfels = np.asarray(edges["surfel"]).reshape(blocks, -1, edges["surfel"].shape[-1])
    return {name: np.asarray(a).reshape(blocks, BLOCK, -1) for name, a in nodes.items()}, surfels


class BlockPool:
    """The blocks of many shapes with their labels, to draw batches from."""

    def __init__(self, examples: Sequence[Example]):
        parts = [_split(example.graph) for example in examples]
        self.nodes = {name: np.concatenate([nodes[name] for nodes, _ in parts]) for name in parts[0][0]}
        self.surfels = np.concatenate([surfels for _, surfels in parts])
        slots = [np.asarray(cast(dict, example.graph.globals)["slot"])[0] for example in examples]
        labels, masks, weights = [], [], []
        errors = [_formula_error(example, slot) for example, slot in zip(examples, slots, strict=True)]
        typical = float(np.median(errors))
        for example, slot, error in zip(examples, slots, errors, strict=True):
            count = len(cast(dict, example.graph.nodes)["position"])
            label, mask = np.zeros((count, example.coefficients.shape[1]), np.float32), np.zeros(count, bool)
            label[slot], mask[slot] = example.coefficients, True
            mask &= np.any(np.asarray(cast(dict, example.graph.nodes)["normal"]) != 0, axis=-1)
            labels.append(label.reshape(-1, BLOCK, label.shape[1]))
            masks.append(mask.reshape(-1, BLOCK))
            weights.append(np.full(count // BLOCK, 1 / (error + SOFTENING * typical + 1e-12)))
        self.labels, self.mask = np.concatenate(labels), np.concatenate(masks)
        weight = np.concatenate(weights)
        self.weight = (weight / weight.mean()).astype(np.float32)

    def draw(self, size: int, seed: int, step: int, shards: int = 1) -> Batch:
        """The batch of a step: `size` vertices in blocks of all shapes, without repetition."""
        rng = np.random.default_rng([seed, step])
        count = min(size // BLOCK, len(self.surfels))
        # the same blocks whatever the number of devices
        count -= count % SHARES if count >= SHARES else 0
        if not count or count % shards:
            raise ValueError(f"{count} blocks of {BLOCK} vertices for {shards} devices: raise train.batch_vertices")
        chosen = rng.choice(len(self.surfels), count, replace=False)
        sign = np.where(rng.random((count, 1)) < REVERSED, rng.choice([-1, 1], (count, self.surfels.shape[1])), 1)
        sign = sign * (rng.random((count, 1)) >= HIDDEN)
        surfels = self.surfels[chosen]
        surfels[..., 3:6] *= sign[..., None].astype(np.float32)
        return _batch(self, chosen, surfels, shards)

    def in_order(self, size: int) -> list[Batch]:
        """Every block once, `size` vertices a batch; the last batch is filled with blocks that do not count."""
        count, batches = min(-(-size // BLOCK), len(self.surfels)), []
        for start in range(0, len(self.surfels), count):
            chosen = np.arange(start, start + count)
            batch = _batch(self, chosen % len(self.surfels), self.surfels[chosen % len(self.surfels)], 1)
            mask = batch.mask & np.repeat(chosen < len(self.surfels), BLOCK)
            batches.append(batch._replace(mask=mask, weight=batch.weight * mask))
        return batches


def _formula_error(example: Example, slot: np.ndarray) -> float:
    bands = round(example.coefficients.shape[1] ** 0.5)
    normals = np.asarray(cast(dict, example.graph.nodes)["normal"])[slot]
    return float(np.mean((np.asarray(unshadowed_transfer(normals, bands)) - example.coefficients) ** 2))


def _batch(pool: BlockPool, chosen: np.ndarray, surfels: np.ndarray, shards: int) -> Batch:
    def sharded(array: np.ndarray) -> np.ndarray:
        return array.reshape(shards, -1, *array.shape[1:])

    graphs = [
        block_graph({name: a[part] for name, a in pool.nodes.items()}, rows)
        for part, rows in zip(sharded(chosen), sharded(surfels), strict=True)
    ]
    graph = jax.tree.map(lambda *leaves: np.stack(leaves), *graphs)
    mask = sharded(pool.mask[chosen].reshape(-1))
    weight = np.where(mask, sharded(np.repeat(pool.weight[chosen], BLOCK)), np.float32(0))
    labels = sharded(pool.labels[chosen].reshape(-1, pool.labels.shape[-1]))
    return Batch(graph, labels, np.zeros((*mask.shape, 0), np.float32), mask, weight)


@partial(jax.jit, static_argnames="module")
def run_blocks(module: nn.Module, params: Any, nodes: dict[str, Array], surfels: Float[Array, "b n d"]) -> Array:
    """Output of every block, (b, w, m): looking GROUP blocks at a time, answering all together."""
    variables = {"params": params}
    grouped = jax.tree.map(lambda a: a.reshape(-1, GROUP, *a.shape[1:]), (nodes, surfels))
    seen = jax.lax.map(lambda part: module.apply(variables, block_graph(*part), method="look"), grouped)
    seen = jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), seen)
    normals = nodes["normal"].reshape(-1, 3)
    output = module.apply(variables, *seen, normals, method="answer")
    return fall_back(jnp.asarray(output), normals, module.bands).reshape(len(surfels), BLOCK, -1)


def call_size(blocks: int, workers: int) -> int:
    """How many blocks to a call: 64, or where they are too few what keeps all workers busy with little padding."""
    if blocks >= workers * CALLS[0]:
        return CALLS[0]
    return min(CALLS, key=lambda size: -(-blocks // (size * workers)) * (size + OVERHEAD))


def predict_blocks(
    module: nn.Module, params: Any, graph: jraph.GraphsTuple, bands: int, workers: int
) -> tuple[Float[np.ndarray, "v k"], Float[np.ndarray, "v k"]]:
    """Coefficients and predicted error of every vertex of the mesh, in its order."""
    nodes, surfels = _split(graph)
    size = call_size(len(surfels), workers)

    def call(start: int) -> np.ndarray:
        part = jax.tree.map(lambda a: a[start : start + size], (nodes, surfels))
        used = len(part[1])
        if used < size:
            part = jax.tree.map(lambda a: np.concatenate([a, np.zeros((size - used, *a.shape[1:]), a.dtype)]), part)
        return np.asarray(run_blocks(module, params, *part))[:used]

    starts = range(0, len(surfels), size)
    if workers > 1 and len(starts) > 1:
        with ThreadPoolExecutor(workers) as pool:
            outputs = list(pool.map(call, starts))
    else:
        outputs = [call(start) for start in starts]
    slot = np.asarray(cast(dict, graph.globals)["slot"])[0]
    output = np.concatenate(outputs).reshape(-1, outputs[0].shape[-1])[slot]
    coefficients, error = output[:, : bands**2], output[:, bands**2 :]
    return np.ascontiguousarray(coefficients), np.repeat(error, 2 * np.arange(bands) + 1, axis=1)
