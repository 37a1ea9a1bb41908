"""OFF files in ASCII, with or without normals (N), colours (C) and texture coordinates (ST).

The counts may be glued to the first word, as in the ModelNet40 collection. A vertex or face is a line; what follows
its numbers on the line is ignored.
"""

import re

import numpy as np

from gash_jax.formats.number_text import leading_columns, parse_rows, plain_text, whole_numbers
from gash_jax.formats.polygons import triangulate
from gash_jax.geometry.mesh import MeshError, RawMesh


def read_off(data: bytes) -> RawMesh:
    """Positions, polygons, and normals of an NOFF file. Raises MeshError."""
    text = plain_text(data)
    early = text[:1].isspace()
    text = re.sub(rb"#[^\n]*", b"", text).lstrip()
    header = re.match(rb"(ST)?(C)?(N)?OFF(?![A-Za-z])[ \t]*(BINARY)?", text)
    if header is None or header[4]:
        raise MeshError("not an ASCII OFF file: it does not begin with OFF, or is binary")
    numbers, starts = parse_rows(text[header.end() :])
    if len(starts) < 2 or starts[1] < 2:
        raise MeshError("the OFF file has no counts of vertices and faces: it is cut off or damaged")
    vertex_count, face_count = whole_numbers(numbers[:2], "a count in the OFF file").tolist()
    if vertex_count < 0 or face_count < 0 or 1 + vertex_count + face_count >= len(starts):
        raise MeshError(
            f"the OFF file announces {vertex_count} vertices and {face_count} faces but has "
            f"{len(starts) - 2} lines for them: it is cut off"
        )
    columns = leading_columns(numbers, starts[1 : vertex_count + 2], 6 if header[3] else 3)
    rows = starts[vertex_count + 1 : vertex_count + face_count + 1]
    ends = starts[vertex_count + 2 : vertex_count + face_count + 2]
    sizes = whole_numbers(numbers[rows], "a number of corners in the OFF file")
    if np.any((sizes < 0) | (rows + 1 + sizes > ends)):
        raise MeshError("an OFF face has fewer corners than it announces: the file is cut off or damaged")
    at = np.repeat(rows + 1 - (np.cumsum(sizes) - sizes), sizes) + np.arange(sizes.sum())
    corners = whole_numbers(numbers[at], "a corner in the OFF file")
    faces, notes = triangulate(corners, sizes, columns[:, :3])
    notes = ("white space before the word OFF: skipped", *notes) if early else notes
    return RawMesh(columns[:, :3], faces, columns[:, 3:] if header[3] else None, notes)
