"""Measures that are for `local` alone: how its error changes along edges, and how large it is beside what arrives."""

import numpy as np
from jaxtyping import Float, Int

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.graph.repeated_vertices import first_of_repeated
from gash_jax.graph.surfel_graph import normalised, outward_faces
from gash_jax.graph.surfels import curve_order, surface_axes

BLOCK, LEAD_BITS = 16, 12
# what is nearly dark is measured against this part of the closed form
ARRIVING = 0.05


def edges_and_places(mesh: Mesh) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "v"]]:
    """The edges between vertices that have a normal, each once, and every vertex's place on a space-filling curve."""
    shape = NormalisedMesh.of(mesh)
    positions = normalised(shape)[0]
    first = first_of_repeated(positions, mesh.normals)
    faces, area = outward_faces(shape, first)
    own = np.flatnonzero(first == np.arange(len(first)))
    order = curve_order(positions[own], mesh.normals[own], surface_axes(positions, faces, area), LEAD_BITS)
    place = np.zeros(len(first), np.int64)
    place[own[order]] = np.arange(len(own))
    pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)
    return edges[np.any(mesh.normals != 0, axis=1)[edges].all(axis=1)], place[first]


def jumps(
    mesh: Mesh, estimate: Float[np.ndarray, "v k"], reference: Float[np.ndarray, "v k"]
) -> dict[str, float | None]:
    """RMS differences of the error along edges from one block to another, over those along other edges.

    A block is BLOCK neighbours on the curve, as the first edition made them to share one list of surfels. `error` is
    against edges inside blocks, and `reference` the same of the reference, which knows no blocks: their borders lie
    along creases, and between large faces, more often than elsewhere. `shifted` leaves that out: it is against edges
    between blocks that begin half a block later, and 1 where the borders of blocks are no special place. None where
    there are no such edges.
    """
    edges, place = edges_and_places(mesh)
    at, later = (_crossing(edges, (place + shift) // BLOCK) for shift in (0, BLOCK // 2))
    error = estimate.astype(np.float64) - reference
    return {
        "error": _ratio(error, edges, at, ~at),
        "reference": _ratio(reference, edges, at, ~at),
        "shifted": _ratio(error, edges, at & ~later, later & ~at),
    }


def _crossing(edges: np.ndarray, block: np.ndarray) -> np.ndarray:
    return block[edges[:, 0]] != block[edges[:, 1]]


def _ratio(values: np.ndarray, edges: np.ndarray, some: np.ndarray, others: np.ndarray) -> float | None:
    """RMS difference along some edges over that along others."""
    square = np.mean((values[edges[:, 0]] - values[edges[:, 1]]) ** 2, axis=1)
    if not some.any() or not square[others].any():
        return None
    return float(np.sqrt(square[some].mean() / square[others].mean()))


def relative_error(mesh: Mesh, estimate: Float[np.ndarray, "v k"], reference: Float[np.ndarray, "v k"]) -> float | None:
    """RMS over vertices of |error| / (|reference| + ARRIVING |closed form|): what is dark counts like what is lit."""
    usable = np.any(mesh.normals != 0, axis=1)
    if not usable.any():
        return None
    formula = np.asarray(unshadowed_transfer(mesh.normals[usable], round(reference.shape[1] ** 0.5)))
    arriving = np.linalg.norm(reference[usable], axis=1) + ARRIVING * np.linalg.norm(formula, axis=1)
    return float(np.sqrt(np.mean((np.linalg.norm((estimate - reference)[usable], axis=1) / arriving) ** 2)))
