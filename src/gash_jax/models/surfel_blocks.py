"""Training batches of the surfel network: blocks of vertices, drawn from all shapes alike.

Because no block knows of another, a batch need not hold whole shapes. Shapes weigh in the loss by 1 / (their closed
form's MSE + SOFTENING x its median), so that it is their skill that is minimised and not the error of the darkest. In
some blocks all area vectors are hidden, in others some are reversed: the winding of real meshes cannot be relied on.
"""

from collections.abc import Sequence

import jax
import numpy as np

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.graph.surfel_graph import SurfelGraph
from gash_jax.graph.surfel_selection import BLOCK
from gash_jax.models.examples import Batch, Example

SOFTENING = 0.1
HIDDEN, REVERSED = 0.08, 0.04
# a batch can be spread over this many devices, or a divisor of it
SHARES = 8


class BlockPool:
    """The blocks of many shapes with their labels, to draw batches from."""

    def __init__(self, examples: Sequence[Example]):
        graphs: list[SurfelGraph] = [example.graph for example in examples]
        self.blocks = jax.tree.map(lambda *arrays: np.concatenate(arrays), *(graph.blocks for graph in graphs))
        labels, masks, weights = [], [], []
        errors = [_closed_form_error(example) for example in examples]
        typical = float(np.median(errors))
        for example, error in zip(examples, errors, strict=True):
            slot, normal = example.graph.slot, example.graph.blocks["normal"]
            count = normal.shape[0] * BLOCK
            label, mask = np.zeros((count, example.coefficients.shape[1]), np.float32), np.zeros(count, bool)
            label[slot], mask[slot] = example.coefficients, True
            mask &= np.any(normal.reshape(-1, 3) != 0, axis=-1)
            labels.append(label.reshape(-1, BLOCK, label.shape[1]))
            masks.append(mask.reshape(-1, BLOCK))
            weights.append(np.full(count // BLOCK, 1 / (error + SOFTENING * typical + 1e-12)))
        self.labels, self.mask = np.concatenate(labels), np.concatenate(masks)
        weight = np.concatenate(weights)
        self.weight = (weight / weight.mean()).astype(np.float32)

    def __len__(self) -> int:
        return len(self.mask)

    def draw(self, size: int, seed: int, step: int, shards: int = 1) -> Batch:
        """The batch of a step: `size` vertices in blocks of all shapes, without repetition."""
        rng = np.random.default_rng([seed, step])
        count = min(size // BLOCK, len(self))
        # the same blocks whatever the number of devices
        count -= count % SHARES if count >= SHARES else 0
        if not count or count % shards:
            raise ValueError(f"{count} blocks of {BLOCK} vertices for {shards} devices: raise train.batch_vertices")
        chosen = rng.choice(len(self), count, replace=False)
        surfels = self.blocks["surfel"][chosen]
        sign = np.where(rng.random((count, 1)) < REVERSED, rng.choice([-1, 1], surfels.shape[:2]), 1)
        sign = sign * (rng.random((count, 1)) >= HIDDEN)
        surfels[..., 3:6] *= sign[..., None].astype(np.float32)
        return self._batch(chosen, surfels, shards)

    def in_order(self, size: int) -> list[Batch]:
        """Every block once, `size` vertices a batch; the last batch is filled with blocks that do not count."""
        count, batches = min(-(-size // BLOCK), len(self)), []
        for start in range(0, len(self), count):
            chosen = np.arange(start, start + count)
            batch = self._batch(chosen % len(self), self.blocks["surfel"][chosen % len(self)], 1)
            mask = batch.mask & np.repeat(chosen < len(self), BLOCK)
            batches.append(batch._replace(mask=mask, weight=batch.weight * mask))
        return batches

    def _batch(self, chosen: np.ndarray, surfels: np.ndarray, shards: int) -> Batch:
        def sharded(array: np.ndarray) -> np.ndarray:
            return array.reshape(shards, -1, *array.shape[1:])

        inputs = {**{name: sharded(array[chosen]) for name, array in self.blocks.items()}, "surfel": sharded(surfels)}
        mask = sharded(self.mask[chosen].reshape(-1))
        weight = np.where(mask, sharded(np.repeat(self.weight[chosen], BLOCK)), np.float32(0))
        labels = sharded(self.labels[chosen].reshape(-1, self.labels.shape[-1]))
        normals = inputs["normal"].reshape(shards, -1, 3)
        return Batch(inputs, normals, labels, np.zeros((*mask.shape, 0), np.float32), mask, weight)


def _closed_form_error(example: Example) -> float:
    bands = round(example.coefficients.shape[1] ** 0.5)
    normals = example.graph.blocks["normal"].reshape(-1, 3)[example.graph.slot]
    return float(np.mean((np.asarray(unshadowed_transfer(normals, bands)) - example.coefficients) ** 2))
