"""Batches of the surfel network: labels of their vertices, every vertex once, and draws that stand for the corpus."""

from typing import Any

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.surfel_graph import with_surfels
from gash_jax.graph.surfel_lists import WIDTHS
from gash_jax.models import surfel_parts
from gash_jax.models.examples import Batch, Example
from gash_jax.models.families import model_config, model_graph
from gash_jax.models.surfel_parts import SHARES, SOFTENING, WIDE, PartPool, label_columns
from tests.helpers.bumpy import bumpy_mesh
from tests.helpers.split import split_mesh

CONFIG = model_config("local", channels=8, layers=1)
COUNTS = (50, 75, 133)


def _mesh(count: int, seed: int) -> Mesh:
    mesh = bumpy_mesh(count, seed)
    mesh.normals[3] = 0
    return mesh


def _example(count: int, seed: int) -> Example:
    """Labels name the vertex: shape in column 0, index in column 1."""
    mesh = _mesh(count, seed)
    labels = np.full((count, 9), 1 + seed, np.float32)
    labels[:, 1] = np.arange(count)
    return Example(model_graph(CONFIG, mesh), labels, np.ones((count, 25), np.float32))


EXAMPLES = [_example(count, seed) for seed, count in enumerate(COUNTS)]
EVERY = {(1 + s, i) for s, count in enumerate(COUNTS) for i in range(count) if i != 3}


def _names(batch: Batch, shard: int = 0) -> list[tuple[int, int]]:
    """Who counts in a batch."""
    labels = batch.coefficients[shard][batch.mask[shard]]
    return [(int(row[0]), int(row[1])) for row in labels]


def _seen(example: Example, index: int) -> dict[str, np.ndarray]:
    """What the network reads of a vertex of a shape, its list in the narrowest width that holds it."""
    slot = int(example.graph.slot[index])
    for part in example.graph.parts:
        if slot < len(part["normal"]):
            own = {name: array[slot] for name, array in with_surfels(part, example.graph.records).items()}
            width = WIDTHS[np.searchsorted(WIDTHS, np.count_nonzero(own["weight"]))]
            return own | {name: own[name][:width] for name in ("weight", "surfel")}
        slot -= len(part["normal"])
    raise AssertionError(index)


def _rows(batch: Batch) -> list[dict[str, np.ndarray]]:
    """What is read of every vertex of the first shard."""
    counts = [part["normal"].shape[1] for part in batch.inputs]
    numbered = [(part, i) for part, count in zip(batch.inputs, counts, strict=True) for i in range(count)]
    return [{name: array[0, i] for name, array in part.items()} for part, i in numbered]


def test_labels_belong_to_the_vertices_and_each_counts_once() -> None:
    batches = PartPool(EXAMPLES).in_order(10_000)
    names = [name for batch in batches for name in _names(batch)]
    assert set(names) == EVERY and len(names) == len(EVERY)
    for batch in batches:
        rows = _rows(batch)
        np.testing.assert_array_equal(batch.normals[0], [row["normal"] for row in rows])
        labels = batch.coefficients[0][:, :2].astype(int)
        for row, (shape, index), real in zip(rows, labels, batch.mask[0], strict=True):
            if real:
                expected = _seen(EXAMPLES[shape - 1], index)
                assert expected.keys() == row.keys()
                for name, array in expected.items():
                    np.testing.assert_array_equal(row[name], array)
        assert not batch.weight[0][~batch.mask[0]].any() and (batch.weight[0][batch.mask[0]] > 0).all()


@pytest.mark.parametrize("size", [1, 30, 100, 257, 1000])
def test_batches_in_order_hold_every_vertex_once_whatever_their_size(size: int) -> None:
    batches = PartPool(EXAMPLES).in_order(size)
    found = [name for batch in batches for name in _names(batch)]
    assert len(found) == len(set(found)) and set(found) == EVERY
    assert len({batch.mask.shape for batch in batches}) == 1
    assert len(batches) > 1 or size > 200
    for batch in batches:
        np.testing.assert_array_equal(batch.weight > 0, batch.mask)


def test_vertices_that_are_one_count_once() -> None:
    split, of = split_mesh(_mesh(60, 5))
    labels = np.tile(of[:, None], (1, 9)).astype(np.float32)
    pool = PartPool([Example(model_graph(CONFIG, split), labels, np.ones((len(of), 1), np.float32))])
    found = [index for batch in pool.in_order(1000) for _, index in _names(batch)]
    assert sorted(found) == [i for i in range(60) if i != 3]


def test_a_batch_is_a_function_of_seed_and_step_and_not_of_the_devices() -> None:
    pool = PartPool(EXAMPLES)
    one, same, step, seed, spread = (
        pool.draw(128, s, t, n) for s, t, n in ((0, 5, 1), (0, 5, 1), (0, 6, 1), (1, 5, 1), (0, 5, 4))
    )
    for a, b in zip(_rows(one), _rows(same), strict=True):
        for name, array in a.items():
            np.testing.assert_array_equal(array, b[name])
    assert _names(one) != _names(step) and _names(one) != _names(seed)
    # the same vertices on four devices, as many on each
    assert spread.mask.shape[0] == 4 and spread.mask.shape[1] * 4 == one.mask.shape[1]
    assert sorted(name for shard in range(4) for name in _names(spread, shard)) == sorted(_names(one))
    assert float(spread.weight.sum()) == pytest.approx(float(one.weight.sum()), rel=1e-5)
    for part, whole in zip(spread.inputs, one.inputs, strict=True):
        for name in part:
            np.testing.assert_array_equal(part[name].reshape(whole[name].shape), whole[name])
    with pytest.raises(ValueError, match="for 3 devices"):
        pool.draw(128, 0, 0, 3)


def test_no_vertex_is_drawn_twice_where_there_are_enough() -> None:
    pool = PartPool(EXAMPLES)
    for step in range(5):
        names = _names(pool.draw(64, 0, step))
        assert len(names) > 40
        counts = {name: names.count(name) for name in names}
        widths = {name: len(_seen(EXAMPLES[name[0] - 1], name[1])["weight"]) for name in names}
        few = {width for width, own in zip(WIDTHS, pool.pools, strict=True) if len(own.mask) < SHARES}
        assert all(count == 1 for name, count in counts.items() if widths[name] not in few)


def _pool_of(numbers: list[int], values: list[float]) -> PartPool:
    """A pool of so many vertices of each width; what the loss would be of one is its label."""
    pool = PartPool(EXAMPLES)
    own = next(own for own in pool.pools if len(own.mask))
    pools = []
    for number, width, value in zip(numbers, WIDTHS, values, strict=True):
        inputs: Any = {name: np.resize(array, (number, *array.shape[1:])) for name, array in own.inputs.items()}
        inputs |= {"table": np.zeros((number, width), np.int32), "weight": np.zeros((number, width), np.float32)}
        labels = np.full((number, 9), value, np.float32)
        ones = np.ones(number, np.float32)
        pools.append(own._replace(inputs=inputs, labels=labels, mask=ones > 0, weight=ones))
    pool.pools = tuple(pools)
    return pool


def test_the_weighted_loss_of_a_batch_is_that_of_the_corpus() -> None:
    """Long lists are drawn more rarely and count so much more: unbiased where no rounding is left."""
    drawn = [16 * (len(WIDTHS) - i) for i in range(len(WIDTHS))]
    numbers = [4 * count * max(width, WIDE) // WIDE for count, width in zip(drawn, WIDTHS, strict=True)]
    values = [2.0**i for i in range(len(WIDTHS))]
    batch = _pool_of(numbers, values).draw(sum(drawn), 0, 0)
    held = [int(np.sum(batch.coefficients[0][:, 0] == value)) for value in values]
    assert held == drawn and held[-1] / numbers[-1] == WIDE / WIDTHS[-1] / 4
    assert all(count % SHARES == 0 for count in held)
    truth = np.average(values, weights=numbers)
    found = float(np.average(batch.coefficients[0][:, 0], weights=batch.weight[0]))
    assert found == pytest.approx(truth, rel=1e-6)
    # plain means are biased, as long lists are drawn more rarely
    assert abs(float(batch.coefficients[0][:, 0].mean()) / truth - 1) > 0.1
    expected = [max(width / WIDE, 1) for width in WIDTHS]
    weights = [float(batch.weight[0][batch.coefficients[0][:, 0] == value].mean()) for value in values]
    np.testing.assert_allclose(np.array(weights) / weights[0], expected, rtol=1e-6)


def test_only_area_vectors_are_hidden_or_reversed(monkeypatch: pytest.MonkeyPatch) -> None:
    pool = PartPool(EXAMPLES)
    before = pool.records.copy()
    monkeypatch.setattr(surfel_parts, "HIDDEN", 0.4)
    monkeypatch.setattr(surfel_parts, "REVERSED", 0.5)
    batch, kinds = pool.draw(128, 0, 0), []
    np.testing.assert_array_equal(pool.records, before)
    for row, (shape, index), real in zip(
        _rows(batch), batch.coefficients[0][:, :2].astype(int), batch.mask[0], strict=True
    ):
        if not real:
            continue
        plain = _seen(EXAMPLES[shape - 1], index)
        for name in ("position", "normal", "near", "weight"):
            np.testing.assert_array_equal(row[name], plain[name])
        np.testing.assert_array_equal(np.delete(row["surfel"], [3, 4, 5], 1), np.delete(plain["surfel"], [3, 4, 5], 1))
        vectors, own = row["surfel"][:, 3:6], plain["surfel"][:, 3:6]
        if not vectors.any():
            kinds.append("hidden")
        else:
            np.testing.assert_array_equal(np.abs(vectors), np.abs(own))
            kinds.append("as it is" if np.array_equal(vectors, own) else "reversed")
    assert all(kinds.count(kind) > 10 for kind in ("hidden", "as it is", "reversed"))


def test_shapes_that_the_closed_form_serves_well_weigh_more() -> None:
    """By 1 / (MSE + SOFTENING * median), so that the median of the weights of one shape is known by hand."""
    near, far = EXAMPLES[0], EXAMPLES[1]
    normals = np.concatenate([part["normal"] for part in near.graph.parts])[near.graph.slot]
    exact = np.asarray(unshadowed_transfer(normals, 3))
    poor = np.concatenate([part["normal"] for part in far.graph.parts])[far.graph.slot]
    poor = np.asarray(unshadowed_transfer(poor, 3)) + np.float32(0.3)
    pool = PartPool([near._replace(coefficients=exact + np.float32(0.1)), far._replace(coefficients=poor)])
    weights = np.concatenate([own.weight for own in pool.pools])
    light, heavy = np.unique(np.round(weights[weights > 0], 5))
    median = (0.01 + 0.09) / 2
    assert heavy / light == pytest.approx((0.09 + SOFTENING * median) / (0.01 + SOFTENING * median), rel=1e-3)
    assert weights[weights > 0].mean() == pytest.approx(1, rel=1e-4)
    assert np.count_nonzero(weights) == COUNTS[0] + COUNTS[1] - 2


def test_labels_side_by_side_by_hand() -> None:
    example = EXAMPLES[0]._replace(coefficients=np.array([[1.0, 2, 3, 4]]))
    np.testing.assert_array_equal(label_columns(example), [[1, 2, 3, 4, 0, 0]])
    bounced = np.array([[[5.0, 6, 7, 8], [9, 10, 11, 12]]])
    whole = example._replace(bounced=bounced, noise=np.array([[13.0, 14]]))
    np.testing.assert_array_equal(label_columns(whole), [np.arange(1, 15)])
