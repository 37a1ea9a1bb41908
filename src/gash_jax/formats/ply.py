"""PLY files: polygons of any size, normals, colours and texture coordinates, points and Gaussian splats; and writing.

Colours `red green blue` of whole numbers are sRGB, floats are linear. Texture coordinates are those of the vertices
(`s t`, `u v` or `texture_u texture_v`) or those of the corners of faces (lists `texcoord`, as MeshLab writes them), v
counted from below. A splat (Kerbl et al. 2023, "3D Gaussian
Splatting") has `scale_0..2`, the logarithms of its axes, and `rot_0..3`, a quaternion (w, x, y, z) of any length.
"""

import os
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from gash_jax.files.atomic import whole_file
from gash_jax.formats.colors import linear_rgb
from gash_jax.formats.number_text import whole_numbers
from gash_jax.formats.ply_columns import Table, read_columns
from gash_jax.formats.polygons import triangle_places
from gash_jax.geometry.mesh import Mesh, MeshError, RawMesh

_NORMAL = ("nx", "ny", "nz")
_TEXTURE = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
_SPLAT = ("scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3")


def read_ply(data: bytes) -> RawMesh:
    """Positions, `nx ny nz` and `red green blue` if all there, and polygons of a PLY file. Raises MeshError."""
    table = read_columns(data)
    vertices, face = _stacked(table, "xyz"), table.columns.get("face", {})
    if vertices is None:
        raise MeshError("the PLY file has no vertices with x, y and z")
    lists = [face[name] for name in ("vertex_indices", "vertex_index") if name in face]
    if not lists and "tristrips" in table.columns:
        raise MeshError("the PLY file holds triangle strips: export it as triangles")
    corners, sizes = lists[0] if lists else (np.zeros(0, dtype=np.int64),) * 2
    corners = whole_numbers(corners, "a PLY face names a corner")
    places, notes = triangle_places(corners, sizes, vertices)
    uv = _texture_coordinates(table, corners, sizes)
    faces, uv = corners[places], None if uv is None else uv[places]
    return RawMesh(vertices, faces, _stacked(table, _NORMAL), table.notes + notes, _colors(table), uv)


def read_ply_points(data: bytes) -> tuple[Float[np.ndarray, "p 3"], Float[np.ndarray, "p 3"], bool]:
    """Positions, normals, and whether these are shortest axes of splats, which have no sign. Raises MeshError.

    A splat's own normals count if any is not 0. Faces do not count.
    """
    table = read_columns(data)
    points, normals, splats = _stacked(table, "xyz"), _stacked(table, _NORMAL), _stacked(table, _SPLAT)
    if points is None:
        raise MeshError("the PLY file has no vertices with x, y and z")
    if splats is not None and (normals is None or not normals.any()):
        return points, _shortest_axes(splats.astype(np.float64)), True
    if normals is None:
        raise MeshError("the points have no normals: write nx, ny and nz for each, or give Gaussian splats")
    return points, normals, False


def _stacked(table: Table, names: Any) -> np.ndarray | None:
    """Columns of the vertices side by side; None unless all are there."""
    vertex = table.columns.get("vertex", {})
    return np.stack([vertex[name][0] for name in names], axis=1) if set(names) <= vertex.keys() else None


def _colors(table: Table) -> Float[np.ndarray, "v 3"] | None:
    names = ("red", "green", "blue")
    found = _stacked(table, names)
    if found is None:
        return None
    kind = np.result_type(*(table.types["vertex"][name] for name in names))
    return found.astype(np.float64) if kind.kind == "f" else linear_rgb(found / np.iinfo(kind).max)


def _texture_coordinates(
    table: Table, corners: Int[np.ndarray, "c"], sizes: Int[np.ndarray, "p"]
) -> Float[np.ndarray, "c 2"] | None:
    """(u, 1 - v) of each corner of the polygons; None where the file has none, or too many or too few."""
    values, counts = table.columns.get("face", {}).get("texcoord", (np.zeros(0), np.zeros(0, dtype=np.int64)))
    if len(values) and np.array_equal(counts, 2 * sizes):
        found = values.reshape(-1, 2)
    else:
        columns = [_stacked(table, names) for names in _TEXTURE]
        known = next((column for column in columns if column is not None), None)
        if known is None or np.any((corners < 0) | (corners >= len(known))):
            return None
        found = known[corners]
    return found.astype(np.float64) * [1, -1] + [0, 1]


def _shortest_axes(splats: Float[np.ndarray, "p 7"]) -> Float[np.ndarray, "p 3"]:
    """Unit vectors of either sign: the axis of least scale, turned by the quaternion."""
    axis = np.eye(3)[np.argmin(splats[:, :3], axis=1)]
    w, q = splats[:, 3:4], splats[:, 4:]
    turned = (w**2 - np.sum(q * q, axis=1, keepdims=True)) * axis
    turned += 2 * np.sum(q * axis, axis=1, keepdims=True) * q + 2 * w * np.cross(q, axis)
    return turned / np.sum(splats[:, 3:] ** 2, axis=1, keepdims=True)


def write_ply(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Write `mesh` with its normals as a binary PLY file, apart and renamed: never half a file.

    Raises FileError where the path cannot be written.
    """
    header = [
        *("ply", "format binary_little_endian 1.0", f"element vertex {len(mesh.vertices)}"),
        *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")),
        *(f"element face {len(mesh.faces)}", "property list uchar int vertex_indices", "end_header", ""),
    ]
    rows = np.zeros(len(mesh.faces), dtype=[("size", "u1"), ("corners", "<i4", 3)])
    rows["size"], rows["corners"] = 3, mesh.faces
    vertices = np.concatenate([mesh.vertices, mesh.normals], axis=1).astype("<f4")
    with whole_file(os.fspath(path)) as temporary:
        temporary.write_bytes("\n".join(header).encode() + vertices.tobytes() + rows.tobytes())
