"""What a block looks at: the definition walked by hand, no surfel twice, and nothing that depends on how it is run."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.graph import surfel_selection
from gash_jax.graph.surfel_graph import SurfelPlan, normalised, plan_surfels
from gash_jax.graph.surfel_selection import (
    BLOCK,
    LADDER,
    NEGLIGIBLE,
    NEGLIGIBLE_STEPS,
    SMALLEST,
    STEPS,
    select_surfels,
    vertex_blocks,
)
from gash_jax.graph.surfels import FAN
from gash_jax.shapes.primitives import icosphere
from tests.helpers.bumpy import bumpy_mesh, random_rotation

COUNT = 64


class _Case(NamedTuple):
    plan: SurfelPlan
    records: np.ndarray
    positions: np.ndarray
    normals: np.ndarray

    def table(self, count: int = COUNT) -> np.ndarray:
        return select_surfels(self.plan.tree, self.records, self.positions, self.normals, count)


def _case(mesh: Mesh, count: int = COUNT) -> _Case:
    positions, _, _ = normalised(mesh)
    plan, records = plan_surfels(mesh, positions, count)
    return _Case(plan, records, positions[plan.blocks], mesh.normals[plan.blocks])


@cache
def _bumpy() -> _Case:
    return _case(bumpy_mesh(300))


def _importance(record: np.ndarray, positions: np.ndarray, normals: np.ndarray) -> float:
    """The formula of the module's docstring for one surfel and one block."""
    middle = positions.mean(0)
    r = np.sqrt(np.mean(np.sum((positions - middle) ** 2, axis=1)))
    n = normals.mean(0) / np.linalg.norm(normals.mean(0))
    sine = np.sqrt(1 - np.clip(np.mean(normals @ n), 0, 1) ** 2)
    offset, s = record[:3] - middle, record[7]
    d = np.linalg.norm(offset)
    c = (n @ offset + 1.5 * s + 0.3 * r) / (d + r)
    return 0.999 * s**2 / (d**2 + r**2 + s**2) * min((c + np.hypot(c, sine / 2)) / 2, 1)


def _cut(case: _Case, block: int, step: float, negligible: float = float(NEGLIGIBLE)) -> dict[int, float]:
    """The list of a block when all above this importance is opened: surfel -> importance."""
    positions, normals = case.positions[block].astype(np.float64), case.normals[block].astype(np.float64)
    r = np.sqrt(np.mean(np.sum((positions - positions.mean(0)) ** 2, axis=1)))
    kept, waiting = {}, list(range(case.plan.tree.level_sizes[0]))
    while waiting:
        node = waiting.pop()
        record, child = case.records[node].astype(np.float64), int(case.plan.tree.first_child[node])
        importance = _importance(record, positions, normals) if record[6] > 0 else 0.0
        if importance > step and child >= 0 and record[7] > SMALLEST * r:
            waiting.extend(range(child, child + FAN))
        elif importance > negligible * step:
            kept[node] = importance
    return kept


def test_blocks_hold_every_vertex_once(bumpy: Mesh) -> None:
    blocks = vertex_blocks(bumpy.vertices, bumpy.normals, np.eye(3))
    assert blocks.shape == (-(-300 // BLOCK), BLOCK) and blocks.dtype == np.int32
    np.testing.assert_array_equal(np.sort(blocks.ravel()[:300]), np.arange(300))
    np.testing.assert_array_equal(blocks.ravel()[300:], blocks.ravel()[299])
    # neighbours in space: a block is much smaller than the mesh
    points = bumpy.vertices[blocks]
    assert np.median(np.sqrt(points.var(axis=1).sum(-1))) < 0.6 * np.sqrt(bumpy.vertices.var(axis=0).sum())


def test_steps_of_importance_are_eighths_of_octaves() -> None:
    by_hand = [14 / 128, 15 / 128, *(n / 64 for n in range(8, 16)), *(n / 32 for n in range(8, 16))]
    by_hand += [*(n / 16 for n in range(8, 16)), 1.0]
    np.testing.assert_array_equal(LADDER, np.array(by_hand, np.float32))
    importance = np.concatenate(
        [
            LADDER,
            np.nextafter(LADDER, np.float32(2)),
            np.nextafter(LADDER, np.float32(0)),
            np.array([0, 1e-30, 1e-3], np.float32),
        ]
        + [np.random.default_rng(0).uniform(0, 1, 1000).astype(np.float32)]
    )
    steps = surfel_selection._steps_below(importance)
    np.testing.assert_array_equal(np.clip(steps, 0, STEPS), np.searchsorted(LADDER, importance))
    negligible = np.searchsorted(LADDER, importance / NEGLIGIBLE)
    np.testing.assert_array_equal(np.clip(steps + NEGLIGIBLE_STEPS, 0, STEPS), negligible)


def test_little_importance_is_left_out() -> None:
    """Of what a cut that opens the same surfels and drops nothing would hold."""
    case = _bumpy()
    for block in (0, 7, 18):
        step = next(float(step) for step in LADDER if len(_cut(case, block, float(step))) <= COUNT)
        whole, kept = (sum(_cut(case, block, step, share).values()) for share in (0.0, float(NEGLIGIBLE)))
        assert 0.9 * whole < kept < whole
        row = case.table()[block]
        assert np.isin(list(_cut(case, block, step)), row).all()


@pytest.mark.parametrize("count", [24, 32, 200])
@pytest.mark.parametrize("block", [0, 7, 18])
def test_a_block_takes_the_finest_cut_that_fits(block: int, count: int) -> None:
    case = _bumpy()
    row = case.table(count)[block]
    row = row[row != len(case.records) - 1]
    cuts = [_cut(case, block, float(step)) for step in LADDER]
    fitting = [cut for cut in cuts if len(cut) <= count]
    assert 0 < len(fitting) and (count > 24 or len(fitting) < len(cuts))
    assert set(row.tolist()) == set(fitting[0])
    # the most important first
    found = np.array([fitting[0][int(node)] for node in row])
    assert np.all(np.diff(found) < 1e-6)


def test_where_even_the_coarsest_cut_is_too_long_the_most_important_stay() -> None:
    case = _bumpy()
    for block in (0, 7):
        coarsest = _cut(case, block, 1.0)
        assert len(coarsest) > 3
        best = sorted(coarsest, key=lambda node: -coarsest[node])[:3]
        np.testing.assert_array_equal(case.table(3)[block], best)


def test_rows_are_surfels_with_area_or_the_empty_one() -> None:
    for case, count in ((_bumpy(), COUNT), (_case(icosphere(2)), 256)):
        table = case.table(count)
        empty = len(case.records) - 1
        assert table.dtype == np.int32 and table.shape == (len(case.positions), count)
        assert table.min() >= 0 and table.max() <= empty
        assert np.all(case.records[table[table != empty], 6] > 0)
        # what is empty comes last
        assert np.all(np.diff((table == empty).astype(int), axis=1) >= 0)


def test_no_surfel_is_seen_twice_nor_together_with_its_parts() -> None:
    case = _bumpy()
    tree, table = case.plan.tree, case.table(512)
    parent = np.full(len(tree.first_child) + 1, -1)
    inner = np.flatnonzero(tree.first_child >= 0)
    parent[(tree.first_child[inner][:, None] + np.arange(FAN)).ravel()] = np.repeat(inner, FAN)
    assert len(np.unique(np.searchsorted(np.cumsum(tree.level_sizes), table[0], side="right"))) > 1
    for row in table:
        row = row[row < len(case.records) - 1]
        assert len(np.unique(row)) == len(row)
        above = parent[row]
        while np.any(above >= 0):
            assert not np.isin(above, row).any()
            above = np.where(above >= 0, parent[above], -1)


def test_of_a_sphere_less_is_seen_than_of_bumps() -> None:
    """What is below the horizon is dropped; of the bumpy sphere its far side too, but not its surroundings."""

    def seen(case: _Case) -> np.ndarray:
        """Share of the mesh's area in every block's list."""
        area = case.records[case.table(1024), 6].sum(axis=1)
        return area / case.records[: case.plan.tree.level_sizes[0], 6].sum()

    sphere, bumpy = seen(_case(icosphere(3))), seen(_bumpy())
    assert 0 < np.median(sphere) < 0.7 * np.median(bumpy)
    assert np.median(bumpy) > 0.5
    assert bumpy.max() < 1 + 1e-5


def test_chunks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    whole = _bumpy().table()
    monkeypatch.setattr(surfel_selection, "CHUNK", 4)
    np.testing.assert_array_equal(_bumpy().table(), whole)


def test_the_table_does_not_change_when_the_mesh_is_moved() -> None:
    case = _bumpy()
    for seed in (1, 2):
        moved = _case(transform(bumpy_mesh(300), random_rotation(seed), np.array([2.0, -1.0, 3.0]), 40.0))
        np.testing.assert_array_equal(moved.plan.blocks, case.plan.blocks)
        np.testing.assert_array_equal(moved.plan.table, case.plan.table)
