"""Batches of whole shapes: every shape as often as any other, every vertex once in order."""

import numpy as np
import pytest

from gash_jax.models.examples import Example, WholeShapes
from gash_jax.models.families import model_config, model_graph
from gash_jax.shapes.primitives import bumpy_sphere

SIZES = [2, 2, 3, 3, 4, 5, 5]  # 42 to 252 vertices
SIZE = 300


@pytest.fixture(scope="module")
def shapes() -> WholeShapes:
    """Shapes whose labels are their numbers."""
    examples, config = [], model_config("mlp", bands=1)
    for number, size in enumerate(SIZES):
        mesh = bumpy_sphere(size)
        count = len(mesh.vertices)
        labels = np.full((count, 1), number, np.float32)
        examples.append(Example(model_graph(config, mesh), labels, np.zeros((count, 25), np.float32)))
    return WholeShapes(examples)


def held(batch) -> np.ndarray:
    """Vertices of every shape in a batch."""
    return np.bincount(batch.coefficients[batch.mask][:, 0].astype(int), minlength=len(SIZES))


def test_small_and_large_shapes_are_drawn_alike(shapes: WholeShapes) -> None:
    steps, whole = 400, np.array([len(example.coefficients) for example in shapes.examples])
    counts = np.stack([held(shapes.draw(SIZE, 0, step)) for step in range(steps)])
    assert np.all((counts == 0) | (counts == whole)) and np.all(counts.sum(axis=1) < SIZE)
    often = np.mean(counts > 0, axis=0)
    sigma = np.sqrt(often.mean() * (1 - often.mean()) / steps)
    assert np.abs(often - often.mean()).max() < 4 * sigma
    # filling up with what still fits, as an independent draw of the same shapes shows, is not even
    filled = np.zeros(len(SIZES))
    for step in range(steps):
        used = 0
        for index in np.random.default_rng(step).permutation(len(SIZES)):
            if used + whole[index] < SIZE:
                used, filled[index] = used + whole[index], filled[index] + 1 / steps
    assert np.abs(filled - filled.mean()).max() > 8 * sigma


def test_a_division_holds_every_shape_once_and_wastes_little(shapes: WholeShapes) -> None:
    counts = np.array([len(example.coefficients) for example in shapes.examples])
    batches = {tuple(held(shapes.draw(SIZE, 0, step))) for step in range(60)}
    assert len(batches) > 10  # shapes meet in many ways
    loads = [held(shapes.draw(SIZE, 1, step)).sum() for step in range(200)]
    assert np.mean(loads) > 0.75 * counts.sum() / -(-counts.sum() // SIZE)


def test_shapes_that_do_not_fit_are_left_out(shapes: WholeShapes) -> None:
    drawn = np.sum([held(shapes.draw(200, 0, step)) > 0 for step in range(60)], axis=0)
    assert not drawn[5:].any() and drawn[:5].all()
    with pytest.raises(ValueError, match="raise it, or lower data.max_vertices"):
        shapes.draw(42, 0, 0)
