import numpy as np
import pytest

from gash_jax.formats.stl import read_stl
from gash_jax.geometry.mesh import MeshError
from gash_jax.shapes.primitives import icosphere
from tests.geometry.mesh_files import CUBE, CUBE_FACES, exported, stl_ascii, stl_binary, tempting_mesh

VERTICES, FACES = tempting_mesh()
CORNERS = VERTICES[FACES]


@pytest.mark.parametrize("write", [stl_binary, stl_ascii])
def test_order_is_sacred(write) -> None:
    raw = read_stl(write(CORNERS))
    np.testing.assert_array_equal(raw.vertices, CORNERS.reshape(-1, 3))
    np.testing.assert_array_equal(raw.faces, np.arange(3 * len(FACES)).reshape(-1, 3))
    assert raw.normals is None


def test_binary_that_begins_like_ascii() -> None:
    data = b"solid but binary".ljust(80) + stl_binary(CORNERS)[80:]
    np.testing.assert_array_equal(read_stl(data).vertices, CORNERS.reshape(-1, 3))


def test_ascii_in_capitals_and_against_trimesh() -> None:
    np.testing.assert_array_equal(read_stl(stl_ascii(CORNERS).upper()).vertices, CORNERS.reshape(-1, 3))
    ball = icosphere(1)
    for kind in ("stl", "stl_ascii"):
        raw = read_stl(exported(ball, kind))
        np.testing.assert_allclose(raw.vertices, ball.vertices[ball.faces].reshape(-1, 3), atol=1e-7)


@pytest.mark.parametrize("write", [stl_binary, stl_ascii])
def test_every_truncation_is_noticed(write) -> None:
    data = write(CORNERS)
    needed = data.find(b"endsolid") + len("endsolid") if write is stl_ascii else len(data)
    for length in range(needed):
        with pytest.raises(MeshError):
            read_stl(data[:length])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"hello", "neither"),
        (b"solid a\nfacet\nouter loop\nvertex 0 0 0\nendloop\nendfacet\nendsolid", "three vertices"),
        (stl_ascii(CORNERS).replace(b"vertex 0.0 0.0 0.0", b"vertex 0.0 zero 0.0"), "not a number"),
        (stl_ascii(CORNERS).replace(b"vertex 0.0 0.0 0.0", b"vertex 0.0 0.0"), "fewer than 3"),
        (stl_ascii(CORNERS).replace(b"vertex 0.0 0.0 0.0", b"vertex  "), "no numbers"),
    ],
)
def test_bad_files(data: bytes, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_stl(data)


@pytest.mark.parametrize("spare", [1, 49, 50, 1000])
def test_bytes_after_the_last_facet_are_noted(spare: int) -> None:
    raw = read_stl(stl_binary(CUBE[CUBE_FACES]) + b"\x01" * spare)
    np.testing.assert_array_equal(raw.vertices, CUBE[CUBE_FACES].reshape(-1, 3))
    noun = "byte" if spare == 1 else "bytes"
    assert raw.notes == (f"{spare} {noun} after the last facet that the STL file announces: left out",)


@pytest.mark.parametrize("end", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_the_cube_in_text_with_marks_and_line_ends(mark: bytes, end: bytes) -> None:
    raw = read_stl(mark + stl_ascii(CUBE[CUBE_FACES]).replace(b"\n", end))
    np.testing.assert_array_equal(raw.vertices, CUBE[CUBE_FACES].reshape(-1, 3))
    assert raw.notes == ()


def test_wide_text_is_refused_by_its_name() -> None:
    with pytest.raises(MeshError, match="UTF-16 text"):
        read_stl(stl_ascii(CORNERS).decode().encode("utf-16"))
