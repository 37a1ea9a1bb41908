"""What a guided bake is off by after its first rays, from the reconstruction of a small part of the mesh.

To reconstruct all vertices takes as long as tracing some ten rays for each; how many more a mesh needs is known from
far less. The part is runs of neighbours along the curve that visits them, with two rings around, as far as two passes
of the network look. What the network expects there to be left follows, vertex by vertex, rather closely from the
shares of free rays of the vertex and its neighbours, which all vertices have:

    log v_i = a + b log(m_i) + c log(s_i) + d log(o_i)

m and o are p (1 - p) for the mean share p of a vertex and its neighbours and for its own, s is how far the shares of
the neighbours lie apart; a to d are fitted to the part by least squares, then scaled so that it has the sum it has.
It holds as long as all vertices have as many rays. The error of all then comes out within a fifth of what the
reconstruction of all says (test).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from gash_jax.models.reconstruction import Network, Surface, reconstruct
from gash_jax.nn.reconstruction import LEAST
from gash_jax.prt.few_rays import FewRays

RUN, FEWEST_RUNS = 40, 6  # vertices of a run; with two rings around, six runs are one block of a reconstruction
VERTICES_OF_A_RUN = 2048  # of a large mesh
LEAST_VERTICES = 2048  # of smaller meshes the whole is looked at
SOFT, SOFT_SPREAD, SMALLEST = 0.003, 0.02, 1e-12


class Sample(NamedTuple):
    """A part of a surface: `vertices` are its own and those around them, `asked` the places among them of its own."""

    vertices: Int[np.ndarray, "s"]
    asked: Int[np.ndarray, "q"]
    surface: Surface


def make_sample(surface: Surface, order: Int[np.ndarray, "a"]) -> Sample | None:
    """Runs of vertices that follow one another in this `order`, spread evenly over it; None where all is few."""
    count = len(order)
    if count < LEAST_VERTICES:
        return None
    runs = max(FEWEST_RUNS, count // VERTICES_OF_A_RUN)
    starts = np.linspace(0, count - RUN, runs).astype(np.int64)
    chosen = np.unique(order[starts[:, None] + np.arange(RUN)])
    index = chosen
    for _ in range(2):
        index = np.union1d(index, surface.table[:, index])
    number = np.full(count, -1, np.int32)
    number[index] = np.arange(len(index), dtype=np.int32)
    table = number[surface.table[:, index]]
    found = surface.found[:, index] & (table >= 0)
    table = np.where(found, table, np.arange(len(index), dtype=np.int32))
    places, normals, frames = (array[index] for array in (surface.places, surface.normals, surface.frames))
    return Sample(index, number[chosen], Surface(places, normals, frames, table, found))


def expected_everywhere(
    network: Network, sample: Sample, surface: Surface, few: FewRays, k: int
) -> tuple[Float[np.ndarray, "a"], float]:
    """Squared error expected of the first k coefficients of every vertex, and the energy of all of them.

    All vertices have as many rays.
    """
    index, asked = sample.vertices, sample.asked
    rebuilt = reconstruct(network, sample.surface, few.take(index))
    known = np.maximum(rebuilt.variance[asked, :k] - LEAST, 0).sum(axis=1, dtype=np.float64)
    features, chosen = _features(surface, few), index[asked]
    weights = np.linalg.lstsq(features[chosen], np.log(np.maximum(known, SMALLEST)), rcond=None)[0]
    variance = np.exp(features @ weights)
    variance *= known.sum() / variance[chosen].sum()
    # noise adds to the energy of what the rays say alone: it is taken out as the part has it
    of_rays = _energy(few.local[:, :k]), _energy(few.local[chosen, :k])
    energy = of_rays[0] * (_energy(rebuilt.coefficients[asked, :k]) / of_rays[1] if of_rays[1] > 0 else 1.0)
    return variance, energy


def _features(surface: Surface, few: FewRays) -> Float[np.ndarray, "a 4"]:
    share, count = few.share, 1 + np.count_nonzero(surface.found, axis=0)
    near = share[surface.table]  # the vertex itself where there is no edge
    mean = (share + np.where(surface.found, near, 0).sum(axis=0)) / count
    apart = np.abs(near - share).max(axis=0)
    columns = mean * (1 - mean) + SOFT, apart + SOFT_SPREAD, share * (1 - share) + SOFT
    return np.stack([np.ones(len(share)), *(np.log(column) for column in columns)], axis=1)


def _energy(values: np.ndarray) -> float:
    return float(np.sum(values.astype(np.float64) ** 2))
