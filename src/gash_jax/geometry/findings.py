"""The words of a health report: for each finding, what was found and what was done about it."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple


class Wording(NamedTuple):
    """Reads "<number> <one|several> <found> (first: ...): <done>"."""

    one: str
    several: str
    found: str
    done: str


_FACE = ("face", "faces")
_VERTEX = ("vertex", "vertices")
_EDGE = ("edge", "edges")
_SURFACE = ("surface", "surfaces")

WORDING: dict[str, Wording] = {
    "separate_parts": Wording("part", "parts", "without a common vertex", "baked together, they shadow each other"),
    "degenerate_faces": Wording(
        *_FACE, "without area", "kept in the mesh, used for normals only where a vertex has no other"
    ),
    "duplicate_faces": Wording(
        *_FACE, "on the vertices of an earlier face", "kept in the mesh, the first counts for the normals"
    ),
    "isolated_vertices": Wording(*_VERTEX, "in no face", "index kept, normal 0, transfer 0"),
    "boundary_edges": Wording(*_EDGE, "with one face only", "the rim of a hole, where light gets through, or a seam"),
    "seamed_surfaces": Wording(
        *_SURFACE,
        "open only in that corners at equal positions have indices of their own",
        "counted as closed when looking for the outside, vertices kept apart",
    ),
    "non_manifold_edges": Wording(*_EDGE, "with more than two faces", "kept, winding is not compared there"),
    "non_manifold_vertices": Wording(*_VERTEX, "where fans of faces touch", "kept, one normal serves all the fans"),
    "inconsistent_winding": Wording(
        "directed edge", "directed edges", "used by more than one face", "faces left as they are"
    ),
    "rewound_faces": Wording(
        *_FACE, "wound against the neighbours", "reversed for the normals; faces left as they are"
    ),
    "inward_surfaces": Wording(
        *_SURFACE,
        "whose normals point inward",
        "flipped for the bake; faces left as they are",
    ),
    "inward_faced_surfaces": Wording(
        *_SURFACE,
        "whose faces point inward",
        "faces left as they are, normals are the file's",
    ),
    "doubtful_surfaces": Wording(
        *("open surface", "open surfaces"),
        "that may point inward",
        "kept as in the file, as a room or a bowl would look the same; reverse the faces if it is neither",
    ),
    "one_sided_surfaces": Wording(*_SURFACE, "with only one side", "winding kept, normals cannot agree"),
    "flipped_file_normals": Wording(
        *_VERTEX, "whose normals in the file point into a closed surface", "flipped for the bake"
    ),
    "replaced_file_normals": Wording(*_VERTEX, "without a usable normal in the file", "normal computed from the faces"),
    "vertices_without_normal": Wording(*_VERTEX, "without a usable normal", "normal 0, transfer 0"),
}


def describe(counts: Mapping[str, int], first: Mapping[str, Sequence]) -> list[str]:
    """A line for each count of `WORDING` that is not 0, naming the first few of what was found."""
    return [_line(WORDING[name], counts[name], first.get(name, ())) for name in WORDING if counts[name]]


def _line(wording: Wording, count: int, first: Sequence) -> str:
    noun = wording.one if count == 1 else wording.several
    named = ", ".join("-".join(map(str, item)) if isinstance(item, list) else str(item) for item in first)
    more = ", ..." if 0 < len(first) < count else ""
    where = f" (first: {named}{more})" if named else ""
    return f"{count} {noun} {wording.found}{where}: {wording.done}"
