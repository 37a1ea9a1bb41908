"""What a training run draws its batches from: whole shapes, or for the surfel network blocks of all shapes."""

from collections.abc import Callable, Sequence

from gash_jax.models.batches import Batch, Example, draw_batch, shape_batches
from gash_jax.models.blocks import BlockPool
from gash_jax.models.config import ModelConfig

# (vertices, seed, step, shards) -> batch
Sampler = Callable[[int, int, int, int], Batch]


def make_sampler(config: ModelConfig, examples: Sequence[Example]) -> Sampler:
    """The batches of a run as a function of seed and step."""
    if config.graph == "surfels":
        return BlockPool(examples).draw
    return lambda size, seed, step, shards: draw_batch(examples, size, seed, step, shards)


def validation_batches(config: ModelConfig, examples: Sequence[Example], size: int) -> list[Batch]:
    """Every validation vertex exactly once."""
    if config.graph == "surfels":
        return BlockPool(examples).in_order(size) if examples else []
    return shape_batches(examples, size)
