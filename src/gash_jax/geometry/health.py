"""What is odd about a mesh, in numbers and in words; the door through which every mesh comes in.

`prepare_mesh` refuses what cannot be used (MeshError) and reports what can. It never repairs the data: faces
and vertices stay as they are, only normals are computed. Counts are by vertex index:

- degenerate face: a repeated index, or area <= 1e-12 of the squared bounding-box diagonal
- duplicate face: same vertex set as an earlier face
- isolated vertex: in no face; part: component of faces joined by shared vertices
- boundary edge: one face; non-manifold edge: more than two; watertight: neither
- non-manifold vertex: more than one fan of faces
- inconsistent winding: an edge direction used by more than one face
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Shaped

from gash_jax.geometry.checks import checked_box, checked_faces, checked_normals, checked_vertices
from gash_jax.geometry.findings import describe
from gash_jax.geometry.mesh import Mesh, face_areas, face_components, referenced, referenced_by
from gash_jax.geometry.normals import VertexNormals, vertex_normals
from gash_jax.geometry.orientation import Orientation, orient
from gash_jax.geometry.topology import (
    Edges,
    build_edges,
    fan_counts,
    first_of_duplicates,
    has_repeated_index,
    loop_labels,
    repeated_directions,
)

DEGENERATE_AREA = 1e-12
FLAT = 1e-6  # extent across, as a part of the bounding-box diagonal, up to which a mesh is planar
COARSE = 1e-5  # float32 spacing, as a part of the diagonal, from which a mesh is too far from the origin
FIRST = 5  # how many of the things found are named


class HealthReport(NamedTuple):
    """Counts, the first few indices behind them, and plain-language lines.

    >>> mesh, report = gash_jax.read_mesh("bunny.ply")
    >>> report.watertight, report.normals, report.lines()
    (True, 'file', [])
    """

    vertices: int
    faces: int
    parts: int
    watertight: bool
    planar: bool
    normals: str  # "file" or "computed"
    counts: dict[str, int]  # by finding (names in `findings.WORDING`, and "boundary_loops"), zeros included
    first: dict[str, list]  # by finding, the first few: face or vertex indices, pairs of vertices for edges
    notes: tuple[str, ...]  # what was found, and what was done

    def lines(self) -> list[str]:
        """One line for each finding; none for a mesh in perfect health."""
        return list(self.notes)

    def to_dict(self) -> dict[str, object]:
        """The report as flat JSON-able data."""
        head = {name: getattr(self, name) for name in self._fields[:6]}
        return {**head, **self.counts, "first": self.first, "notes": self.lines()}


def prepare_mesh(
    vertices: Shaped[np.ndarray, "..."],
    faces: Shaped[np.ndarray, "..."],
    normals: Shaped[np.ndarray, "..."] | None = None,
) -> tuple[Mesh, HealthReport]:
    """Check arrays as they come, give the vertices normals, and say what was found.

    `vertices` (v, 3) of any real type, `faces` (f, 3) integers, `normals` (v, 3) the file's own (non-finite or 0
    where a vertex has none). Raises MeshError where no mesh can be made of them.
    """
    points = checked_vertices(vertices)
    faces = checked_faces(faces, len(points))
    normals = None if normals is None else checked_normals(normals, len(points))
    used = referenced_by(faces, len(points))
    low, high = checked_box(points, used)
    local = points - (low + high) / 2
    edges = build_edges(faces, len(points))
    degenerate = has_repeated_index(faces) | (face_areas(local, faces) <= DEGENERATE_AREA * np.sum((high - low) ** 2))
    duplicate = first_of_duplicates(faces, len(points)) != np.arange(len(faces))
    orientation = orient(local, faces, edges)
    found = vertex_normals(local, faces, ~(degenerate | duplicate), orientation, normals)
    where = {
        "degenerate_faces": np.flatnonzero(degenerate),
        "duplicate_faces": np.flatnonzero(duplicate),
        "isolated_vertices": np.flatnonzero(~used),
        **_edge_findings(faces, edges, len(points)),
        **_normal_findings(found),
    }
    mesh = Mesh(points.astype(np.float32), found.normals.astype(np.float32), faces)
    return mesh, _report(mesh, local[used], where, orientation, found)


def _edge_findings(faces: np.ndarray, edges: Edges, vertex_count: int) -> dict[str, np.ndarray]:
    return {
        "boundary_edges": edges.vertices[edges.faces_at == 1],
        "non_manifold_edges": edges.vertices[edges.faces_at > 2],
        "non_manifold_vertices": np.flatnonzero(fan_counts(faces, edges, vertex_count) > 1),
        "inconsistent_winding": np.repeat(edges.vertices, repeated_directions(edges), axis=0),
    }


def _normal_findings(found: VertexNormals) -> dict[str, np.ndarray]:
    return {
        "flipped_file_normals": found.negated,
        "replaced_file_normals": found.filled,
        "vertices_without_normal": found.missing,
    }


def _surface_counts(orientation: Orientation, from_file: bool) -> dict[str, int]:
    """Findings about whole surfaces; with normals from the file, those about winding change nothing."""
    inward, computed = int(orientation.inward.sum()), not from_file
    return {
        "seamed_surfaces": int(orientation.seamed.sum()),
        "rewound_faces": orientation.rewound * computed,
        "inward_surfaces": inward * computed,
        "inward_faced_surfaces": inward * from_file,
        "doubtful_surfaces": int(orientation.doubtful.sum()) * computed,
        "one_sided_surfaces": int(orientation.one_sided.sum()),
    }


def _report(
    mesh: Mesh,
    points: Float[np.ndarray, "n 3"],
    where: dict[str, np.ndarray],
    orientation: Orientation,
    found: VertexNormals,
) -> HealthReport:
    """The report; `points` are the referenced vertices about their centre."""
    parts = int(face_components(mesh.faces).max()) + 1
    counts = {name: len(items) for name, items in where.items()}
    counts |= _surface_counts(orientation, found.from_file)
    counts["separate_parts"] = parts if parts > 1 else 0
    counts["boundary_loops"] = int(loop_labels(where["boundary_edges"]).max(initial=-1)) + 1
    first = {name: items[:FIRST].tolist() for name, items in where.items() if len(items)}
    diagonal = float(np.linalg.norm(np.ptp(points, axis=0)))
    across = np.linalg.eigh(points.T @ points)[1][:, 0]
    planar = bool(np.ptp(points @ across) <= FLAT * diagonal)
    notes = describe(counts, first)
    if planar:
        notes.append("the mesh is flat: nothing shadows it, its transfer is the closed form")
    spacing = float(np.spacing(np.abs(mesh.vertices[referenced(mesh)]).max())) / diagonal
    if spacing > COARSE:
        notes.append(
            f"the mesh lies far from the origin: its float32 coordinates have steps of {spacing:.0e} of its size; "
            "baked as it is, move it to the origin for full accuracy"
        )
    return HealthReport(
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        parts=parts,
        watertight=counts["boundary_edges"] == counts["non_manifold_edges"] == 0,
        planar=planar,
        normals="file" if found.from_file else "computed",
        counts=counts,
        first=first,
        notes=tuple(notes),
    )
