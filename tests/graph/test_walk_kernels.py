"""The compiled loops of the walk: what they do where there is much, and that compiling changes nothing."""

import numpy as np
import pytest

from gash_jax.graph import record_kernel, surfel_walk, surfels, walk_kernels
from gash_jax.graph.surfel_walk import surfel_blocks, walk_tree
from tests.helpers import surfel_cases
from tests.helpers.surfel_cases import SurfelCase, bumpy_case, walked_list


def _own(case: SurfelCase) -> np.ndarray:
    return np.concatenate([case.positions, case.normals], axis=1, dtype=np.float32)


def test_families_are_as_large_as_those_of_the_tree() -> None:
    assert walk_kernels.FAN == record_kernel.FAN == surfels.FAN == 1 << walk_kernels.FAN_BITS


def test_more_surfels_than_a_tile_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    """Opened down to the leaves, a level has more members than are weighed at a time."""
    case = bumpy_case()
    for module in (surfel_walk, surfel_cases):
        monkeypatch.setattr(module, "OPENING", np.float32(1e-3))
        monkeypatch.setattr(module, "NEGLIGIBLE", np.float32(1e-4))
    found = walk_tree(surfel_blocks(case.plan.tree, case.records), _own(case)[:3], 1e9, 10_000, moves=True)
    assert found.lengths.max() > 2 * walk_kernels.TILE
    ends = np.cumsum(found.lengths)
    for vertex, (start, end) in enumerate(zip(ends - found.lengths, ends, strict=True)):
        expected, _ = walked_list(case, case.positions[vertex], case.normals[vertex])
        dense, row = np.zeros(len(case.records)), np.zeros(len(case.records))
        dense[found.node[start:end]] = found.weight[start:end]
        row[list(expected)] = list(expected.values())
        np.testing.assert_allclose(dense, row, atol=5e-3)


def test_lists_that_are_crowded_by_less_than_rounding_are_made_anew_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their importance is multiplied by 1 then, and they are still crowded."""
    monkeypatch.setattr(surfel_walk, "MIDDLE", surfel_walk.TIPS)  # what is listed is all that is in the total
    case = bumpy_case()
    blocks, own, rounded = surfel_blocks(case.plan.tree, case.records), _own(case)[:40], 0
    for vertex in range(len(own)):
        free = walk_tree(blocks, own[vertex : vertex + 1], 1e9, 256, moves=True)
        total = float(free.weight.sum(dtype=np.float64))
        nearest = np.float32(total)
        full = float(nearest if float(nearest) < total else np.nextafter(nearest, np.float32(0)))
        rounded += np.float32(full / total) == 1
        found = walk_tree(blocks, own[vertex : vertex + 1], full, 256, moves=True)
        np.testing.assert_array_equal(found.beside.leaf, free.beside.leaf)
        np.testing.assert_allclose(found.weight, free.weight, atol=1e-4)
    assert rounded > 5


def test_any_number_of_leaves_may_be_beside_vertices(monkeypatch: pytest.MonkeyPatch) -> None:
    """More than there is room for at first: all leaves are, by their j and by what is open above them."""
    monkeypatch.setattr(surfel_walk, "CLOSE", np.float32(1e-4))
    case = bumpy_case()
    blocks, own = surfel_blocks(case.plan.tree, case.records), _own(case)
    whole = walk_tree(blocks, own, 1e9, 256, moves=True).beside
    assert len(whole.leaf) > 2 * 1024
    for vertex in (0, 150, 299):
        alone, chosen = walk_tree(blocks, own[vertex : vertex + 1], 1e9, 256, moves=True).beside, whole.vertex == vertex
        np.testing.assert_array_equal(whole.leaf[chosen], alone.leaf)
        np.testing.assert_array_equal(whole.importance[chosen], alone.importance)
        np.testing.assert_array_equal(whole.weight[chosen], alone.weight)
    assert whole.importance.min() > 1e-4 and 0 < whole.weight.min() and whole.weight.max() <= 1


def test_of_too_many_the_most_important_and_of_equals_the_first() -> None:
    rank = np.array([0.5, 0.2, 0.9, 0.5, 0.1, 0.5], np.float32)
    for most, kept in ((1, [2]), (2, [0, 2]), (3, [0, 2, 3]), (5, [0, 1, 2, 3, 5])):
        node, weight = np.arange(8, dtype=np.int32), np.arange(8, dtype=np.float32)
        end = walk_kernels._shortened(node, weight, rank, 2, 8, most)
        assert end == 2 + most
        np.testing.assert_array_equal(node[2:end], 2 + np.array(kept))
        np.testing.assert_array_equal(weight[2:end], 2 + np.array(kept))


def test_loops_do_the_same_uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    case = bumpy_case()
    blocks, own = surfel_blocks(case.plan.tree, case.records), _own(case)[::60]
    compiled = walk_tree(blocks, own, 60.0, 40)
    for name in ("walk", "_fetch", "_weigh", "_clipped", "_picked", "_reaches", "_longer", "_shortened"):
        monkeypatch.setattr(walk_kernels, name, getattr(walk_kernels, name).py_func)
    plain = walk_tree(blocks, own, 60.0, 40)
    np.testing.assert_array_equal(plain.lengths, compiled.lengths)
    np.testing.assert_array_equal(plain.node, compiled.node)
    np.testing.assert_allclose(plain.weight, compiled.weight, atol=1e-4)
    assert compiled.lengths.max() == 40 and len(compiled.node) == compiled.lengths.sum()
