"""STL files, binary and ASCII. Vertices 3 f, 3 f + 1, 3 f + 2 are the corners of facet f, as the file has them.

Facet normals are ignored: many programs write zeros, and the winding says the same.
"""

import re

import numpy as np

from gash_jax.formats.raw_mesh import RawMesh, leading_columns, parse_rows
from gash_jax.geometry.mesh import MeshError

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def read_stl(data: bytes) -> RawMesh:
    """Corners of all facets. Raises MeshError."""
    count = int.from_bytes(data[80:84], "little")
    if len(data) >= 84 and len(data) == 84 + count * _FACET.itemsize:
        corners = np.frombuffer(data, _FACET, count, 84)["corners"].reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _ascii_corners(data)
    else:
        raise MeshError("neither an ASCII STL file nor as long as a binary one: it is cut off or something else")
    return RawMesh(corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3), None, ())


def _ascii_corners(data: bytes) -> np.ndarray:
    rows = re.findall(rb"^[ \t]*vertex[ \t]([^\r\n]*)", data, flags=re.MULTILINE | re.IGNORECASE)
    facets = len(re.findall(rb"^[ \t]*endfacet", data, flags=re.MULTILINE | re.IGNORECASE))
    if len(rows) != 3 * facets or not re.search(rb"endsolid", data[-4096:], flags=re.IGNORECASE):
        raise MeshError("the STL file has no end, or facets without three vertices: it is cut off or damaged")
    corners = leading_columns(*parse_rows(b"\n".join(rows)), 3)
    if len(corners) != len(rows):
        raise MeshError("an STL vertex has no numbers: the file is damaged")
    return corners
