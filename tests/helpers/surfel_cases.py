"""A mesh with its surfels, and what a vertex of it should be shown by the definition of `surfel_walk`, in float64."""

from functools import cache
from typing import NamedTuple

import numpy as np

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph import surfel_walk
from gash_jax.graph.surfel_graph import SurfelPlan, normalised, plan_surfels
from gash_jax.graph.surfel_lists import SurfelList, list_surfels
from gash_jax.graph.surfel_walk import MIDDLE, NEGLIGIBLE, OPENING, TIPS
from gash_jax.graph.surfels import FAN
from tests.helpers.bumpy import bumpy_mesh

Weights = dict[int, float]


class SurfelCase(NamedTuple):
    plan: SurfelPlan
    records: np.ndarray
    positions: np.ndarray
    normals: np.ndarray

    def lists(
        self, positions: np.ndarray | None = None, normals: np.ndarray | None = None, moves: bool = True
    ) -> tuple[SurfelList, ...]:
        """With what is below the horizon, unless the mesh does not move."""
        own = (self.positions, self.normals) if positions is None or normals is None else (positions, normals)
        return list_surfels(self.plan.tree, self.records, *own, moves)[0]

    def parents(self) -> np.ndarray:
        first = self.plan.tree.first_child
        parent, inner = np.full(len(first), -1), np.flatnonzero(first >= 0)
        parent[(first[inner][:, None] + np.arange(FAN)).ravel()] = np.repeat(inner, FAN)
        return parent


def surfel_case(mesh: Mesh) -> SurfelCase:
    positions, _, _ = normalised(mesh)
    return SurfelCase(*plan_surfels(mesh, positions), positions, mesh.normals)


@cache
def bumpy_case() -> SurfelCase:
    return surfel_case(bumpy_mesh(300))


def dense_weights(case: SurfelCase, lists: tuple[SurfelList, ...]) -> np.ndarray:
    """Weights as one row of all surfels a vertex."""
    dense = np.zeros((sum(len(part.vertices) for part in lists), len(case.records)), np.float32)
    for part in lists:
        np.add.at(dense, (part.vertices[:, None], part.table), part.weight)
    return dense


def importance_of(
    record: np.ndarray, position: np.ndarray, normal: np.ndarray, rise: float | np.floating = MIDDLE
) -> float:
    """i of the module's docstring for one surfel and one vertex, or with `rise` = TIPS j."""
    if not record[6] > 0:
        return 0.0
    offset, s = record[:3] - position, record[7]
    length = np.sqrt(offset @ offset + s**2)
    return float((s / length) ** 2 * min(max((normal @ offset + float(rise) * s) / length, 0.0), 1.0))


def is_below_horizon(record: np.ndarray, position: np.ndarray, normal: np.ndarray) -> bool:
    """Whether a surfel's mean extent does not reach above the horizon of a vertex."""
    xx, yy, zz, xy, xz, yz = record[14:]
    spread = normal @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ normal
    return bool((record[:3] - position) @ normal + np.sqrt(max(spread, 0)) <= 0)


def walked_list(
    case: SurfelCase, position: np.ndarray, normal: np.ndarray, scale: float = 1.0
) -> tuple[Weights, Weights]:
    """Weight and importance of everything that a vertex sees, in float64; `scale` multiplies the importance.

    Of what is wholly below the horizon the importance is j, as in lists of a mesh that moves.
    """
    weights, importances = {}, {}
    waiting = [(node, 1.0) for node in range(case.plan.tree.level_sizes[0])]
    while waiting:
        node, above = waiting.pop()
        child = int(case.plan.tree.first_child[node])
        pair = case.records[node].astype(np.float64), position.astype(float), normal.astype(float)
        low = is_below_horizon(*pair)
        i, j = (scale * importance_of(*pair, rise) for rise in (TIPS if low else surfel_walk.MIDDLE, TIPS))
        opened = min(max(j / float(OPENING) - 1, 0.0), 1.0) if child >= 0 else 0.0
        weights[node] = above * (1 - opened) * min(max(i / float(NEGLIGIBLE) - 1, 0.0), 1.0)
        importances[node] = i
        if opened > 0:
            waiting.extend((node, above * opened) for node in range(child, child + FAN))
    return {node: weight for node, weight in weights.items() if weight > 0}, importances
