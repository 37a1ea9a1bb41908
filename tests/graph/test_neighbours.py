"""Neighbour tables against brute force, the laws of the rings, and who may serve."""

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gash_jax.graph.neighbours import knn, mesh_edges, rings

SEEDS = st.integers(0, 2**31)


def _points(seed: int, count: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3)).astype(np.float32)


def _distances(points: np.ndarray) -> np.ndarray:
    points = points.astype(np.float64)
    return np.linalg.norm(points[:, None] - points[None], axis=-1)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.integers(2, 40), st.integers(1, 12))
def test_knn_is_brute_force(seed: int, count: int, k: int) -> None:
    points = _points(seed, count)
    distance = _distances(points)
    np.fill_diagonal(distance, np.inf)
    order = np.argsort(distance, axis=1)[:, : min(k, count - 1)]
    table = knn(points, k)
    assert table.dtype == np.int32 and table.shape == (count, k)
    np.testing.assert_array_equal(table, order[:, np.arange(k) % order.shape[1]])


def test_knn_by_hand_on_a_line_prefers_the_lower_index_at_ties() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [10, 0, 0]], np.float32)
    np.testing.assert_array_equal(knn(points, 2), [[1, 2], [0, 2], [1, 0], [2, 1]])


def test_knn_among_coincident_points_never_returns_self() -> None:
    points = np.zeros((30, 3), np.float32)
    table = knn(points, 4)
    assert not np.any(table == np.arange(30)[:, None])
    assert all(len(set(row)) == 4 for row in table.tolist())


def test_knn_repeats_what_there_is_and_falls_back_to_self() -> None:
    points = _points(0, 3)
    valid = np.array([True, True, False])
    table = knn(points, 5, valid)
    np.testing.assert_array_equal(table[:2], [[1] * 5, [0] * 5])
    assert set(table[2]) == {0, 1}
    np.testing.assert_array_equal(knn(points[:1], 3), [[0, 0, 0]])
    np.testing.assert_array_equal(knn(points, 2, np.zeros(3, bool)), [[0, 0], [1, 1], [2, 2]])


def test_only_valid_points_serve() -> None:
    points = _points(1, 200)
    valid = np.random.default_rng(2).random(200) < 0.6
    for table in (knn(points, 9, valid), rings(points, 0, valid=valid)):
        assert valid[table].all()
        assert not np.any(table[valid] == np.flatnonzero(valid)[:, None])


def test_mesh_edges_by_hand() -> None:
    faces = np.array([[0, 1, 2], [2, 1, 3], [3, 3, 1]], np.int32)
    senders, receivers = mesh_edges(faces, 6)
    assert senders.dtype == receivers.dtype == np.int32
    np.testing.assert_array_equal(receivers, [0, 0, 1, 1, 1, 2, 2, 2, 3, 3])
    np.testing.assert_array_equal(senders, [1, 2, 0, 2, 3, 0, 1, 3, 1, 2])


def test_rings_hold_what_they_say() -> None:
    points = _points(3, 3000)
    table = rings(points, 5)
    assert table.dtype == np.int32 and table.shape == (3000, 32)
    assert not np.any(table == np.arange(3000)[:, None])
    rank = np.argsort(np.argsort(_distances(points), axis=1), axis=1)
    rank = np.take_along_axis(rank, table, axis=1).reshape(3000, 4, 8)
    np.testing.assert_array_equal(np.sort(rank[:, 0], axis=1), np.broadcast_to(np.arange(1, 9), (3000, 8)))
    for ring in range(4):
        ordered = np.sort(rank[:, ring], axis=1)
        assert np.all(ordered[:, 1:] > ordered[:, :-1]), "drawn twice"
    # the 16th of a 1-in-4 (1-in-16) subset has rank 64 +- 14 (256 +- 62): a hundredth lies beyond 1.6 times the share
    for ring, share in ((1, 64), (2, 256)):
        expected = (16 + 1) / 2 * share / 16
        assert abs(rank[:, ring].mean() / expected - 1) < 0.06
        assert np.quantile(rank[:, ring], 0.99) < 1.6 * share
    assert abs(rank[:, 3].mean() - 1500) < 30
    # all vertices are drawn from equally: 8 * 3000 draws over 3000 vertices is Poisson of mean 8
    drawn = np.bincount(table[:, 24:].ravel(), minlength=3000)
    assert abs(drawn.var() / 8 - 1) < 0.15


def test_rings_are_seeded() -> None:
    points = _points(4, 300)
    np.testing.assert_array_equal(rings(points, 7), rings(points, 7))
    assert np.any(rings(points, 7) != rings(points, 8))


@pytest.mark.parametrize("count", [1, 2, 5, 9, 12, 40])
def test_rings_of_a_small_mesh_are_clamped(count: int) -> None:
    table = rings(_points(5, count), 0)
    assert table.shape == (count, 32) and table.min() >= 0 and table.max() < count
    if count > 1:
        assert not np.any(table == np.arange(count)[:, None])
    if 1 < count <= 9:
        everyone = [set(range(count)) - {i} for i in range(count)]
        assert [set(row) for row in table[:, :8].tolist()] == everyone
        assert [set(row) for row in table[:, 24:].tolist()] == everyone


def test_neighbours_do_not_depend_on_unit_or_origin() -> None:
    points = _points(6, 400).astype(np.float64)
    moved = points * 1e-6 + np.array([3.0, -2.0, 1.0]) * 1e-4
    np.testing.assert_array_equal(rings(points, 1), rings(moved, 1))
    np.testing.assert_array_equal(knn(points, 8), knn(moved, 8))


def test_rings_take_no_python_loop_over_vertices() -> None:
    def calls(count: int) -> int:
        seen, points = 0, _points(7, count)

        def profile(*_: object) -> None:
            nonlocal seen
            seen += 1

        sys.setprofile(profile)
        rings(points, 0)
        sys.setprofile(None)
        return seen

    assert calls(20_000) < 1.1 * calls(2_000)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda points: knn(points, 0), "at least 1"),
        (lambda points: rings(points, 0, (4, None)), "every ring"),
        (lambda points: mesh_edges(np.array([[0, 1, 9]], np.int32), 5), "vertex 9 of 5"),
    ],
)
def test_bad_input_is_named(call, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        call(_points(0, 20))
