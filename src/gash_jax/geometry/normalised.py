"""A mesh in its own terms: its centre, its units of length, its areas; each computed when first asked for, and once.

*Centre*: of the bounding box of the vertices that belong to a face. *Loose* vertices belong to none and may lie
anywhere. Two units of length: half the diagonal of that box, in which everything lies within the unit ball, and the
*radius of the surface*, the root mean square distance of its faces from their centroid, weighted by area (each face
at its own centroid). The radius turns with the mesh, which the box does not, and does not depend on how finely each
part is triangulated, which the vertices do. Everything is float64.
"""

from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from gash_jax.geometry.mesh import Mesh, lengths, referenced, vector_areas

SHORT = 3072  # OpenBLAS takes threads from 9216 numbers of a matrix on, and from 10000 of a vector
ROUNDING = 1e-9  # of half the diagonal: a smaller radius is what float64 left of 0


def long_product(left: Float[np.ndarray, "*a n"], right: Float[np.ndarray, "n *b"]) -> Any:
    """left @ right, "*a *b", over a long axis n, in parts so short that BLAS does not start threads.

    Those wait for more work by keeping their cores busy, for tens of milliseconds after some microseconds of it.
    """
    return sum(left[..., i : i + SHORT] @ right[i : i + SHORT] for i in range(0, max(len(right), 1), SHORT))


class NormalisedMesh:
    """A mesh and what follows from it alone. The arrays of `mesh` must not change while this is in use."""

    def __init__(self, mesh: Mesh):
        self.mesh = mesh

    @classmethod
    def of(cls, mesh: "Mesh | NormalisedMesh") -> "NormalisedMesh":
        """The mesh normalised, or what is so already: functions that share one object take either."""
        return mesh if isinstance(mesh, NormalisedMesh) else cls(mesh)

    @cached_property
    def referenced(self) -> Bool[np.ndarray, "v"]:
        """Which vertices belong to a face."""
        return referenced(self.mesh)

    @cached_property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Lowest and highest corner of the bounding box of the referenced vertices, of which there must be one."""
        used = self.referenced
        points = self.mesh.vertices if used.all() else self.mesh.vertices[used]
        columns = points.T.astype(np.float64, order="C")  # a row of three numbers is too short to reduce over
        return np.stack([columns.min(axis=1), columns.max(axis=1)])

    @cached_property
    def center(self) -> Float[np.ndarray, "3"]:
        """Middle of the bounding box."""
        return (self.box[0] + self.box[1]) / 2

    @cached_property
    def half_diagonal(self) -> float:
        """Half the diagonal of the bounding box."""
        return float(np.linalg.norm(self.box[1] - self.box[0]) / 2)

    @cached_property
    def vector_areas(self) -> Float[np.ndarray, "f 3"]:
        """Area times unit normal of each face."""
        return vector_areas(self.mesh.vertices, self.mesh.faces)

    @cached_property
    def areas(self) -> Float[np.ndarray, "f"]:
        """Area of each face."""
        return lengths(self.vector_areas)

    @cached_property
    def radius(self) -> float:
        """Radius of the surface (module docstring); 0 without area, and where all faces have one centroid."""
        points, total = self.mesh.vertices.astype(np.float64), max(self.areas.sum(), np.finfo(float).tiny)
        first, second, third = (np.take(points, self.mesh.faces[:, i], axis=0) for i in range(3))
        middles = (first + second + third) / 3
        middles -= long_product(self.areas, middles) / total
        radius = float(np.sqrt(long_product(self.areas, np.einsum("fi,fi->f", middles, middles)) / total))
        return radius if radius > ROUNDING * self.half_diagonal else 0.0

    def positions(self, unit: float) -> Float[np.ndarray, "v 3"]:
        """(vertex - center) / unit; a loose vertex is moved to the nearest point of the bounding box."""
        positions = (self.mesh.vertices.astype(np.float64) - self.center) / unit
        loose = ~self.referenced
        if loose.any():
            corner = np.abs(positions[~loose]).max(axis=0)
            positions[loose] = np.clip(positions[loose], -corner, corner)
        return positions
