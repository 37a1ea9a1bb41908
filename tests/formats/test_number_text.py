import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gash_jax.formats.number_text import leading_columns, parse_rows, plain_text, whole_numbers
from gash_jax.geometry.mesh import MeshError


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


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
def test_plain_text(end: str, mark: bytes) -> None:
    assert plain_text(mark + end.join(["v 1 2 3", "", "f 1 2 3", ""]).encode()) == b"v 1 2 3\n\nf 1 2 3\n"


@pytest.mark.parametrize("coding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-be"])
def test_wide_text_is_refused_by_its_name(coding: str) -> None:
    with pytest.raises(MeshError, match="UTF-16 text: save it as UTF-8"):
        plain_text("v 1 2 3\nv 4 5 6\n".encode(coding))
    assert plain_text(b"v 1\0 2 3\n")  # a zero here and there is damage, for others to say


def test_whole_numbers() -> None:
    np.testing.assert_array_equal(whole_numbers(np.array([3.0, -1.0, 2.0**52]), "a corner"), [3, -1, 2**52])
    for bad in (0.5, np.nan, np.inf, 2.0**53, -1e300):
        with pytest.raises(MeshError, match="a corner that is not a whole number"):
            whole_numbers(np.array([1.0, bad]), "a corner")
