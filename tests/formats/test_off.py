import numpy as np
import pytest

from gash_jax.formats.off import read_off
from gash_jax.geometry.mesh import MeshError
from gash_jax.shapes.primitives import icosphere
from tests.geometry.mesh_files import exported, off, tempting_mesh


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
    ],
)
def test_bad_files(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_off(data)
