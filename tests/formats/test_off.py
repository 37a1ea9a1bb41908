import numpy as np
import pytest

from gash_jax.formats.off import read_off
from gash_jax.geometry.mesh import MeshError, vector_areas
from gash_jax.shapes.primitives import icosphere
from tests.geometry.mesh_files import CUBE, CUBE_FACES, CUBE_QUADS, exported, off, tempting_mesh


def test_order_is_sacred() -> None:
    vertices, faces = tempting_mesh()
    raw = read_off(off(vertices, faces))
    np.testing.assert_array_equal(raw.vertices, vertices)
    np.testing.assert_array_equal(raw.faces, faces)
    assert raw.normals is None


def test_polygons_comments_colours() -> None:
    text = b"# a\nOFF # b\n\n4 2 0\n0 0 0\n1 0 0 # c\n1 1 0\r\n0 1 0\n4 0 1 2 3 255 0 0\n3 0 1 2 0.5\n"
    raw = read_off(text)
    assert raw.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]
    np.testing.assert_array_equal(raw.vertices[2], [1, 1, 0])
    np.testing.assert_array_equal(read_off(text.replace(b"OFF # b\n\n4", b"OFF 4")).faces, raw.faces)


def test_normals_and_other_columns() -> None:
    rows = b"3 1 0\n0 0 0 0 0 1\n1 0 0 0 1 0\n0 1 0 1 0 0\n3 0 1 2\n"
    normals = read_off(b"NOFF\n" + rows).normals
    np.testing.assert_array_equal(normals, [[0, 0, 1], [0, 1, 0], [1, 0, 0]])
    coloured = read_off(b"COFF\n" + rows)
    assert coloured.normals is None
    np.testing.assert_array_equal(coloured.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])


def test_against_trimesh() -> None:
    ball = icosphere(1)
    raw = read_off(exported(ball, "off"))
    np.testing.assert_allclose(raw.vertices, ball.vertices, atol=1e-7)
    np.testing.assert_array_equal(raw.faces, ball.faces)


def test_every_truncation_is_noticed() -> None:
    data = off(*tempting_mesh())
    for length in range(len(data) - 1):
        if data[length : length + 1].isdigit() and data[length - 1 : length].isdigit():
            continue  # a number cut in two is a number
        with pytest.raises(MeshError):
            read_off(data[:length])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"hello", "does not begin with OFF"),
        (b"OFF BINARY\n1 2 3", "binary"),
        (b"OFF\n", "no counts"),
        (b"OFF\n3\n", "no counts"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n", "announces 3 vertices and 1 faces but has 3 lines"),
        (b"OFF\n-3 1 0\n0 0 0\n", "cut off"),
        (b"OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "vertex 1 has fewer"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1\n", "fewer corners"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n-3 0 1\n", "fewer corners"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 one 0\n3 0 1 2\n", "'one' is not a number"),
        (b"OFF\n3.5 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n", "not a whole number"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n2.5 0 1 2\n", "not a whole number"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", "not a whole number"),
        ("OFF\n3 1 0\n".encode("utf-16"), "UTF-16"),
        (b"OFFICE\n3 1 0\n", "does not begin with OFF"),
        (b"4OFF\n3 1 0\n", "does not begin with OFF"),
    ],
)
def test_bad_files(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_off(data)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize(
    ("head", "notes"),
    [
        (b"OFF\n", ()),
        (b"OFF", ()),  # glued to the counts
        (b"OFF ", ()),
        (b"\xef\xbb\xbfOFF", ()),
        (b" \n\tOFF\n", ("white space before the word OFF: skipped",)),
        (b"\nOFF", ("white space before the word OFF: skipped",)),
    ],
)
def test_the_cube_with_odd_heads(head: bytes, notes: tuple[str, ...], end: bytes) -> None:
    data = head + off(CUBE, CUBE_QUADS).removeprefix(b"OFF\n")
    raw = read_off(data.replace(b"\n", end))
    np.testing.assert_array_equal(raw.vertices, CUBE)
    np.testing.assert_array_equal(raw.faces, CUBE_FACES)
    assert raw.notes == notes


def test_normals_after_a_glued_head() -> None:
    rows = b"0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n3 0 1 2\n"
    np.testing.assert_array_equal(read_off(b"NOFF3 1 0\n" + rows).normals, [[0, 0, 1]] * 3)


def test_polygons_are_cut_inside_their_outline() -> None:
    """An arrow head that begins beside its notch, and a side with a corner amid its first edge: 2 and 1."""
    rows = b"0 0 0\n1 1 0\n2 0 0\n1 3 0\n3 0 0\n4 0 0\n4 1 0\n3 1 0\n3.5 0 0\n4 0 1 2 3\n5 4 8 5 6 7\n"
    raw = read_off(b"OFF\n9 2 0\n" + rows)
    areas = vector_areas(raw.vertices, raw.faces)[:, 2]
    np.testing.assert_allclose(areas[:2], [1, 1])
    assert areas[2:].min() > 0.2 and areas[2:].sum() == pytest.approx(1)
    assert raw.notes == ("2 polygons with concave or straight corners: cut inside the outline, not as a fan",)
