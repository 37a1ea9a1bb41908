from pathlib import Path

import numpy as np
import pytest
import trimesh

from gash_jax.files.atomic import FileError
from gash_jax.formats import ply_columns
from gash_jax.formats.ply import read_ply, write_ply
from gash_jax.geometry.mesh import Mesh, MeshError, RawMesh, vector_areas
from gash_jax.shapes.primitives import bumpy_sphere
from tests.geometry.mesh_files import CUBE, CUBE_FACES, CUBE_QUADS, exported, ply_ascii, ply_binary, tempting_mesh

POLYGONS = [[0, 1, 2], [2, 1, 3, 4], [0, 1, 2, 3, 4], [4, 3, 2], [1, 0]]
FANNED = [[0, 1, 2], [2, 1, 3], [2, 3, 4], [0, 1, 2], [0, 2, 3], [0, 3, 4], [4, 3, 2]]
POINTS = np.arange(15.0).reshape(5, 3) / 7
WRITERS = {
    "ascii": ply_ascii,
    "little": lambda vertices, faces, normals=None: ply_binary(vertices, faces, "<", normals),
    "big": lambda vertices, faces, normals=None: ply_binary(vertices, faces, ">", normals),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_polygons_normals_and_other_properties(kind: str) -> None:
    normals = -POINTS.astype(np.float32)
    raw = read_ply(WRITERS[kind](POINTS, POLYGONS, normals))
    np.testing.assert_array_equal(raw.vertices, POINTS)
    np.testing.assert_array_equal(raw.faces, FANNED)
    assert raw.normals is not None and raw.notes == ("1 polygon of fewer than three corners: left out",)
    np.testing.assert_array_equal(raw.normals, normals)
    assert read_ply(WRITERS[kind](POINTS, POLYGONS)).normals is None


@pytest.mark.parametrize("kind", WRITERS)
def test_order_is_sacred(kind: str) -> None:
    vertices, faces = tempting_mesh()
    raw = read_ply(WRITERS[kind](vertices, faces))
    np.testing.assert_array_equal(raw.vertices, vertices)
    np.testing.assert_array_equal(raw.faces, faces)


@pytest.mark.parametrize("block", [16, 100, 1 << 18])
def test_mixed_polygons_of_any_number(block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The chain of rows, followed in blocks of any size."""
    monkeypatch.setattr(ply_columns, "_BLOCK", block)
    rng = np.random.default_rng(block)
    faces = [rng.integers(0, 5, size=size).tolist() for size in rng.integers(3, 7, size=300)]
    expected = [[face[0], face[i], face[i + 1]] for face in faces for i in range(1, len(face) - 1)]
    np.testing.assert_array_equal(read_ply(ply_binary(POINTS, faces)).faces, expected)


def test_against_trimesh() -> None:
    mesh = bumpy_sphere(4)
    raw = read_ply(exported(mesh, "ply", vertex_normal=True))
    assert raw.normals is not None
    np.testing.assert_array_equal(raw.vertices, mesh.vertices)
    np.testing.assert_array_equal(raw.faces, mesh.faces)
    np.testing.assert_allclose(raw.normals, mesh.normals, atol=0.02)  # theirs are weighted otherwise


def test_line_ends_of_windows() -> None:
    text = ply_ascii(POINTS, POLYGONS).replace(b"\n", b"\r\n")
    np.testing.assert_array_equal(read_ply(text).faces, FANNED)
    head, body = ply_binary(POINTS, POLYGONS).split(b"end_header\n")
    np.testing.assert_array_equal(read_ply(head.replace(b"\n", b"\r\n") + b"end_header\r\n" + body).faces, FANNED)


def test_written_files_are_read_back_bit_by_bit(tmp_path: Path) -> None:
    vertices, faces = tempting_mesh()
    mesh = Mesh(vertices, np.roll(vertices, 1, axis=1), faces.astype(np.int32))
    write_ply(tmp_path / "a.ply", mesh)
    raw = read_ply((tmp_path / "a.ply").read_bytes())
    for found, written in zip(raw[:3], (mesh.vertices, mesh.faces, mesh.normals), strict=True):
        np.testing.assert_array_equal(found, written)
    theirs = trimesh.load(tmp_path / "a.ply", process=False, maintain_order=True)
    np.testing.assert_array_equal(theirs.vertices, vertices)  # type: ignore[attr-defined]
    assert [path.name for path in tmp_path.iterdir()] == ["a.ply"]
    with pytest.raises(FileError, match="does not exist"):
        write_ply(tmp_path / "none" / "a.ply", mesh)


@pytest.mark.parametrize("kind", WRITERS)
def test_every_truncation_is_noticed(kind: str) -> None:
    """Whatever byte the file ends at: only the last element, which is not needed, and line ends may go."""
    data = WRITERS[kind](POINTS, POLYGONS)
    spare = 1 if kind == "ascii" else 0
    for length in range(len(data) - spare):
        if kind == "ascii" and data[length : length + 1].isdigit() and data[length - 1 : length].isdigit():
            continue  # a number cut in two is a number
        with pytest.raises(MeshError):
            read_ply(data[:length])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"just some text\n", "does not begin with 'ply'"),
        (b"plywood\n", "does not begin with 'ply'"),
        (b"ply\nformat ascii 1.0\nelement vertex 3\n", "no end"),
        (b"ply\nelement vertex 1\nend_header\n", "no format"),
        (b"ply\nformat ascii 1.0\nelement vertex many\nend_header\n", "'element vertex many'"),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "'property float x'"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty number x\nend_header\n", "'property number x'"),
        (
            b"ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n3 0 1 2\n",
            "x, y",
        ),
        (ply_ascii(POINTS, [[0, 1]]).replace(b"\n2 0 1", b"\n-2 0 1"), "negative"),
        (ply_ascii(POINTS, [[0, 1, 2]]).replace(b"3 0 1 2", b"3 0 one 2"), "'one' is not a number"),
        (ply_ascii(POINTS, [[0, 1, 2]]).replace(b"3 0 1 2", b"9 0 1 2"), "line 16 of the PLY file has too few"),
        (ply_ascii(POINTS, [[0, 1, 2]]).replace(b"3 0 1 2", b"3 0 1 1.5"), "not a whole number"),
        (ply_ascii(POINTS, [[0, 1, 2]]).replace(b"3 0 1 2", b"2.5 0 1 2"), "not a whole number"),
        (ply_ascii(POINTS, [[0, 1, 2]]).decode().encode("utf-16"), "UTF-16 text: save it as UTF-8"),
        (b"ply\nformat binary_big_endian 1.0\nelement vertex 99999999999\nend_header\n", "x, y"),
        (ply_binary(POINTS, [[0, 1, 2]]).replace(b"vertex 5", b"vertex 4000000000"), "cut off"),
        (
            ply_ascii(POINTS, [[0, 1, 2]]).replace(b"element face", b"element tristrips"),
            "triangle strips",
        ),
    ],
)
def test_bad_files(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_ply(data)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("kind", WRITERS)
def test_the_cube_with_marks_and_line_ends(kind: str, mark: bytes, end: bytes) -> None:
    head, body = WRITERS[kind](CUBE, CUBE_QUADS).split(b"end_header\n")
    text = (head + b"end_header\n").replace(b"\n", end)
    raw = read_ply(mark + text + (body.replace(b"\n", end) if kind == "ascii" else body))
    np.testing.assert_array_equal(raw.vertices, CUBE)
    np.testing.assert_array_equal(raw.faces, CUBE_FACES)
    assert raw.notes == ()


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_body_that_begins_like_a_line_end(order: str) -> None:
    """The first byte after a header of CR line ends is a colour that reads as LF."""
    data = ply_binary(CUBE, CUBE_QUADS, order)
    head, body = data.split(b"end_header\n")
    data = (head + b"end_header\n").replace(b"\n", b"\r") + b"\n" + body[1:]
    np.testing.assert_array_equal(read_ply(data).vertices, CUBE)


@pytest.mark.parametrize("kind", WRITERS)
def test_header_lines_of_no_keyword_are_skipped_and_noted(kind: str) -> None:
    """A comment broken over two lines, as an old exporter did."""
    data = WRITERS[kind](CUBE, CUBE_QUADS)
    broken = b"comment exported by a program\nwith a name of two lines\nelement vertex"
    raw = read_ply(data.replace(b"element vertex", broken))
    np.testing.assert_array_equal(raw.faces, CUBE_FACES)
    assert raw.notes == ("the PLY header line 'with a name of two lines' has no known keyword: skipped",)


@pytest.mark.parametrize("kind", WRITERS)
def test_a_property_line_that_became_unreadable_is_no_comment(kind: str) -> None:
    """Skipping it would shift everything after it."""
    data = WRITERS[kind](CUBE, CUBE_QUADS)
    extra = b"property int extra\nend_header" if kind == "ascii" else b"propeXty short flag"
    spoilt = data.replace(b"end_header" if kind == "ascii" else b"property short flag", extra)
    with pytest.raises(MeshError, match="too few or too many|cannot read the PLY header line|cut off|negative"):
        read_ply(spoilt)


ROWS = {
    "a number missing": (b"\n0.0 0.0 1.0\n", b"\n0.0 0.0\n", "line 12 .* 'vertex'"),
    "a number too many": (b"\n0.0 0.0 1.0\n", b"\n0.0 0.0 1.0 7\n", "line 12 .* 'vertex'"),
    "a row broken": (b"\n0.0 0.0 1.0\n", b"\n0.0\n0.0 1.0\n", "line 12 .* 'vertex'"),
    "two rows joined": (b"\n0.0 0.0 1.0\n", b" 0.0 0.0 1.0\n", "line 11 .* 'vertex'"),
    "a corner missing": (b"\n4 4 6 7 5\n", b"\n4 4 6 7\n", "line 20 .* 'face'"),
    "a corner too many": (b"\n4 4 6 7 5\n", b"\n4 4 6 7 5 5\n", "line 20 .* 'face'"),
    "lists broken": (b"\n4 ", b"\n4\n", "line 19 .* 'face'"),
    "after an empty line": (b"\n4 4 6 7 5\n", b"\n\n4 4 6 7\n", "line 21 .* 'face'"),
}


@pytest.mark.parametrize("name", ROWS)
def test_rows_are_bounded_by_their_lines(name: str) -> None:
    """Of the cube with its header of ten lines; nothing is taken from the next line, and the line is named."""
    old, new, message = ROWS[name]
    data = ply_ascii(CUBE, CUBE_QUADS)
    assert old in data
    with pytest.raises(MeshError, match=message):
        read_ply(data.replace(old, new))


@pytest.mark.parametrize("kind", WRITERS)
def test_polygons_are_cut_inside_their_outline(kind: str) -> None:
    """A cross of five unit squares, from any corner: F 10, area 5."""
    cross = [[1, 0], [2, 0], [2, 1], [3, 1], [3, 2], [2, 2], [2, 3], [1, 3], [1, 2], [0, 2], [0, 1], [1, 1]]
    points = np.concatenate([np.array(cross), np.zeros((12, 1))], axis=1)
    for start in range(12):
        raw = read_ply(WRITERS[kind](points, [np.roll(np.arange(12), start).tolist()]))
        areas = vector_areas(raw.vertices, raw.faces)[:, 2]
        assert len(raw.faces) == 10 and (areas > 0).all() and areas.sum() == pytest.approx(5)
        assert "cut inside the outline" in raw.notes[0]


def test_colours_of_vertices() -> None:
    """Whole numbers are sRGB, floats linear; without all three there are none."""
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    body = "element face 1\nproperty list uchar int vertex_indices\nend_header\n{}\n3 0 1 2\n"

    def read(kind: str, rows: list[str], names: str = "red green blue") -> RawMesh:
        properties = "".join(f"property {kind} {name}\n" for name in names.split())
        return read_ply((head + properties + body.format("\n".join(rows))).encode())

    bytes_ = read("uchar", ["0 0 0 255 0 188", "1 0 0 0 0 0", "0 1 0 10 0 0"]).colors
    assert bytes_ is not None
    np.testing.assert_allclose(bytes_, [[1, 0, 0.502886], [0, 0, 0], [0.003035, 0, 0]], atol=1e-6)
    wide = read("ushort", ["0 0 0 65535 0 48316", "1 0 0 0 0 0", "0 1 0 0 0 0"]).colors
    np.testing.assert_allclose(wide[0], [1, 0, 0.502886], atol=1e-4)  # type: ignore[index]
    floats = read("float", ["0 0 0 1 0 0.5", "1 0 0 0 0 0", "0 1 0 0 0 0"]).colors
    np.testing.assert_allclose(floats[0], [1, 0, 0.5])  # type: ignore[index]
    assert read("uchar", ["0 0 0 1 0", "1 0 0 0 0", "0 1 0 0 0"], "red green").colors is None
