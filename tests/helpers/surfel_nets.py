"""A small surfel network of six bands and two bounces with random weights, and a bumpy mesh to try it on."""

from functools import cache
from typing import Any

import jax
import numpy as np

from gash_jax.geometry.mesh import Mesh
from gash_jax.graph.surfel_graph import SurfelGraph, surfel_graph, with_surfels
from gash_jax.nn.surfel_net import SurfelNet
from tests.helpers.bumpy import bumpy_mesh, random_variables

BUMPY: Mesh = bumpy_mesh(200)
SMALL_SURFELS: dict[str, Any] = {"channels": 8, "layers": 1, "known_bands": 6, "known_bounces": 2}


@cache
def bumpy_graph() -> SurfelGraph:
    return surfel_graph(BUMPY)


def joined_part(graph: SurfelGraph) -> dict[str, np.ndarray]:
    """All vertices in the order of the parts as one part, their lists filled to one width: one thing to compile."""
    parts = [part for part in graph.parts if len(part["normal"])]
    width = max(part["weight"].shape[1] for part in parts)
    fill = {"table": len(graph.records) - 1, "weight": 0}
    filled = [
        part
        | {
            name: np.pad(part[name], ((0, 0), (0, width - part[name].shape[1])), constant_values=value)
            for name, value in fill.items()
        }
        for part in parts
    ]
    return {name: np.concatenate([part[name] for part in filled]) for name in parts[0]}


def filled_parts(graph: SurfelGraph) -> tuple[Any, ...]:
    """That part as the network reads it."""
    return (with_surfels(joined_part(graph), graph.records),)


@cache
def bumpy_parts() -> tuple[Any, ...]:
    return filled_parts(bumpy_graph())


def normals_of(parts: tuple[Any, ...]) -> np.ndarray:
    return np.concatenate([part["normal"] for part in parts])


@cache
def surfel_apply(bands: int = 3, bounces: int = 0) -> Any:
    return jax.jit(SurfelNet(**SMALL_SURFELS, bands=bands, bounces=bounces).apply)


@cache
def surfel_variables() -> Any:
    return random_variables(SurfelNet(**SMALL_SURFELS), bumpy_parts(), spread=0.1)
