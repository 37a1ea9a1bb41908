"""Weights of surfels in a list: soft where a hard cut would jump, and one surface is not counted twice."""

import numpy as np
import pytest

from gash_jax.graph import surfel_walk
from gash_jax.graph.surfel_walk import NEGLIGIBLE, OPENING, TIPS
from tests.helpers.surfel_cases import SurfelCase, bumpy_case, dense_weights, importance_of, walked_list

LARGE = 0.1


def _steepest(case: SurfelCase, turning: bool) -> np.ndarray:
    """By how much the weight of a surfel changes at most when its vertex moves by 1, or turns by 1 radian.

    A surfel of size s is at most 1 important, and changes by less than 2.65 / s: 1 / (1 + (d/s)²) by 0.65 / s where it
    is steepest, min(h, 1) by 2 / s. In a turn h changes by no more than the angle. Weights are products of what lies
    between 0 and 1, so slopes add up: `open` of itself and of all above it, `seen` of itself.
    """
    parent, size = case.parents(), case.records[:-1, 7].astype(np.float64)
    slope = np.ones(len(size)) if turning else 2.65 / np.maximum(size, 1e-9)
    steepest, above = slope / float(NEGLIGIBLE) + slope / float(OPENING), parent.copy()
    while np.any(above >= 0):
        steepest += np.where(above >= 0, slope[above] / float(OPENING), 0)
        above = np.where(above >= 0, parent[above], -1)
    return steepest


def _path(case: SurfelCase, turning: bool, count: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Positions and normals along a path from a vertex, and the length of a step."""
    place, normal = case.positions[7].astype(np.float64), case.normals[7].astype(np.float64)
    side = np.cross(normal, [0.3, -0.5, 0.8])
    side /= np.linalg.norm(side)
    t = np.linspace(0, 1, count)[:, None]
    still = np.zeros_like(t)
    positions, angle = place + 0.4 * side * (still if turning else t), 0.9 * (t if turning else still)
    normals = np.cos(angle) * normal + np.sin(angle) * side
    return positions.astype(np.float32), normals.astype(np.float32), (0.9 if turning else 0.4) / (count - 1)


@pytest.mark.parametrize("turning", [False, True])
def test_weights_are_continuous_in_position_and_normal(turning: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """From step to step no weight changes by more than its steepest slope allows; a hard cut would be seen to.

    Below the horizon, where nothing counts, weights are made of tips: so they are here above it, too.
    """
    monkeypatch.setattr(surfel_walk, "MIDDLE", TIPS)
    case = bumpy_case()
    positions, normals, step = _path(case, turning, 7000)
    large = np.flatnonzero(case.records[:-1, 7] > LARGE)
    dense = np.concatenate(
        [
            dense_weights(case, case.lists(positions[i : i + 500], normals[i : i + 500]))[:, large]
            for i in range(0, 7000, 500)
        ]
    )
    # positions are rounded to 6e-8: a hundredth of a step
    allowed = 1.01 * step * _steepest(case, turning)[large] + 1e-3
    assert allowed.max() < 0.25

    def breaks(weights: np.ndarray) -> int:
        return int(np.sum(np.abs(np.diff(weights, axis=0)) > allowed))

    assert breaks(dense) == 0
    # many come and go on the way: the bound is not kept for want of change
    assert np.sum(np.ptp(dense, axis=0) > 0.9) >= 5
    assert breaks((dense > 0.5).astype(np.float32)) >= 5


def test_a_surfel_and_what_stands_for_it_add_up_to_one() -> None:
    """While a surfel gives way, each of its children that matters but is not open itself has what it has lost."""
    case = bumpy_case()
    dense, parent, checked = dense_weights(case, case.lists()), case.parents(), []
    for vertex in range(0, 300, 3):
        _, importances = walked_list(case, case.positions[vertex], case.normals[vertex])
        own = case.positions[vertex].astype(float), case.normals[vertex].astype(float)
        for child, i in importances.items():
            node = int(parent[child])
            if node < 0 or parent[node] >= 0 or min(i, importances[node]) < 2 * NEGLIGIBLE:
                continue
            if importance_of(case.records[child].astype(float), *own, TIPS) < OPENING:
                assert dense[vertex, node] + dense[vertex, child] == pytest.approx(1, abs=1e-4)
                checked.append(dense[vertex, node])
    # they are met on all of the way
    assert len(checked) > 100 and np.histogram(checked, 5, (0, 1))[0].min() > 3


def test_no_surfel_stands_below_another_of_full_weight() -> None:
    """Along every branch of the tree weights add up to at most 1, and to 1 where all of it is important."""
    case = bumpy_case()
    dense, parent = dense_weights(case, case.lists())[:, :-1], case.parents()

    def is_closed(node: int, vertex: int) -> bool:
        own = case.positions[vertex].astype(float), case.normals[vertex].astype(float)
        inner = case.plan.tree.first_child[node] >= 0
        return not inner or importance_of(case.records[node].astype(float), *own, TIPS) < float(OPENING)

    total, above = dense.copy(), parent.copy()
    while np.any(above >= 0):
        total += np.where(above >= 0, dense[:, above], 0)
        above = np.where(above >= 0, parent[above], -1)
    assert total.max() < 1 + 1e-5
    checked = 0
    for vertex in range(0, 300, 10):
        _, importances = walked_list(case, case.positions[vertex], case.normals[vertex])
        for node, i in importances.items():
            branch, least = node, i
            while (branch := int(parent[branch])) >= 0:
                least = min(least, importances[branch])
            if dense[vertex, node] > 0 and least > 2 * NEGLIGIBLE and is_closed(node, vertex):
                assert total[vertex, node] == pytest.approx(1, abs=1e-4)
                checked += 1
    assert checked > 100
    # a list that held opened surfels as well would be found out
    opened = dense.copy()
    opened[:, parent[np.flatnonzero((dense > 0).any(0) & (parent >= 0))]] = 1
    assert (opened + np.where(parent >= 0, opened[:, parent], 0)).max() > 1.5
