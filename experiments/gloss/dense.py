"""Radiance of chosen vertices by dense rays: the lobe or the microfacets, times visibility, times the light's own map.

Nothing is cut to bands here. Directions are uniform over the hemisphere, `REPLICATES` shifted point sets for each
vertex, whose scatter is the error of the integral; it is written out in float64.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import UNIFORM, sample_rays
from gash_jax.prt.visibility import visibility

REPLICATES, BLOCK = 4, 10

# (index of vertices (a, 1, 1), directions (a, r, n, 3)) -> (a, r, n)
Kernel = Callable[[np.ndarray, np.ndarray], np.ndarray]


class Rays(NamedTuple):
    """The rays of some vertices: `chosen` among those asked for, directions (a, r, n, 3), True where free (a, r, n)."""

    chosen: np.ndarray
    directions: np.ndarray
    free: np.ndarray


class Integral(NamedTuple):
    """Mean of the replicates and its standard error, (v, c) each."""

    value: np.ndarray
    error: np.ndarray


def choose_vertices(mesh: Mesh, count: int, seed: int) -> np.ndarray:
    """Vertices with a normal, at random, in ascending order."""
    usable = np.flatnonzero(np.any(mesh.normals != 0, axis=1))
    return np.sort(np.random.default_rng(seed).permutation(usable)[:count])


def only(mesh: Mesh, chosen: np.ndarray) -> Mesh:
    """The mesh with the normals of the chosen vertices alone: the others cast shadows and cost no ray."""
    normals = np.zeros_like(mesh.normals)
    normals[chosen] = mesh.normals[chosen]
    return mesh._replace(normals=normals)


def dense_rays(mesh: Mesh, chosen: np.ndarray, rays: int, seed: int, backend: str = "embree") -> Iterator[Rays]:
    """Blocks of vertices with `rays` uniform rays each."""
    geometry, rng = trace_geometry(mesh), np.random.default_rng([seed, 1])
    visible = visibility(geometry.vertices, geometry.faces, backend)
    frames = np.asarray(orthonormal_frame(mesh.normals[chosen]), np.float32)
    shifts = rng.random((len(chosen), REPLICATES, 2), np.float32)
    for start in range(0, len(chosen), BLOCK):
        index = np.arange(start, min(start + BLOCK, len(chosen)))
        origins, directions = sample_rays(
            geometry.origins[chosen[index]], frames[index], shifts[index], rays // REPLICATES, density=UNIFORM
        )
        shape = (len(index), REPLICATES, rays // REPLICATES)
        free = visible(np.asarray(origins), np.asarray(directions)).reshape(shape)
        yield Rays(index, np.asarray(directions, np.float64).reshape(*shape, 3), free)


def integrate(
    blocks: Iterator[Rays], radiance: Callable[[np.ndarray], np.ndarray], kernels: dict[str, Kernel]
) -> dict[str, Integral]:
    """Integral of kernel V L over the hemisphere of every vertex, for each kernel.

    `radiance(directions (n, 3))` is (n, 3).
    """
    parts: dict[str, list[np.ndarray]] = {name: [] for name in kernels}
    for index, directions, free in blocks:
        arriving = radiance(directions.reshape(-1, 3)).reshape(*free.shape, 3) * free[..., None]
        for name, kernel in kernels.items():
            value = kernel(index[:, None, None], directions)
            parts[name].append(np.einsum("arn,arnc->arc", value, arriving) * (2 * np.pi / free.shape[2]))
    return {name: _summary(np.concatenate(found)) for name, found in parts.items()}


def _summary(replicas: np.ndarray) -> Integral:
    return Integral(replicas.mean(1), replicas.std(1, ddof=1) / np.sqrt(replicas.shape[1]))
