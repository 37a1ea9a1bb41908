"""A closed bumpy mesh of any number of vertices, and rotations, for the tests of graphs and networks."""

from typing import Any

import jax
import numpy as np
from scipy.spatial import ConvexHull

from gash_jax.geometry.mesh import Mesh, angle_weighted_normals
from gash_jax.graph.surfel_graph import SurfelGraph, with_surfels


def bumpy_mesh(count: int, seed: int = 0) -> Mesh:
    """A star-shaped surface over random directions, outward faces."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    faces = ConvexHull(directions).simplices.astype(np.int32)
    a, b, c = (directions[faces[:, i]] for i in range(3))
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), a) < 0
    faces[inward] = faces[inward][:, ::-1]
    vertices = (directions * (1 + 0.3 * np.sin(5 * directions[:, :1]))).astype(np.float32)
    return Mesh(vertices, angle_weighted_normals(vertices, faces).astype(np.float32), faces)


def random_variables(module: Any, *inputs: Any, spread: float = 0.3) -> Any:
    """Weights that are random in every layer, without compiling the module's own initialisation."""
    rng = np.random.default_rng(0)
    shapes = jax.eval_shape(module.init, jax.random.key(0), *map(network_inputs, inputs))
    return jax.tree.map(lambda leaf: rng.normal(0, spread, leaf.shape).astype(np.float32), shapes)


def random_rotation(seed: int) -> np.ndarray:
    """A proper rotation, float64."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.linalg.det(q)


def network_inputs(graph: Any) -> Any:
    """What a network is applied to, of what its family reads of a mesh: of the surfel network its parts."""
    return surfel_parts(graph) if isinstance(graph, SurfelGraph) else graph


def surfel_parts(graph: SurfelGraph) -> tuple[Any, ...]:
    """The parts of a graph as the surfel network reads them."""
    return tuple(with_surfels(part, graph.records) for part in graph.parts)
