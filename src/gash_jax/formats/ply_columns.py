"""The columns of a PLY file: ASCII and binary of either byte order, any elements, any property types.

Reading walks the properties of all rows of an element at once with a cursor per row, in bytes (binary) or words
(ASCII). Where a binary row starts depends on the lists of all rows before it; if these are not of one length, the
chain of rows is followed by pointer doubling: from "the row after the one that would start at byte i", for all i.

An ASCII row is a line and has as many numbers as the header announces: a file that breaks its rows over lines is
refused, as a number missing from one row would be taken from the next. Header lines of no known keyword are noted and
skipped (programs have broken comments over two lines); the body must then end where the file does.
"""

import codecs
import re
from collections.abc import Callable
from typing import NamedTuple, NoReturn

import numpy as np
from jaxtyping import Int

from gash_jax.formats.number_text import parse_rows, plain_text, refuse_wide_text, whole_numbers
from gash_jax.geometry.mesh import MeshError

_TYPES = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2"},
    **{"ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4"},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
_FORMATS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_CUT_OFF = "the file ends before its data do: it is cut off, copy or export it again"
_BLOCK = 1 << 18  # bytes over which the chain of rows is followed at once
Columns = dict[str, dict[str, tuple[np.ndarray, np.ndarray]]]  # by element and property: values, and how many a row


class _Property(NamedTuple):
    name: str
    type: np.dtype
    count_type: np.dtype | None  # None: a scalar


class _Element(NamedTuple):
    name: str
    rows: int
    properties: list[_Property]


class _Body(NamedTuple):
    """Access to the data after the header, in units of bytes or words."""

    take: Callable[[np.ndarray, np.dtype], np.ndarray]  # values at the given units
    size: Callable[[np.dtype], int]  # units of one value
    end: int


class _Header(NamedTuple):
    order: str  # of bytes; "=" for ASCII
    elements: list[_Element]
    start: int  # of the body, in bytes
    lines: int
    unknown: list[str]  # lines of no known keyword


class Table(NamedTuple):
    """What a PLY file holds: columns and their types by element and property, and a note on skipped header lines."""

    columns: Columns
    types: dict[str, dict[str, np.dtype]]
    notes: tuple[str, ...]


def read_columns(data: bytes) -> Table:
    """The columns of a PLY file. Raises MeshError."""
    refuse_wide_text(data)
    data = data.removeprefix(codecs.BOM_UTF8)
    header = _header(data)
    columns = _ascii_columns(data, header) if header.order == "=" else _binary_columns(data, header)
    skipped = tuple(f"the PLY header line {line[:60]!r} has no known keyword: skipped" for line in header.unknown[:1])
    types = {element.name: {item.name: item.type for item in element.properties} for element in header.elements}
    return Table(columns, types, skipped)


def _ascii_columns(data: bytes, header: _Header) -> Columns:
    """Columns of a text in which each row is a line."""
    text = plain_text(data[header.start :])
    numbers, lines = parse_rows(text)
    body = _Body(lambda at, kind: numbers[at], lambda kind: 1, len(numbers))
    columns, row = {}, 0
    for element in header.elements:
        starts, ends = lines[row : row + element.rows], lines[row + 1 : row + element.rows + 1]
        if len(ends) < element.rows:
            raise MeshError(_CUT_OFF)

        def within_lines(cursor: np.ndarray, ends: np.ndarray = ends, row: int = row, name: str = element.name) -> None:
            if np.any(cursor > ends):
                _refuse_row(text, header, row + int(np.argmax(cursor > ends)), name)

        columns[element.name], cursor = _walk(element, starts, body, within_lines)
        if np.any(cursor < ends):
            _refuse_row(text, header, row + int(np.argmax(cursor < ends)), element.name)
        row += element.rows
    return columns


def _refuse_row(text: bytes, header: _Header, row: int, element: str) -> NoReturn:
    """Name the line of a row that has too few or too many values."""
    filled = [number for number, line in enumerate(text.split(b"\n"), header.lines + 1) if line.strip()]
    raise MeshError(
        f"line {filled[row]} of the PLY file has too few or too many values for a row of {element!r}: "
        "the file is damaged, or its rows are broken over lines; export it again"
    )


def _binary_columns(data: bytes, header: _Header) -> Columns:
    """Columns of a binary file."""
    raw, offset, columns = np.frombuffer(data, dtype=np.uint8), header.start, {}
    body = _Body(lambda at, kind: _unaligned(raw, kind)[at], lambda kind: kind.itemsize, len(data))
    for element in header.elements:
        starts = _row_starts(element, offset, body)
        columns[element.name], cursor = _walk(element, starts, body, lambda cursor: _check_room(cursor, body))
        offset = int(cursor[-1]) if len(cursor) else offset
    if header.unknown and offset != len(data):
        raise MeshError(f"cannot read the PLY header line {header.unknown[0][:60]!r}: the file is damaged")
    return columns


def _header(data: bytes) -> _Header:
    magic = re.match(rb"ply[ \t]*(\r\n|\n|\r)", data)
    if magic is None:
        raise MeshError("not a PLY file: it does not begin with 'ply'")
    # after line ends of one character, a byte of the body may look like the second of two
    line_end = rb"\r" if magic[1] == b"\r" else rb"\r?\n"
    end = re.search(magic[1][-1:] + rb"[ \t]*end_header[ \t]*" + line_end, data)
    if end is None:
        raise MeshError("the PLY header has no end: the file is cut off or damaged")
    lines = re.split(r"\r\n|\n|\r", data[: end.start()].decode("ascii", errors="replace"))
    order, elements, unknown = "", list[_Element](), list[str]()
    for line in lines[1:]:
        match line.split():
            case ["format", name, *_] if name in _FORMATS:
                order = _FORMATS[name]
            case ["element", name, rows] if rows.isdigit():
                elements.append(_Element(name, int(rows), []))
            case ["property", "list", n, item, name] if elements and n in _TYPES and item in _TYPES:
                kinds = np.dtype(order + _TYPES[item]), np.dtype(order + _TYPES[n])
                elements[-1].properties.append(_Property(name, *kinds))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1].properties.append(_Property(name, np.dtype(order + _TYPES[kind]), None))
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format" | "element" | "property", *_]:
                raise MeshError(f"cannot read the PLY header line {line[:60]!r}: the file is damaged")
            case _:
                unknown.append(line)
    if not order:
        raise MeshError("the PLY header names no format: the file is damaged")
    return _Header(order, elements, end.end(), len(lines) + 1, unknown)


def _unaligned(raw: np.ndarray, kind: np.dtype) -> np.ndarray:
    """The value of type `kind` that starts at each byte."""
    if len(raw) < kind.itemsize:
        raise MeshError(_CUT_OFF)
    return np.ndarray((len(raw) - kind.itemsize + 1,), kind, raw.data, strides=(1,))


def _walk(
    element: _Element, starts: Int[np.ndarray, "r"], body: _Body, check_room: Callable[[np.ndarray], None]
) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], Int[np.ndarray, "r"]]:
    """For each property the values of all rows in order and how many each row has; and where the rows end.

    `check_room` refuses ends of values, one a row, that are too far.
    """
    columns, cursor = {}, starts
    for item in element.properties:
        sizes = np.ones(len(starts), dtype=np.int64)
        if item.count_type is not None:
            check_room(cursor + body.size(item.count_type))
            sizes = whole_numbers(body.take(cursor, item.count_type), "the length of a PLY list")
            cursor = cursor + body.size(item.count_type)
        width = body.size(item.type)
        check_room(cursor + sizes * width)
        if np.any(sizes < 0):
            raise MeshError("a PLY list has a negative length: the file is damaged")
        at = np.repeat(cursor - (np.cumsum(sizes) - sizes) * width, sizes) + np.arange(sizes.sum()) * width
        columns[item.name] = body.take(at, item.type), sizes
        cursor = cursor + sizes * width
    return columns, cursor


def _check_room(ends: np.ndarray, body: _Body) -> None:
    if len(ends) and ends.max() > body.end:
        raise MeshError(_CUT_OFF)


def _row_starts(element: _Element, offset: int, body: _Body) -> Int[np.ndarray, "r"]:
    """First byte of each row of an element of a binary file."""
    if element.rows == 0 or not element.properties:
        return np.zeros(0, dtype=np.int64)
    shortest = sum(body.size(p.type if p.count_type is None else p.count_type) for p in element.properties)
    if offset + element.rows * shortest > body.end:
        raise MeshError(_CUT_OFF)
    stride = int(_next_row(element, np.array([offset]), body)[0]) - offset
    starts = offset + stride * np.arange(element.rows, dtype=np.int64)
    if starts[-1] + stride <= body.end and np.all(_next_row(element, starts, body) == starts + stride):
        return starts
    return _follow_chain(element, offset, body)


def _next_row(element: _Element, starts: np.ndarray, body: _Body) -> np.ndarray:
    """Where the row after one that starts at `starts` would start, for any bytes; `body.end` + 1 if outside."""
    cursor = starts
    for item in element.properties:
        sizes = 1
        if item.count_type is not None:
            inside = np.minimum(cursor, body.end - body.size(item.count_type))
            sizes = np.maximum(body.take(inside, item.count_type).astype(np.int64), 0)
            cursor = cursor + body.size(item.count_type)
        cursor = np.minimum(cursor + sizes * body.size(item.type), body.end + 1)
    return cursor


def _follow_chain(element: _Element, offset: int, body: _Body) -> Int[np.ndarray, "r"]:
    """Row starts by pointer doubling, block after block."""
    parts, missing = [], element.rows
    while missing > 0:
        if offset >= body.end:
            raise MeshError(_CUT_OFF)
        window = np.arange(offset, min(offset + _BLOCK, body.end))
        following = _next_row(element, window, body)
        beyond = len(window)  # stands for every row that starts outside this block
        jump = np.append(np.minimum(following - offset, beyond), beyond)
        rows = np.zeros(1, dtype=np.int64)
        while len(rows) < missing and rows[-1] < beyond:
            rows = np.concatenate([rows, jump[rows]])
            jump = jump[jump]
        rows = rows[rows < beyond][:missing]
        parts.append(rows + offset)
        missing -= len(rows)
        offset = int(following[rows[-1]])
    return np.concatenate(parts)
