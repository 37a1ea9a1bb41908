import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gash_jax.formats.obj import read_obj
from gash_jax.geometry.mesh import MeshError, vector_areas
from tests.geometry.mesh_files import CUBE, CUBE_FACES, CUBE_QUADS, obj, tempting_mesh

THREE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def _faces(text: str) -> list[list[int]]:
    return read_obj(text.encode()).faces.tolist()


def _normals(text: str) -> np.ndarray:
    normals = read_obj(text.encode()).normals
    assert normals is not None
    return normals


def test_order_is_sacred() -> None:
    vertices, faces = tempting_mesh()
    raw = read_obj(obj(vertices, faces))
    np.testing.assert_array_equal(raw.vertices, vertices)
    np.testing.assert_array_equal(raw.faces, faces)
    assert raw.normals is None and raw.notes == ()


@pytest.mark.parametrize("corner", ["{0}", "{0}/{1}", "{0}//{1}", "{0}/{1}/{1}", "{2}", "{2}//{2}", "{2}/{2}/{2}"])
def test_forms_of_corners(corner: str) -> None:
    text = THREE + "vt 0 0\nvt 1 0\nvt 0 1\nvn 1 0 0\nvn 0 1 0\nvn 0 0 1\n"
    text += "f " + " ".join(corner.format(i, i, i - 4) for i in (1, 3, 2)) + "\n"
    assert _faces(text) == [[0, 2, 1]]
    normals = read_obj(text.encode()).normals
    if corner.count("/") == 2:
        np.testing.assert_array_equal(normals, np.eye(3))
    else:
        assert normals is None


def test_mixed_forms_polygons_and_odd_writing() -> None:
    text = (
        "# comment with v 9 9 9\r\n  v 0 0 0 # first\r\nv\t1 0 0 1.0\r\nv 1 1 0 0.5 0.5 0.5\r\nvt 0 0\r\n"
        "vp 1 2\r\nvn 0 0 2\r\nv 0 1 0\r\nf 1/1 2//1 \\\r\n 3/1/1 4\r\nf -4 -3 -2\r\ng f\r\nv 5 5 5\r\nf -1 1 2"
    )
    raw = read_obj(text.encode())
    np.testing.assert_array_equal(raw.vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [5, 5, 5]])
    assert raw.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2], [4, 0, 1]]
    np.testing.assert_array_equal(raw.normals, [[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 0, 0], [0, 0, 0]])


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.lists(st.tuples(st.integers(1, 9), st.integers(0, 3), st.booleans()), min_size=3, max_size=6), min_size=1
    )
)
def test_against_a_reader_line_by_line(polygons) -> None:
    forms = ("{v}", "{v}/1", "{v}//2", "{v}/1/2")
    lines = [f"v {i} {i} {i}" for i in range(9)]  # on a line: every polygon is cut as a fan
    lines += ["vt 0 0", "vn 1 0 0", "vn 0 1 0"]
    expected = []
    for polygon in polygons:
        lines.append("f " + " ".join(forms[form].format(v=v - 10 if back else v) for v, form, back in polygon))
        corners = [v - 1 for v, _, _ in polygon]
        expected += [[corners[0], corners[i], corners[i + 1]] for i in range(1, len(corners) - 1)]
    assert _faces("\n".join(lines)) == expected


def test_several_normals_at_a_vertex_are_averaged_each_once() -> None:
    """A fold along x: two faces up, one to the side. The up normal counts once, however many lines say it."""
    text = "v 0 0 0\nv 1 0 0\nv 0 0 -1\nv 1 0 -1\nv 0 -1 0\nvn 0 1 0\nvn 0 2 0\nvn 0 0 1\n"
    text += "f 1//1 2//1 3//1\nf 2//2 4//2 3//2\nf 1//3 5//3 2//3\n"
    half = np.sqrt(0.5)
    expected = [[0, half, half], [0, half, half], [0, 1, 0], [0, 1, 0], [0, 0, 1]]
    np.testing.assert_allclose(_normals(text), expected, atol=1e-12)
    assert read_obj(text.encode()).notes == ("2 vertices have several normals in the file: averaged",)


def test_opposite_normals_leave_none() -> None:
    text = THREE + "vn 0 0 1\nvn 0 0 -1\nf 1//1 2//1 3//1\nf 1//2 3//2 2//1\n"
    np.testing.assert_array_equal(_normals(text), [[0, 0, 0], [0, 0, 1], [0, 0, 0]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (THREE + "f 1 2 x\n", "not a number"),
        (THREE + "f 1/2/3/4 2 3\n", "not of the form"),
        (THREE + "f /1 /2 /3\n", "not of the form"),
        (THREE + "v 1 2\n", "vertex 3 has fewer"),
        (THREE + "v\nf 1 2 3\n", "line without numbers"),
        (THREE + "v 1,5 2 3\n", "not a number"),
        (THREE + "f 1.5 2 3\n", "not a whole number"),
        (THREE + "f 1 2 1e30\n", "not a whole number"),
        (("v 1 2 3\n" + THREE).encode("utf-16").decode("latin-1"), "UTF-16 text: save it as UTF-8"),
        (THREE + "vn 0 0 1\nf 1//1 2//1 3//2\n", "`vn` line that does not exist"),
        (THREE + "vn 0 0\nf 1//1 2//1 3//1\n", "fewer than 3"),
    ],
)
def test_bad_files(text: str, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        read_obj(text.encode("latin-1"))


@pytest.mark.parametrize("text", ["", "\n", "# nothing\n", "hello\nworld\n", "vn 1 0 0\n"])
def test_no_mesh_at_all(text: str) -> None:
    raw = read_obj(text.encode())
    assert len(raw.vertices) == len(raw.faces) == 0


@pytest.mark.parametrize("index", [0, 4, -4])
def test_indices_out_of_range_come_out_of_range(index: int) -> None:
    faces = np.array(_faces(THREE + f"f 1 2 {index}\n"))
    assert np.any((faces < 0) | (faces > 2))


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("form", ["{0}/", "{0}//", "{0}/1/", "{0}/\t"])
def test_the_cube_with_numbers_left_out(form: str, mark: bytes, end: str) -> None:
    """The byte order mark stands right before the first `v`."""
    lines = ["v {} {} {}".format(*point) for point in CUBE] + ["vt 0 0"]
    lines += ["f " + " ".join(form.format(corner + 1) for corner in quad) for quad in CUBE_QUADS]
    raw = read_obj(mark + end.join(lines).encode())
    np.testing.assert_array_equal(raw.vertices, CUBE)
    np.testing.assert_array_equal(raw.faces, CUBE_FACES)
    assert raw.normals is None and raw.notes == ()


@pytest.mark.parametrize(
    "line", ["# made in C:\\work\\", "mtllib D:\\materials\\", "usemtl a\\  ", "  o x\\", "g b \\"]
)
def test_backslashes_that_end_a_comment_or_a_name(line: str) -> None:
    """The next line stays a line, at the beginning and in the middle; a face is still continued."""
    text = f"{line}\n{THREE}{line}\nv 5 5 5\nf 1 2 \\\n 3\n{line}\n"
    raw = read_obj(text.encode())
    np.testing.assert_array_equal(raw.vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]])
    assert raw.faces.tolist() == [[0, 1, 2]]


def test_polygons_are_cut_inside_their_outline() -> None:
    """An L, 5 by 5 less 4 by 4, whose fan from its first corner would cover part of the notch."""
    text = "v 0 0 0\nv 5 0 0\nv 5 1 0\nv 1 1 0\nv 1 5 0\nv 0 5 0\nf 2 3 4 5 6 1\nf 3 4 5\n"
    raw = read_obj(text.encode())
    areas = vector_areas(raw.vertices, raw.faces[:4])[:, 2]
    assert areas.sum() == areas[areas > 0].sum() == 9 and raw.faces[4].tolist() == [2, 3, 4]
    assert raw.notes == ("1 polygon with concave or straight corners: cut inside the outline, not as a fan",)


def test_colours_after_the_position_are_srgb() -> None:
    text = "v 0 0 0 1 0 0.5\nv 1 0 0 0 0 0\nv 0 1 0 0.02 0 0\nf 1 2 3\n"
    colors = read_obj(text.encode()).colors
    assert colors is not None
    np.testing.assert_allclose(colors, [[1, 0, 0.214041], [0, 0, 0], [0.001548, 0, 0]], atol=1e-6)
    assert read_obj(text.replace("v 1 0 0 0 0 0", "v 1 0 0").encode()).colors is None
    np.testing.assert_array_equal(read_obj(text.encode()).vertices, [[0, 0, 0], [1, 0, 0], [0, 1, 0]])
