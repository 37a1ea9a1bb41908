"""STL files, binary and ASCII. Vertices 3 f, 3 f + 1, 3 f + 2 are the corners of facet f, as the file has them.

Facet normals are ignored: many programs write zeros, and the winding says the same. A binary file has as many facets
as it announces; what follows them is left out and noted.
"""

import re

import numpy as np

from gash_jax.formats.number_text import leading_columns, parse_rows, plain_text
from gash_jax.geometry.mesh import MeshError, RawMesh

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes) -> RawMesh:
    """Corners of all facets. Raises MeshError."""
    count = int.from_bytes(data[80:84], "little")
    spare, notes = len(data) - 84 - count * _FACET.itemsize, ()
    if len(data) >= 84 and spare >= 0:  # four bytes of text would be a count of a hundred million
        corners = np.frombuffer(data, _FACET, count, 84)["corners"].reshape(-1, 3)
        notes = (
            (f"{spare} {'byte' if spare == 1 else 'bytes'} after the last facet that the STL file announces: left out",)
            if spare
            else ()
        )
    else:
        corners = _ascii_corners(plain_text(data))
    return RawMesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3), None, notes)


def _ascii_corners(data: bytes) -> np.ndarray:
    if data.lstrip()[:5].lower() != b"solid":
        raise MeshError("neither an ASCII STL file nor as long as a binary one: it is cut off or something else")
    rows = re.findall(rb"^[ \t]*vertex[ \t]([^\r\n]*)", data, flags=re.MULTILINE | re.IGNORECASE)
    facets = len(re.findall(rb"^[ \t]*endfacet", data, flags=re.MULTILINE | re.IGNORECASE))
    if len(rows) != 3 * facets or not re.search(rb"endsolid", data[-4096:], flags=re.IGNORECASE):
        raise MeshError("the STL file has no end, or facets without three vertices: it is cut off or damaged")
    corners = leading_columns(*parse_rows(b"\n".join(rows)), 3)
    if len(corners) != len(rows):
        raise MeshError("an STL vertex has no numbers: the file is damaged")
    return corners
