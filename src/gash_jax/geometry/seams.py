"""Seams of a texture, edges whose faces have different texture coordinates, and textures equal on both sides of them.

Along a seam the same points of the surface are looked up at two places of the texture. Between texels that were worked
out one by one the two lookups differ, and the seam shows. `SeamRows` holds one linear equation for every point of a row
of points on each seam, ends included and at most one texel apart on the longer side: lookup on one side = lookup on the
other. `equal_on_seams` moves the texels as little as possible, by weighted least squares, until all of these hold:
x + W S^T y with (S W S^T) y = -S x, the projection onto S x = 0, by a sparse factorisation. It exists for any x, and S
may have rows that say the same: the factorised matrix has a little more on its diagonal, and what this leaves of S x is
projected again. Texels whose centre lies beside their face weigh little, because nothing but the rim of their chart
looks them up. Between the points, the difference along a seam is that of two piecewise quadratic functions that agree
at both ends. More points would leave less of it, and move texels further from what was baked.

Faces meet at an edge where positions and normals of their vertices agree, whether or not the file repeats them for each
face. Where normals differ the edge is hard, and the transfer differs as well. Where more than two faces meet, each is
made equal to the next. Points where charts lie so close that a lookup mixes them are left out (`apart_rows`).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array, csr_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from gash_jax.geometry.bilinear import taps
from gash_jax.geometry.mesh import Mesh, connected_labels
from gash_jax.geometry.texture_coordinates import FLAT, corner_areas
from gash_jax.geometry.topology import build_edges, weld

MIXED = 1e-3  # weight of another chart's texel from which on a lookup mixes with it
SAME = 1e-3  # texels: two places of a lookup that are one
INSIDE = 0.1  # how easily a texel inside its face moves, beside 1 for one at the rim
TOLERANCE, ROUNDS = 1e-6, 8  # largest difference left, as a part of the largest value; projections at most
MORE = 1e-12  # of the largest element of the diagonal


class SeamRows(NamedTuple):
    """Points on seams: the texels that each side looks up, with their weights."""

    texels: Int[np.ndarray, "s 8"]  # four of one side, then four of the other
    weights: Float[np.ndarray, "s 8"]  # below 0 on the other side: their sum is 0
    charts: Int[np.ndarray, "s 2"]  # number of the chart on each side
    chart_of: Int[np.ndarray, "f"]  # chart of each face: those that hang together in the texture


def seam_rows(mesh: Mesh, uv: Float[np.ndarray, "f 3 2"], size: int, per_texel: int = 1) -> SeamRows:
    """The equations of all seams of a mesh in a texture of `size` x `size`, for so many points a texel."""
    welded = weld(np.concatenate([mesh.vertices, mesh.normals], axis=1))[mesh.faces]
    edges = build_edges(welded, len(mesh.vertices))
    face, corner = np.divmod(edges.halfedge, 3)
    kept = np.flatnonzero(np.abs(corner_areas(uv))[face] > FLAT)
    ends = uv[face[:, None], np.stack([corner, (corner + 1) % 3], axis=1)].astype(np.float64)
    ends = np.where(edges.forward[:, None, None], ends, ends[:, ::-1])
    one, other = kept[:-1], kept[1:]
    meet = edges.edge[one] == edges.edge[other]
    one, other = one[meet], other[meet]
    apart = np.abs(ends[one] - ends[other]).max(axis=(1, 2)) * size > SAME
    chart_of = connected_labels(face[one[~apart]], face[other[~apart]], len(mesh.faces))
    one, other = one[apart], other[apart]
    sides = np.stack([ends[one], ends[other]], axis=1)  # (seam, side, end, 2)
    lengths = np.sqrt(np.sum((sides[:, :, 1] - sides[:, :, 0]) ** 2, axis=-1)).max(axis=1) * size
    steps = np.ceil(per_texel * lengths).astype(np.int64).clip(1)
    seam = np.repeat(np.arange(len(one)), steps + 1)
    step = np.arange(len(seam)) - np.repeat(np.cumsum(steps + 1) - steps - 1, steps + 1)
    share = (step / steps[seam])[:, None, None]
    places = sides[seam, :, 0] * (1 - share) + sides[seam, :, 1] * share
    found = [taps(places[:, side], size) for side in (0, 1)]
    texels = np.concatenate([found[0][0], found[1][0]], axis=1)
    weights = np.concatenate([found[0][1], -found[1][1]], axis=1)
    charts = np.stack([chart_of[face[one]], chart_of[face[other]]], axis=1)[seam]
    return SeamRows(texels, weights, charts, chart_of)


def apart_rows(rows: SeamRows, texel_chart: Int[np.ndarray, "n"]) -> SeamRows:
    """Without the points whose lookups reach texels of another chart: there the charts lie too close for this size."""
    strange = texel_chart[rows.texels] != np.repeat(rows.charts, 4, axis=1)
    good = ~np.any(strange & (np.abs(rows.weights) > MIXED), axis=1)
    return rows._replace(texels=rows.texels[good], weights=rows.weights[good], charts=rows.charts[good])


def equal_on_seams(
    values: Float[np.ndarray, "n c"], rows: SeamRows, inside: Bool[np.ndarray, "n"]
) -> Float[np.ndarray, "n c"]:
    """Values of all texels, those that seams look up moved until both sides agree; `inside`: centres on their face."""
    if not len(rows.texels):
        return values
    used, columns = np.unique(rows.texels, return_inverse=True)
    number = np.repeat(np.arange(len(rows.texels)), 8)
    sides = csr_array((rows.weights.ravel(), (number, columns.ravel())), shape=(len(rows.texels), len(used)))
    pull = (diags_array(np.where(inside[used], INSIDE, 1.0)) @ sides.T).tocsr()
    solve = _factorised((sides @ pull).tocsc())
    moved = values[used].astype(np.float64)
    enough = TOLERANCE * np.abs(moved).max(initial=0)
    for _ in range(ROUNDS):
        left = sides @ moved
        if np.abs(left).max() <= enough:
            break
        moved -= pull @ solve(left)
    result = values.copy()
    result[used] = moved.astype(values.dtype)
    return result


def _factorised(matrix: csc_array) -> Callable[[np.ndarray], np.ndarray]:
    """Solver of a symmetric, positive semidefinite matrix with `MORE` on its diagonal."""
    diagonal = matrix.diagonal()
    more = MORE * diagonal.max() * eye_array(len(diagonal), format="csc")
    found = splu(matrix + more, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return found.solve


def seam_jumps(values: Float[np.ndarray, "n c"], rows: SeamRows) -> Float[np.ndarray, "s c"]:
    """Difference of the two lookups at every point on the seams."""
    return np.einsum("st,stc->sc", rows.weights, values[rows.texels].astype(np.float64))
