import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gash_jax.formats.raw_mesh import fan_triangulate, leading_columns, parse_rows
from gash_jax.geometry.mesh import MeshError


def test_fans_of_polygons() -> None:
    faces, notes = fan_triangulate(np.array([5, 6, 7, 1, 2, 3, 4, 8, 9, 0, 1, 2, 3, 4]), np.array([3, 4, 2, 5]))
    np.testing.assert_array_equal(faces, [[5, 6, 7], [1, 2, 3], [1, 3, 4], [0, 1, 2], [0, 2, 3], [0, 3, 4]])
    assert notes == ("1 polygon of fewer than three corners: left out",)
    nothing, none = fan_triangulate(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))
    assert nothing.shape == (0, 3) and none == ()


@settings(max_examples=50, deadline=None)
@given(st.lists(st.lists(st.floats(allow_nan=False), max_size=4), max_size=6), st.sampled_from([" ", "\t", "  "]))
def test_rows_against_python(rows: list[list[float]], blank: str) -> None:
    text = "\n".join(blank.join(map(repr, row)) for row in rows)
    numbers, starts = parse_rows(text.encode())
    filled = [row for row in rows if row]
    np.testing.assert_array_equal(numbers, [x for row in filled for x in row])
    np.testing.assert_array_equal(starts, np.cumsum([0] + [len(row) for row in filled]))


@pytest.mark.parametrize("text", [b"1 2 x", b"x", b"1 2\n3 4,5 6", b"1.2.3", b"12 ab3\n4", b"\xff\xfe"])
def test_words_that_are_no_numbers(text: bytes) -> None:
    with pytest.raises(MeshError, match="is not a number"):
        parse_rows(text)


def test_columns() -> None:
    numbers, starts = parse_rows(b" 1 2 3 9 9\n\n4 5 6\n7 8 9 1\n")
    np.testing.assert_array_equal(leading_columns(numbers, starts, 3), [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
    with pytest.raises(MeshError, match="vertex 1 has fewer than 4"):
        leading_columns(numbers, starts, 4)
    assert leading_columns(*parse_rows(b""), 3).shape == (0, 3)
