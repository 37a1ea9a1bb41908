"""What stands in a request: counts in the query, arrays in the body, little-endian, without any header between them.

    POST /meshes?vertices=V&faces=F      V x 3 float32 positions [, V x 3 float32 normals], F x 3 int32 faces
    POST /meshes/ID/poses                V x 3 float32 positions

The length of the body follows from the counts, and says whether normals are there; any other length is refused before
a byte of the body is read. So the limits of vertices and faces are that of the body.

Normals that are sent are made unit and taken as they are, 0 where a vertex has none; without them they are computed
from the faces, as for a file without normals.

A soup of faces that are as long as the mesh is refused: every vertex would walk through all of them, which takes
minutes and gigabytes. On a surface the squared lengths of the faces add up to some tens of its squared radius, however
fine it is; more than CROWDED / 9 of it, with more than CROWDED faces, is such a soup.
"""

from collections.abc import Collection, Mapping

import numpy as np

from gash_jax.apps.service.limits import Limits, Refusal
from gash_jax.files.settings import near_names
from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.checks import checked_mesh
from gash_jax.geometry.mesh import Mesh, MeshError, normalized
from gash_jax.geometry.normalised import NormalisedMesh

ROW = 12  # bytes of three numbers
MOST_DIGITS = 9
CROWDED = 25_000  # faces that a vertex may have around it, three of their lengths or less away


def check_names(query: Mapping[str, str], known: Collection[str]) -> None:
    """Refuse a parameter that means nothing: a slip of the pen would go unnoticed."""
    for name in query:
        if name not in known:
            takes = f"known here: {', '.join(known)}" if known else "this address takes none"
            raise Refusal(400, f"unknown parameter {name[:40]!r}{near_names(name[:40], known)}; {takes}")


def mesh_counts(query: Mapping[str, str], limits: Limits) -> tuple[int, int]:
    """Vertices and faces that a request announces."""
    return _count(query, "vertices", limits.vertices), _count(query, "faces", limits.faces)


def _count(query: Mapping[str, str], name: str, most: int) -> int:
    text = query.get(name, "")
    if not (text.isascii() and text.isdigit() and len(text) <= MOST_DIGITS and int(text) > 0):
        raise Refusal(400, f"say how many {name} the body has: ?vertices=V&faces=F, whole numbers above 0")
    if int(text) > most:
        raise Refusal(
            413, f"{text} {name} are more than this service takes ({most}): send fewer, or start it with more"
        )
    return int(text)


def mesh_lengths(vertices: int, faces: int) -> tuple[int, int]:
    """Bytes of a mesh without and with normals."""
    return ROW * (vertices + faces), ROW * (2 * vertices + faces)


def check_length(text: str | None, lengths: Collection[int]) -> int:
    """The length of the body that a request announces, if it is one of those that fit."""
    if text is None:
        raise Refusal(411, "send Content-Length: the length of the body must be known before it comes")
    if not (text.isascii() and text.isdigit()) or int(text) not in lengths:
        fit = " or ".join(map(str, sorted(lengths)))
        raise Refusal(400, f"the body has {text[:20]} bytes: so many vertices and faces have {fit}")
    return int(text)


def read_positions(body: bytes | bytearray) -> np.ndarray:
    """Positions (v, 3), float32, a view of the body."""
    return np.frombuffer(body, "<f4").reshape(-1, 3)


def mesh_of_body(body: bytes | bytearray, vertices: int, faces: int) -> Mesh:
    """The mesh in a body of a length that fits, checked as every mesh is. Raises MeshError."""
    split = len(body) - ROW * faces
    floats, corners = read_positions(body[:split]), np.frombuffer(body, "<i4", offset=split).reshape(-1, 3)
    if len(floats) == vertices:
        return _not_crowded(read_mesh((floats, corners))[0])
    positions, normals = floats[:vertices].copy(), floats[vertices:]  # what is held must not hold the body
    bad = ~np.isfinite(normals).all(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        raise MeshError(f"{bad.sum()} of {vertices} normals are not finite (first: {first}): 0 stands for none")
    return _not_crowded(checked_mesh(Mesh(positions, normalized(normals), corners)))


def _not_crowded(mesh: Mesh) -> Mesh:
    """The mesh; raises MeshError where it is a soup (module docstring)."""
    if len(mesh.faces) > CROWDED:
        corners, shape = mesh.vertices.astype(np.float64)[mesh.faces], NormalisedMesh(mesh)
        longest = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
        if 9 * longest.sum() > CROWDED * (shape.radius or shape.half_diagonal) ** 2:
            raise MeshError("the faces are too long for their number: they make no surface; check the indices")
    return mesh
