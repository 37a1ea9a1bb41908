"""Wavefront OBJ files: vertex i is the i-th `v` line, whatever the faces do with it.

`vn` lines are read apart and brought to the vertices: the different normals that the corners at a vertex name are
averaged, each counted once. Vertex lines of six or more numbers, if all are, give sRGB colours after the position.
`vt` lines are brought to the corners of faces, (u, 1 - v): v counts from below in OBJ. Groups and materials are
ignored. A backslash at the end of a line joins it to the next, except in comments and in names, where it is the end of
a Windows folder.
"""

import re

import numpy as np
from jaxtyping import Bool, Float, Int

from gash_jax.formats.colors import linear_rgb
from gash_jax.formats.number_text import leading_columns, parse_rows, plain_text, whole_numbers
from gash_jax.formats.polygons import triangle_places
from gash_jax.geometry.mesh import MeshError, RawMesh, normalized
from gash_jax.geometry.topology import weld

_NAMES = rb"mtllib|usemtl|maplib|usemap|shadow_obj|trace_obj|call|csh|o|g"
_SLASH, _BLANK, _NEWLINE = 47, 32, 10


def read_obj(data: bytes) -> RawMesh:
    """Positions, faces (`v`, `v/vt`, `v//vn`, `v/vt/vn`, numbers left out, negative ones, polygons), normals, `vt`.

    Raises MeshError.
    """
    characters, begins = _lines(data)
    is_vertex, is_texture, is_normal, is_face = _kinds(characters, begins)
    numbers, rows = parse_rows(_only(characters, begins, is_vertex, 1))
    vertices = leading_columns(numbers, rows, 3)
    colors = linear_rgb(leading_columns(numbers, rows, 6)[:, 3:]) if np.diff(rows).min(initial=6) >= 6 else None
    if len(vertices) != np.count_nonzero(is_vertex):
        raise MeshError("a `v` line without numbers: the file is damaged")
    corners, texture, normal, line, sizes = _polygons(characters, begins, is_vertex, is_face)
    face_lines = np.flatnonzero(is_face)[line]
    places, notes = triangle_places(corners, sizes, vertices)
    faces, uv = corners[places], None
    if is_texture.any() and texture.any():
        which = np.where(texture, _resolve(texture, np.searchsorted(np.flatnonzero(is_texture), face_lines)), -1)
        uv = _texture_coordinates(_only(characters, begins, is_texture, 2), which)[places]
    named = normal != 0
    if not is_normal.any() or not named.any() or np.any((corners < 0) | (corners >= len(vertices))):
        return RawMesh(vertices, faces, None, notes, colors, uv)
    normals = leading_columns(*parse_rows(_only(characters, begins, is_normal, 2)), 3)
    which = _resolve(normal[named], np.searchsorted(np.flatnonzero(is_normal), face_lines[named]))
    if np.any((which < 0) | (which >= len(normals))):
        raise MeshError("a face names a `vn` line that does not exist: export the file again")
    averaged, note = _at_vertices(corners[named], which, normals, len(vertices))
    return RawMesh(vertices, faces, averaged, notes + note, colors, uv)


def _texture_coordinates(text: bytes, which: Int[np.ndarray, "c"]) -> Float[np.ndarray, "c 2"]:
    """(u, 1 - v) of the `vt` line that each corner names; not a number where there is none, v = 0 where it is left out.

    A mesh is not refused for texture coordinates that it may not need.
    """
    try:
        numbers, starts = parse_rows(text)
    except MeshError:
        numbers, starts = np.zeros(0), np.zeros(1, dtype=np.int64)
    if len(starts) - 1 != text.count(b"\n"):  # a word that is no number, or a line without one
        return np.full((len(which), 2), np.nan)
    u = leading_columns(numbers, starts, 1)[:, 0]
    several = np.diff(starts) > 1
    v = np.where(several, numbers[np.minimum(starts[:-1] + 1, len(numbers) - 1)], 0.0)
    known = np.append(np.stack([u, 1 - v], axis=1), [[np.nan, np.nan]], axis=0)
    return known[np.where((which >= 0) & (which < len(u)), which, len(u))]


def obj_polygons(data: bytes) -> tuple[Int[np.ndarray, "c"], Int[np.ndarray, "p"]]:
    """The `v` that the corners of all `f` lines name, one after the other, and how many each line has."""
    characters, begins = _lines(data)
    is_vertex, _, _, is_face = _kinds(characters, begins)
    corners, _, _, _, sizes = _polygons(characters, begins, is_vertex, is_face)
    return corners, sizes


def _kinds(characters: np.ndarray, begins: Int[np.ndarray, "l"]) -> tuple[Bool[np.ndarray, "l"], ...]:
    """Which lines are `v`, `vt`, `vn` and `f` lines."""
    first, second = characters[begins], characters[np.minimum(begins + 1, len(characters) - 1)]
    plain, texture, normal = (second <= _BLANK, second == ord("t"), second == ord("n"))
    is_v = first == ord("v")
    return is_v & plain, is_v & texture, is_v & normal, (first == ord("f")) & plain


def _polygons(
    characters: np.ndarray,
    begins: Int[np.ndarray, "l"],
    is_vertex: Bool[np.ndarray, "l"],
    is_face: Bool[np.ndarray, "l"],
) -> tuple[
    Int[np.ndarray, "c"], Int[np.ndarray, "c"], Int[np.ndarray, "c"], Int[np.ndarray, "c"], Int[np.ndarray, "p"]
]:
    """Of each corner its position from 0, the numbers of its `vt` and normal, its `f` line; corners of each line."""
    position, texture, normal, line = _corners(_only(characters, begins, is_face, 1))
    before = np.searchsorted(np.flatnonzero(is_vertex), np.flatnonzero(is_face)[line])
    sizes = np.bincount(line, minlength=np.count_nonzero(is_face))
    return _resolve(position, before), texture, normal, line, sizes


def _lines(data: bytes) -> tuple[np.ndarray, Int[np.ndarray, "l"]]:
    """Characters of the text in plain form (no comments, continuations, indents), and where its lines begin."""
    text = plain_text(data)
    if b"#" in text:
        text = re.sub(rb"#[^\n]*", b"", text)
    if b"\\" in text:
        text = re.sub(rb"^([ \t]*(?:%s)\b[^\n]*?)[\\ \t]+$" % _NAMES, rb"\1", text, flags=re.MULTILINE)
        text = re.sub(rb"\\[ \t]*\n", b" ", text)
    if re.search(rb"^[ \t]", text, flags=re.MULTILINE):
        text = re.sub(rb"^[ \t]+", b"", text, flags=re.MULTILINE)
    characters = np.frombuffer(text + b"\n", dtype=np.uint8)
    ends = np.flatnonzero(characters == _NEWLINE)
    return characters, np.append(0, ends[:-1] + 1)


def _only(characters: np.ndarray, begins: Int[np.ndarray, "l"], chosen: Bool[np.ndarray, "l"], keyword: int) -> bytes:
    """The text of the chosen lines, their keyword of the given length blanked."""
    keep = np.repeat(chosen, np.diff(np.append(begins, len(characters))))
    blanked = characters.copy()
    for place in range(keyword):
        blanked[begins[chosen] + place] = _BLANK
    return blanked[keep].tobytes()


def _corners(
    text: bytes,
) -> tuple[Int[np.ndarray, "c"], Int[np.ndarray, "c"], Int[np.ndarray, "c"], Int[np.ndarray, "c"]]:
    """Of each corner in the text of all faces: number of its position, `vt` and normal (0: none), and its line."""
    for left_out in (b"//", b"/ ", b"/\t", b"/\n"):  # a number that is left out is 0
        text = text.replace(left_out, b"/0" + left_out[1:])
    characters = np.frombuffer(text, dtype=np.uint8)
    solid = characters > _BLANK
    first = solid.copy()
    first[1:] &= ~solid[:-1]
    line = np.cumsum(characters == _NEWLINE)[first]
    slashes = np.bincount(np.cumsum(first)[characters == _SLASH] - 1, minlength=len(line))
    numbers, _ = parse_rows(np.where(characters == _SLASH, _BLANK, characters).astype(np.uint8).tobytes())
    if slashes.max(initial=0) > 2 or len(numbers) != len(line) + slashes.sum():
        raise MeshError("a face corner is not of the form v, v/vt, v//vn or v/vt/vn: the file is damaged or cut off")
    start = np.cumsum(slashes + 1) - (slashes + 1)
    texture, normal = np.zeros((2, len(line)), dtype=np.int64)
    numbers = whole_numbers(numbers, "a face names a corner")
    texture[slashes > 0] = numbers[start[slashes > 0] + 1]
    normal[slashes == 2] = numbers[start[slashes == 2] + 2]
    return numbers[start], texture, normal, line


def _resolve(numbers: Int[np.ndarray, "c"], before: Int[np.ndarray, "c"]) -> Int[np.ndarray, "c"]:
    """Indices from 0 of OBJ numbers: from 1, or negative and counted back from the `before` lines so far."""
    return np.where(numbers < 0, before + numbers, numbers - 1)


def _at_vertices(
    corners: Int[np.ndarray, "c"], which: Int[np.ndarray, "c"], normals: Float[np.ndarray, "n 3"], vertex_count: int
) -> tuple[Float[np.ndarray, "v 3"], tuple[str, ...]]:
    """Average of the different normals named at each vertex; 0 where none is."""
    unit = normalized(np.where(np.isfinite(normals), normals, 0.0))
    vertex, index = np.unique(np.stack([corners, weld(unit)[which]]), axis=1)
    of_value = np.zeros(len(unit), dtype=np.int64)
    of_value[weld(unit)] = np.arange(len(unit))
    total = np.stack([np.bincount(vertex, n, vertex_count) for n in unit[of_value[index]].T], axis=1)
    several = np.count_nonzero(np.bincount(vertex, minlength=vertex_count) > 1)
    noun = "vertex has" if several == 1 else "vertices have"
    note = f"{several} {noun} several normals in the file: averaged"
    return normalized(np.where(np.abs(total) > 1e-6, total, 0.0)), (note,) if several else ()
