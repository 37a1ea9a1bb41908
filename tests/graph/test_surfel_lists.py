"""What a vertex looks at: the definition walked by hand, and nothing that depends on how it is run."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph import surfel_lists, surfel_walk
from gash_jax.graph.surfel_lists import WIDTHS, SurfelList, call_size, list_surfels
from gash_jax.graph.surfel_walk import MIDDLE, TIPS
from gash_jax.graph.surfels import FAN, surfel_records
from gash_jax.shapes.primitives import icosphere
from tests.helpers.bumpy import bumpy_mesh, random_rotation
from tests.helpers.surfel_cases import SurfelCase, bumpy_case, dense_weights, importance_of, surfel_case, walked_list


def test_one_surfel_by_hand() -> None:
    """Size 1 at distance 3 straight above: r² = 10, g = i = j = 0.1, opened 0.1 / 0.08 - 1 = 0.25."""
    record = np.zeros(20)
    record[[2, 6, 7]] = 3, 1, 1
    up, flat, g = np.array([0.0, 0, 1]), np.array([1.0, 0, 0]), 0.1
    assert importance_of(record, np.zeros(3), up) == importance_of(record, np.zeros(3), up, TIPS) == pytest.approx(g)
    # at the level of the horizon its middle is looked at 0.6 high and its tips 3, from above it not at all
    for rise in (MIDDLE, TIPS):
        assert importance_of(record, np.zeros(3), flat, rise) == pytest.approx(g * float(rise) * np.sqrt(g))
        assert importance_of(record, np.zeros(3), -up, rise) == 0
    positions = np.zeros((3, 3), np.float32)
    tree = bumpy_case().plan.tree._replace(
        level_sizes=(1, FAN), first_child=np.array([1, *[-1] * FAN], np.int32), face=np.zeros(FAN, np.int32)
    )
    records = np.zeros((2 + FAN, 20), np.float32)
    records[0], records[1] = record, record * 0.5  # one child: half as far, half as large, so as important
    lists = list_surfels(tree, records, positions, np.stack([up, flat, -up]).astype(np.float32), moves=True)[0]
    (part,) = [part for part in lists if len(part.vertices)]
    table, weight = part.table[np.argsort(part.vertices)], part.weight[np.argsort(part.vertices)]
    np.testing.assert_array_equal(table[0, :3], [0, 1, 1 + FAN])
    np.testing.assert_allclose(weight[0, :3], [0.75, 0.25, 0], rtol=1e-5)
    # at the horizon 0.0949 by its tips, opened 0.186; by its middle 0.0190, seen 0.897
    opened, seen = 3.75 / np.sqrt(10) - 1, 6 / np.sqrt(10) - 1
    np.testing.assert_allclose(weight[1, :3], [seen * (1 - opened), seen * opened, 0], rtol=1e-5)
    assert not weight[2].any() and np.all(table[2] == 1 + FAN)


def test_lists_are_the_definition_walked_in_float64() -> None:
    case = bumpy_case()
    dense = dense_weights(case, case.lists())
    levels = set()
    for vertex in (0, 7, 18, 123, 299):
        expected, _ = walked_list(case, case.positions[vertex], case.normals[vertex])
        row = np.zeros(len(case.records))
        row[list(expected)] = list(expected.values())
        np.testing.assert_allclose(dense[vertex], row, atol=1e-4)
        levels.update(np.searchsorted(np.cumsum(case.plan.tree.level_sizes), list(expected), side="right").tolist())
        # the list of who looks the other way is another one
        other, _ = walked_list(case, case.positions[vertex], -case.normals[vertex])
        assert sum(abs(dense[vertex, node] - weight) for node, weight in other.items()) > 1
    assert len(levels) > 2


def test_a_list_does_not_depend_on_other_vertices() -> None:
    case = bumpy_case()
    whole = dense_weights(case, case.lists())
    for chosen in (np.array([5]), np.arange(40, 90), np.random.default_rng(0).permutation(300)[:77]):
        part = dense_weights(case, case.lists(case.positions[chosen], case.normals[chosen]))
        np.testing.assert_array_equal(part, whole[chosen])


def _equal(first: tuple[SurfelList, ...], second: tuple[SurfelList, ...]) -> None:
    for one, two in zip(first, second, strict=True):
        for a, b in zip(one, two, strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(("chunk", "workers"), [(7, 1), (64, 3), (1024, 2), (1024, 500)])
def test_chunks_and_workers_change_nothing(chunk: int, workers: int, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = bumpy_case().lists()
    monkeypatch.setattr(surfel_lists, "CHUNK", chunk)
    monkeypatch.setattr(surfel_lists, "available_cores", lambda: workers)
    _equal(bumpy_case().lists(), whole)


def test_every_vertex_is_in_one_list_of_its_width_filled_with_the_empty_surfel(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(surfel_lists, "CALL", 2048)
    case = bumpy_case()
    lists = case.lists()
    np.testing.assert_array_equal(np.sort(np.concatenate([part.vertices for part in lists])), np.arange(300))
    widest = max(part.table.shape[1] for part in lists if len(part.vertices))
    empty, narrower, left = len(case.records) - 1, -1, 0
    assert not case.records[empty].any()
    for width, (vertices, table, weight) in zip(WIDTHS, lists, strict=True):
        assert table.shape == weight.shape == (len(vertices), width)
        assert (vertices.dtype, table.dtype, weight.dtype) == (np.int32, np.int32, np.float32)
        np.testing.assert_array_equal(table == empty, weight == 0)
        assert weight.min(initial=0) >= 0 and weight.max(initial=0) <= 1
        filled = np.count_nonzero(weight, axis=1)
        # what is empty comes last, no surfel twice, and a narrower list would not do but for too few to make a call
        assert np.all(np.diff((table == empty).astype(int), axis=1) >= 0)
        assert all(len(np.unique(row[:count])) == count for row, count in zip(table, filled, strict=True))
        assert np.count_nonzero(filled <= narrower) <= left
        rest = len(vertices) % call_size(width)
        assert rest == 0 or rest >= call_size(width) // 2 or width == widest
        narrower, left = width, call_size(width) // 2 - 1
    assert sum(len(part.vertices) > 0 for part in lists) > 2


def test_lists_that_are_too_long_keep_the_most_important(monkeypatch: pytest.MonkeyPatch) -> None:
    case = bumpy_case()
    whole = dense_weights(case, case.lists())[:, :-1]
    monkeypatch.setattr(surfel_lists, "WIDTHS", (4, 12))
    lists = case.lists()
    assert [part.table.shape[1] for part in lists] == [4, 12] and len(lists[1].vertices) > 100
    cut = dense_weights(case, lists)[:, :-1]
    for vertex in (0, 7, 18, 123, 299):
        weights, importances = walked_list(case, case.positions[vertex], case.normals[vertex])
        best = sorted(weights, key=lambda node: -importances[node])[:12]
        np.testing.assert_array_equal(np.flatnonzero(cut[vertex]), np.sort(best))
        np.testing.assert_array_equal(cut[vertex, best], whole[vertex, best])
    assert np.count_nonzero(whole, axis=1).max() > 12 >= np.count_nonzero(cut, axis=1).max()


def test_crowded_lists_are_made_anew_with_less_importance(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surfel_walk, "MIDDLE", TIPS)  # what is below the horizon is in the total by its middle
    case, full = bumpy_case(), 45.0
    before = dense_weights(case, case.lists())
    assert before.sum(axis=1).max() < surfel_lists.FULL  # no list of this mesh is crowded as it is
    monkeypatch.setattr(surfel_lists, "FULL", full)
    after, crowded = dense_weights(case, case.lists()), before.sum(axis=1) > full
    np.testing.assert_array_equal(after[~crowded], before[~crowded])
    assert 0 < np.mean(crowded) < 1 and np.all(after.sum(axis=1)[crowded] < before.sum(axis=1)[crowded])
    for vertex in np.flatnonzero(crowded)[::40]:
        place, normal = case.positions[vertex], case.normals[vertex]
        expected, _ = walked_list(case, place, normal, full / sum(walked_list(case, place, normal)[0].values()))
        row = np.zeros(len(case.records))
        row[list(expected)] = list(expected.values())
        np.testing.assert_allclose(after[vertex], row, atol=1e-3)


def test_lists_do_not_change_when_the_mesh_is_moved() -> None:
    case = bumpy_case()
    expected = dense_weights(case, case.lists())
    for seed in (1, 2):
        rotation, shift = random_rotation(seed), np.array([2.0, -1.0, 3.0])
        positions = (case.positions @ rotation.T + shift).astype(np.float32) * np.float32(7)
        records = surfel_records(case.plan.tree, positions, case.plan.faces)
        normals = (case.normals @ rotation.T).astype(np.float32)
        found = list_surfels(case.plan.tree, records, positions, normals, moves=True)[0]
        np.testing.assert_allclose(dense_weights(case, found), expected, atol=2e-3)
        # a tree of its own differs where leaves lie on a boundary of its curve
        moved = surfel_case(transform(bumpy_mesh(300), rotation, shift, 40.0))
        np.testing.assert_array_equal(moved.plan.tree.first_child, case.plan.tree.first_child)
        assert np.abs(dense_weights(moved, moved.lists()) - expected).sum() < 0.01 * expected.sum()
    # twice the size with the vertices where they were is another matter
    other = list_surfels(case.plan.tree, case.records, 2 * case.positions, case.normals, moves=True)[0]
    assert np.abs(dense_weights(case, other) - expected).max() > 0.5


def test_of_a_sphere_less_is_seen_than_of_bumps() -> None:
    """What is below the horizon is left out; a sphere is all below it, but for faces as flat as rounding."""

    def seen(case: SurfelCase) -> np.ndarray:
        """Share of the mesh's area that every vertex has in its list."""
        area = dense_weights(case, case.lists(moves=False)) @ case.records[:, 6]
        return area / case.records[: case.plan.tree.level_sizes[0], 6].sum()

    sphere, bumpy = seen(surfel_case(icosphere(3))), seen(bumpy_case())
    assert np.median(sphere) == 0 and sphere.max() < 0.1 * np.median(bumpy)
    assert bumpy.max() < 1 + 1e-5


def test_what_is_wholly_below_the_horizon_is_left_out_of_a_mesh_that_does_not_move() -> None:
    case = bumpy_case()
    whole, seen = (dense_weights(case, case.lists(moves=moves)) for moves in (True, False))
    vertex, node = np.nonzero(whole)
    record, normal = case.records[node].astype(np.float64), case.normals[vertex].astype(np.float64)
    height = np.einsum("pi,pi->p", record[:, :3] - case.positions[vertex], normal)
    xx, yy, zz, xy, xz, yz = record[:, 14:].T
    spread = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
    reach = np.sqrt(np.maximum(np.einsum("pi,pij,pj->p", normal, spread, normal), 0))
    kept = seen[vertex, node] > 0
    # what is left has its weight, and what is gone reaches no higher than the horizon; it is there if the mesh moves
    np.testing.assert_array_equal(seen[vertex, node][kept], whole[vertex, node][kept])
    assert np.count_nonzero(seen) == np.count_nonzero(kept) and 0.1 < np.mean(kept) < 0.8
    assert np.all((height + reach)[~kept] < 1e-6) and np.all((height + 1.001 * reach)[kept] > -1e-6)


def test_nothing_to_see_and_nobody_to_see_it() -> None:
    case = bumpy_case()
    nobody = case.lists(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.float32))
    assert [part.table.shape for part in nobody] == [(0, width) for width in WIDTHS]
    line = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32)
    flat = surfel_case(Mesh(line, np.zeros_like(line), np.array([[0, 1, 2]], np.int32)))
    (first, *others) = flat.lists()
    assert len(first.vertices) == 3 and not any(len(part.vertices) for part in others)
    assert not first.weight.any() and np.all(first.table == len(flat.records) - 1)
