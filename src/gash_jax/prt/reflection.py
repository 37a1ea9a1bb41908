"""What the surfaces that rays meet send back: values at their vertices, interpolated where a ray meets a face's front.

The *front* of a face is the side that its vertices' normals face: the normal of its winding, turned around where the
sum of the three vertex normals points the other way. Normals need not follow the winding (`geometry.orientation`), and
only they say on which side a vertex receives light. A ray that meets a face from behind finds nothing; so does one that
meets an open sheet on the side that no normal faces.

A ray that meets a front carries the values of the face's corners, weighted by the barycentrics of the hit.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt16
from scipy.sparse import csr_array

from gash_jax.geometry.mesh import Mesh, face_normals
from gash_jax.prt.rays import Hits

ONE = 65535  # the weight 1 of a hit that is kept


class Reflector(NamedTuple):
    """Faces, and the unit normals of their fronts; 0 for a face without area."""

    faces: Int[np.ndarray, "f 3"]
    fronts: Float[np.ndarray, "f 3"]


class KeptHits(NamedTuple):
    """The hits on fronts of some rows of rays, row after row, in 8 bytes each and 4 for a row.

    The weight of a face's first corner is what is left of `ONE`, so that the three never add up to more.
    """

    starts: Int[np.ndarray, "rows+1"]  # of each row among the hits; their number is last
    face: Int[np.ndarray, "h"]
    weights: UInt16[np.ndarray, "h 2"]  # of the second and third corner, in parts of `ONE`

    @property
    def nbytes(self) -> int:
        """Memory that they take."""
        return sum(array.nbytes for array in self)


class Reflected(NamedTuple):
    """What surfaces send back: the albedo times the transfer of their vertices, replicate by replicate, 0 where no
    light is received."""

    surface: Reflector
    sent: Float[np.ndarray, "s r k"]


def reflector(mesh: Mesh) -> Reflector:
    """The faces of a mesh with their fronts."""
    fronts = face_normals(mesh.vertices, mesh.faces).astype(np.float32)
    first, second, third = (mesh.normals[corner] for corner in mesh.faces.T)
    behind = np.einsum("fi,fi->f", fronts, first + second + third) < 0
    fronts[behind] *= -1
    return Reflector(mesh.faces, fronts)


def meets_front(surface: Reflector, hits: Hits, directions: Float[np.ndarray, "*r 3"]) -> Bool[np.ndarray, "*r"]:
    """Which rays meet a face, and on its front."""
    front = np.zeros(hits.face.size, bool)
    front[_front_hits(surface, hits, directions)] = True
    return front.reshape(hits.face.shape)


def _front_hits(surface: Reflector, hits: Hits, directions: Float[np.ndarray, "*r 3"]) -> Int[np.ndarray, "h"]:
    """Numbers of the rays that meet a front, all rays counted in a row."""
    met = np.flatnonzero(hits.face.ravel() >= 0)
    towards = np.take(directions.reshape(-1, 3), met, axis=0)
    fronts = np.take(surface.fronts, hits.face.ravel()[met], axis=0)
    return met[np.einsum("hi,hi->h", towards, fronts) < 0]


def keep_hits(surface: Reflector, hits: Hits, directions: Float[np.ndarray, "rows n 3"]) -> KeptHits:
    """The hits on fronts of rows of n rays each."""
    rows, n, _ = directions.shape
    index = _front_hits(surface, hits, directions)
    starts = np.searchsorted(index, n * np.arange(rows + 1)).astype(np.int32)
    face, u, v = (array.ravel()[index] for array in hits[:3])
    weights = np.empty((len(index), 2), np.uint16)
    weights[:, 0] = second = np.clip(np.rint(u * np.float32(ONE)), 0, ONE)
    weights[:, 1] = np.clip(np.rint(v * np.float32(ONE)), 0, ONE - second)
    return KeptHits(starts, face, weights)


def sums_at_hits(
    surface: Reflector, hits: KeptHits, values: Float[np.ndarray, "s r k"], scale: float
) -> Float[np.ndarray, "c r k"]:
    """`scale` times the sum of what the rays of each row find; row j belongs to replicate j mod r of `values`.

    One product of a sparse matrix, which other threads do not wait for.
    """
    vertices, replicates, width = values.shape
    rows = len(hits.starts) - 1
    kind = np.int32 if max(vertices * replicates, 3 * len(hits.face)) < 2**31 else np.int64
    corners = np.take(surface.faces, hits.face, axis=0).astype(kind, copy=False)
    if replicates > 1:
        corners *= kind(replicates)
        corners += np.repeat(np.arange(rows, dtype=kind) % replicates, np.diff(hits.starts))[:, None]
    weights = np.empty((len(hits.face), 3), np.float32)
    weights[:, 1:] = hits.weights
    weights[:, 0] = ONE - weights[:, 1] - weights[:, 2]
    weights *= np.float32(scale / ONE)
    matrix = csr_array(
        (weights.ravel(), corners.ravel(), (3 * hits.starts).astype(kind)), shape=(rows, vertices * replicates)
    )
    return (matrix @ values.reshape(-1, width)).reshape(-1, replicates, width)


def values_at_hits(
    surface: Reflector, hits: Hits, directions: Float[np.ndarray, "*r 3"], values: Float[np.ndarray, "s k"]
) -> Float[np.ndarray, "*r k"]:
    """What every single ray finds: `values` of the vertices interpolated at its hit, 0 where it meets no front."""
    front = meets_front(surface, hits, directions)
    u, v = hits.u[front], hits.v[front]
    weights = np.stack([1 - u - v, u, v], axis=1)
    found = np.zeros((*front.shape, values.shape[1]), values.dtype)
    found[front] = np.einsum("hj,hjk->hk", weights, values[surface.faces[hits.face[front]]])
    return found
