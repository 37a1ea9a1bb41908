"""Which way is out: a consistent, outward winding to take normals from, with the faces left as they are.

The faces that count (no repeated index, the first of each set of duplicates) are joined into *sheets* across
edges with exactly two faces. Equal positions count as one vertex here, so STL corners and texture seams do not
tear the surface apart; but across such a seam only faces that are wound alike are joined.

1. Inside a sheet the winding is made to agree. Faces joined by properly wound edges form patches; each patch is
   kept or reversed, decided on the double cover of the patch graph (two nodes per patch, one for each winding;
   an improperly wound edge joins opposite ones). The winding with the larger area stays. A sheet where both
   nodes of a patch meet has only one side (Möbius): it keeps the file's winding.
2. A sheet is *solid*, its outside known, if it has a volume and is closed, or its holes are at most 5 % of its
   surface (a hole of perimeter L has at most the area L²/4pi). Negative volume then means that it faces inward,
   and it is reversed: no light could reach that side. An open sheet keeps the file's winding, because a room, a
   bowl and a shell differ in nothing else; unless the file contradicts itself (mixed winding, or every face
   both ways), when volume decides too, or unless nine tenths of what is solid in the file faced inward.
3. A closed sheet inside an odd number of others may be the wall of a cavity or a solid of its own; the file
   knows, so it is reversed only if the sheet around it is.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.geometry.mesh import connected_labels, lengths, vector_areas
from gash_jax.geometry.nesting import containment
from gash_jax.geometry.topology import (
    Edges,
    build_edges,
    cyclic_ascent,
    first_of_duplicates,
    has_repeated_index,
    loop_labels,
    weld,
)

OPEN_FRACTION = 0.05
WEAK_VOLUME = 1e-6  # of area^1.5: below, a sheet is flat and its volume is rounding
WEAK_VOICE = 0.5  # net share of the area wound one way, below which a file contradicts itself
INSIDE_OUT = 0.9  # share of the solid area facing inward from which open sheets follow


class Orientation(NamedTuple):
    """What to reverse, and why."""

    reverse: Bool[np.ndarray, "f"]  # faces to be read with the opposite winding
    sheet: Int[np.ndarray, "f"]  # sheet of each face, -1 for a repeated index
    solid: Bool[np.ndarray, "s"]  # the outside of the sheet is known
    inward: Bool[np.ndarray, "s"]  # the sheet faced inward and is reversed
    one_sided: Bool[np.ndarray, "s"]
    doubtful: Bool[np.ndarray, "s"]  # open sheet that seems to face inward: kept
    seamed: Bool[np.ndarray, "s"]  # closed only because equal positions count as one vertex
    rewound: int  # faces reversed to agree with their neighbours


class _Sheets(NamedTuple):
    """Faces that count, joined and wound alike."""

    sheet: Int[np.ndarray, "f"]
    turned: Bool[np.ndarray, "f"]  # reversed to agree with the neighbours
    one_sided: Bool[np.ndarray, "s"]
    paired: Bool[np.ndarray, "e"]  # edges whose two faces now run in opposite directions


def orient(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], edges: Edges | None = None
) -> Orientation:
    """Decide the outward winding of `faces` (module docstring).

    `vertices` in float64, about their centre; `edges` those of all `faces` by index, to save building them again.
    """
    position = weld(vertices)
    count = int(position.max()) + 1
    welded = faces if count == len(vertices) else position[faces]
    first = first_of_duplicates(welded, count)
    proper = ~has_repeated_index(welded)
    counted = np.flatnonzero(proper & (first == np.arange(len(faces))))
    number = np.full(len(faces), -1)
    number[counted] = np.arange(len(counted))
    number = np.where(proper, number[first], -1)  # a duplicate is treated as the face it repeats
    if not len(counted):
        none = np.zeros(0, dtype=bool)
        return Orientation(np.zeros(len(faces), dtype=bool), number, none, none, none, none, none, 0)
    kept, vectors = faces[counted], vector_areas(vertices, faces)
    if edges is None or len(kept) < len(faces) or welded is not faces:
        edges = build_edges(welded[counted], count)
    sheets = _join(edges, kept, lengths(vectors[counted]))
    area, volume = _measure(vertices, kept, vectors[counted], sheets)
    hole = _hole_areas(vertices, kept, sheets, edges)
    certain = (np.abs(volume) > WEAK_VOLUME * area**1.5) & ~sheets.one_sided
    closed = certain & (hole <= OPEN_FRACTION * (area + hole))
    ascent = cyclic_ascent(welded)
    agrees = (ascent == ascent[first]) ^ sheets.turned[number]
    solid = certain & (closed | (_voice(lengths(vectors), agrees, sheets.sheet, number) < WEAK_VOICE))
    corners = vertices[np.where(sheets.turned[:, None], kept[:, ::-1], kept)]
    inward = _inward(corners, sheets.sheet, solid, closed, volume)
    doubtful = certain & ~solid & (volume < 0)
    if area[inward].sum() > INSIDE_OUT * area[solid].sum():
        inward, solid, doubtful = inward | doubtful, solid | doubtful, np.zeros_like(doubtful)
    return Orientation(
        reverse=(number >= 0) & (sheets.turned ^ inward[sheets.sheet])[number],
        sheet=np.where(number >= 0, sheets.sheet[number], -1),
        solid=solid,
        inward=inward,
        one_sided=sheets.one_sided,
        doubtful=doubtful,
        seamed=_seamed(kept, sheets.sheet, hole) if count < len(vertices) else np.zeros(len(hole), dtype=bool),
        rewound=int(sheets.turned.sum()),
    )


def _join(edges: Edges, faces: Int[np.ndarray, "f 3"], areas: Float[np.ndarray, "f"]) -> _Sheets:
    """Join faces into sheets and wind each sheet alike (rule 1)."""
    pair = np.flatnonzero(edges.faces_at == 2)
    h, g = edges.halfedge[edges.start[pair]], edges.halfedge[edges.start[pair] + 1]
    proper = edges.forward[edges.start[pair]] != edges.forward[edges.start[pair] + 1]
    patch = connected_labels(h[proper] // 3, g[proper] // 3, len(faces))
    patches = int(patch.max()) + 1
    tails, heads = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    against = ~proper
    against[against] = (tails[h[against]] == tails[g[against]]) & (heads[h[against]] == heads[g[against]])
    p, q = patch[h[against] // 3], patch[g[against] // 3]
    cover = connected_labels(np.append(p, p + patches), np.append(q + patches, q), 2 * patches)
    as_is, reversed_ = cover[:patches], cover[patches:]
    share = np.bincount(as_is, np.bincount(patch, areas, patches), 2 * patches) / areas.sum().clip(1e-300)
    share -= np.arange(2 * patches) * (1e-9 / patches)  # of two equal areas the first stays
    turn = share[as_is] < share[reversed_]
    _, sheet_of_patch = np.unique(np.minimum(as_is, reversed_), return_inverse=True)
    one_sided = np.zeros(int(sheet_of_patch.max()) + 1, dtype=bool)
    one_sided[sheet_of_patch[as_is == reversed_]] = True
    paired = np.zeros(len(edges.start), dtype=bool)
    paired[pair] = proper | against
    return _Sheets(sheet_of_patch[patch], turn[patch], one_sided, paired)


def _measure(
    vertices: np.ndarray, faces: np.ndarray, vectors: np.ndarray, sheets: _Sheets
) -> tuple[Float[np.ndarray, "s"], Float[np.ndarray, "s"]]:
    """Area of each sheet and its signed volume about its own centroid."""
    sheet, count = sheets.sheet, len(sheets.one_sided)
    areas = lengths(vectors)
    area = np.bincount(sheet, areas, count)
    middle = (vertices[faces[:, 0]] + vertices[faces[:, 1]] + vertices[faces[:, 2]]) / 3
    safe = np.where(area > 0, area, 1.0)
    centroid = np.stack([np.bincount(sheet, areas * m, count) / safe for m in middle.T], axis=1)
    heights = np.einsum("fi,fi->f", middle - centroid[sheet], vectors) * np.where(sheets.turned, -1.0, 1.0)
    return area, np.bincount(sheet, heights, count) / 3


def _hole_areas(vertices: np.ndarray, faces: np.ndarray, sheets: _Sheets, edges: Edges) -> Float[np.ndarray, "s"]:
    """Sum over the boundary loops of each sheet of L²/4pi.

    At an edge between two faces of a sheet the two directions cancel. Elsewhere what is left of their sum, sheet
    by sheet, is boundary; so a sheet that touches itself or another one along an edge can still be closed.
    """
    count = len(sheets.one_sided)
    rest = np.flatnonzero(~sheets.paired[edges.edge])
    face = edges.halfedge[rest] // 3
    sign = np.where(edges.forward[rest] ^ sheets.turned[face], 1, -1)
    key, inverse = np.unique(edges.edge[rest] * count + sheets.sheet[face], return_inverse=True)
    key = key[np.bincount(inverse, sign, len(key)) != 0]
    if not len(key):
        return np.zeros(count)
    edge, owner = np.divmod(key, count)
    halfedge = edges.halfedge[edges.start[edge]]  # for its ends: the edge itself may have welded numbers
    tail, head = faces.ravel()[halfedge], faces[:, [1, 2, 0]].ravel()[halfedge]
    loop = loop_labels(edges.vertices[edge] * count + owner[:, None])
    length = np.bincount(loop, lengths(vertices[head] - vertices[tail]))
    owner_of_loop = np.zeros(len(length), dtype=np.int64)
    owner_of_loop[loop] = owner
    return np.bincount(owner_of_loop, length**2 / (4 * np.pi), count)


def _voice(areas: np.ndarray, agrees: np.ndarray, sheet: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Net share of the area of each sheet, duplicates included, that the file winds one way."""
    among = number >= 0
    votes = np.where(agrees, areas, -areas)[among]
    total = np.bincount(sheet[number[among]], areas[among])
    return np.abs(np.bincount(sheet[number[among]], votes)) / np.where(total > 0, total, 1.0)


def _inward(
    corners: Float[np.ndarray, "f 3 3"], sheet: np.ndarray, solid: np.ndarray, closed: np.ndarray, volume: np.ndarray
) -> Bool[np.ndarray, "s"]:
    """Which solid sheets face inward: by volume, or as the sheet around them (rule 3)."""
    inward = solid & (volume < 0)
    if np.count_nonzero(closed) < 2:
        return inward
    inner, outer = containment(corners, sheet, closed).T
    own = inward[closed]
    order = np.lexsort((outer, np.abs(volume[closed])[outer], inner))
    _, smallest = np.unique(inner[order], return_index=True)
    parent = np.arange(len(own))
    parent[inner[order][smallest]] = outer[order][smallest]
    odd = np.bincount(inner, minlength=len(own)) % 2 == 1
    inward[closed] = np.where(odd, own[parent], own)
    return inward


def _seamed(faces: np.ndarray, sheet: np.ndarray, hole: np.ndarray) -> Bool[np.ndarray, "s"]:
    """Sheets without a hole that have boundary edges by vertex index."""
    edges = build_edges(faces, int(faces.max()) + 1)
    seamed = np.zeros(len(hole), dtype=bool)
    seamed[sheet[edges.halfedge[edges.start[edges.faces_at == 1]] // 3]] = True
    return seamed & (hole == 0)
