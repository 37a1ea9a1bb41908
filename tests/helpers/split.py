"""A mesh as a program writes it that splits vertices along seams of a texture."""

import numpy as np

from gash_jax.geometry.mesh import Mesh


def split_mesh(mesh: Mesh) -> tuple[Mesh, np.ndarray]:
    """The mesh with copies, last, of the vertices between its first and its second half of faces; which each is of."""
    first, second = np.array_split(mesh.faces, 2)
    both = np.intersect1d(first, second)
    number = np.arange(len(mesh.vertices), dtype=np.int32)
    number[both] = len(mesh.vertices) + np.arange(len(both))
    of = np.concatenate([np.arange(len(mesh.vertices)), both])
    return Mesh(mesh.vertices[of], mesh.normals[of], np.concatenate([first, number[second]])), of
