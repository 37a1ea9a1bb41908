"""npz files that are whole or absent, with a JSON `metadata` string beside the arrays; no pickle anywhere."""

import hashlib
import json
import struct
import zipfile
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from gash_jax.files.atomic import FileError, as_path, whole_file

# what numpy and zipfile raise on damaged archives: RuntimeError for flags that say encrypted or a later version
_DAMAGED = (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, LookupError, RuntimeError, MemoryError)
_DAMAGED += (TypeError, AttributeError, SyntaxError)
_UNREADABLE = "is not a readable npz file: truncated or another format; write it again"
_LARGE = 1 << 20  # bytes from which on an array is worth a view


def write_npz(path: str | Path, arrays: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Write to a temporary name beside `path`, then rename: readers see the old file or the new one.

    Raises FileError where that cannot be, or where the metadata is not JSON.
    """
    try:
        entries = np.array(json.dumps(metadata))
    except (TypeError, ValueError) as error:
        raise FileError(f"cannot write {path}: its metadata is no JSON ({error}): give numbers and text") from None
    with whole_file(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays, metadata=entries)


class Rows(NamedTuple):
    """An array that need not fit into memory: its rows come one after the other, and are written as `dtype`."""

    rows: Iterable[np.ndarray]
    shape: tuple[int, ...]
    dtype: str = "<f2"


def write_npz_rows(
    path: str | Path, large: Mapping[str, Rows], arrays: Mapping[str, np.ndarray], metadata: Mapping[str, Any]
) -> None:
    """As `write_npz`, with large arrays more, each asked for its rows when the one before it is written.

    Raises FileError as `write_npz` does, and where the rows do not fill the shape.
    """
    with whole_file(path) as temporary, zipfile.ZipFile(temporary, "w", zipfile.ZIP_STORED) as archive:
        for other, array in {**arrays, "metadata": np.array(json.dumps(metadata))}.items():
            with archive.open(f"{other}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asarray(array), allow_pickle=False)
        for name, found in large.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                for part in _npy(path, found):
                    file.write(part)


def _npy(path: str | Path, found: Rows) -> Iterator[bytes]:
    """What a .npy file of an array holds: its header, then row after row."""
    header = BytesIO()
    described = {"descr": found.dtype, "fortran_order": False, "shape": found.shape}
    np.lib.format.write_array_header_1_0(header, described)
    yield header.getvalue()
    count = 0
    for row in found.rows:
        if row.shape != found.shape[1:]:
            raise FileError(f"cannot write {path}: a row has shape {row.shape}, not {found.shape[1:]}")
        yield np.ascontiguousarray(row, found.dtype).tobytes()
        count += 1
    if count != found.shape[0]:
        raise FileError(f"cannot write {path}: {count} rows of {found.shape[0]} came")


def read_npz(path: str | Path, kind: str, required: tuple[str, ...]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and metadata of a file written by `write_npz`; `kind` ("transfer", "light", ...) is for messages.

    Raises FileError where the file is missing, no such archive, damaged, or lacks one of the `required` arrays; whether
    its arrays fit together is for `check_arrays`.
    """
    path = _existing(path, kind)
    try:
        # numpy leaves the file open when it fails on a path, so it is given the open file
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except _DAMAGED:
        raise FileError(f"{path} {_UNREADABLE}") from None
    missing = [name for name in (*required, "metadata") if name not in arrays]
    if missing:
        raise FileError(f"{path} is not a {kind} file: it has no array {missing[0]!r}")
    try:
        metadata = json.loads(str(arrays.pop("metadata")))
    except (ValueError, RecursionError):
        metadata = None
    if not isinstance(metadata, dict):
        raise FileError(f"{path} is not a {kind} file: its metadata is not a JSON object") from None
    return arrays, metadata


def names_in_npz(path: str | Path) -> list[str]:
    """Names of the arrays in an npz file. Raises FileError where it is missing or no such archive."""
    path = _existing(path, "npz")
    try:
        with zipfile.ZipFile(path) as archive:
            return [entry.removesuffix(".npy") for entry in archive.namelist()]
    except _DAMAGED:
        raise FileError(f"{path} {_UNREADABLE}") from None


def open_npz(path: str | Path, kind: str) -> dict[str, np.ndarray]:
    """The arrays of an npz file that any program wrote; large ones that it holds uncompressed stay in it until used.

    Raises FileError where the file is missing, no such archive or damaged; `kind` is for that message.
    """
    path = _existing(path, kind)
    try:
        with open(path, "rb") as file, zipfile.ZipFile(file) as archive:
            return {entry.filename.removesuffix(".npy"): _member(file, archive, entry) for entry in archive.infolist()}
    except _DAMAGED:
        raise FileError(f"{path} {_UNREADABLE}") from None


def _member(file: BinaryIO, archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> np.ndarray:
    """An array of an archive: a view of the file where it is large and not compressed."""
    with archive.open(entry) as data:
        if entry.compress_type != zipfile.ZIP_STORED or entry.file_size < _LARGE:
            return np.lib.format.read_array(data, allow_pickle=False)
        version = np.lib.format.read_magic(data)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(data)
        if dtype.hasobject:
            raise ValueError("an array of objects")
        header = data.tell()
    file.seek(entry.header_offset + 26)  # of the entry's own header, where the lengths of its two last fields stand
    name, extra = struct.unpack("<HH", file.read(4))
    offset = entry.header_offset + 30 + name + extra + header
    return np.memmap(file, dtype, "r", offset, shape, "F" if fortran else "C")


def _existing(path: str | Path, kind: str) -> Path:
    path = as_path(path)
    if not path.exists():
        raise FileError(f"no such file: {path}")
    if path.is_dir():
        raise FileError(f"{path} is a folder, not a {kind} file (.npz)")
    return path


def arrays_hash(arrays: Mapping[str, np.ndarray]) -> str:
    """Hash of names, types, shapes and contents of arrays, whatever their order: equal where they are bit for bit."""
    total = hashlib.sha256()
    for name in sorted(arrays):
        array = np.asarray(arrays[name])
        total.update(f"{name} {array.dtype.str} {array.shape} ".encode() + array.tobytes())
    return total.hexdigest()


def check_arrays(
    path: str | Path,
    kind: str,
    arrays: Mapping[str, np.ndarray],
    shapes: Mapping[str, tuple[int | str, ...]],
    optional: Collection[str] = (),
    integers: Collection[str] = (),
) -> dict[str, int]:
    """Check that the arrays of a file are there, of the right type and shape, and finite; returns the sizes.

    `shapes` says for each array the size of its dimensions, or a letter where only equal letters must agree; arrays
    named in `optional` may be missing, those in `integers` hold integers, all others floats. Raises FileError, one line
    that names the first array that is wrong.
    """
    sizes: dict[str, int] = {}
    for name, shape in shapes.items():
        if name not in arrays:
            if name in optional:
                continue
            raise FileError(f"{path} is not a whole {kind} file: it has no array {name!r}; write it again")
        array = arrays[name]
        wanted = "integers" if name in integers else "floats"
        if array.dtype.kind not in ("iu" if name in integers else "f"):
            raise FileError(f"{path} is not a {kind} file: {name!r} holds {array.dtype}, not {wanted}; write it again")
        expected = tuple(sizes.get(side, side) if isinstance(side, str) else side for side in shape)
        fits = [isinstance(want, str) or want == found for want, found in zip(expected, array.shape, strict=False)]
        if array.ndim != len(shape) or not all(fits):
            sides = ", ".join(map(str, expected))
            raise FileError(
                f"{path} is not a whole {kind} file: {name!r} has shape {array.shape}, not ({sides}); write it again"
            )
        sizes |= {side: found for side, found in zip(shape, array.shape, strict=True) if isinstance(side, str)}
        if wanted == "floats" and not np.isfinite(array).all():
            raise FileError(f"{path} holds values in {name!r} that are not finite: write it again")
    return sizes


def read_array(path: str | Path) -> np.ndarray:
    """The array of a .npy file, or the only one of a .npz file. Raises FileError where there is none, or several."""
    path = as_path(path)
    if not path.is_file():
        raise FileError(f"no such file: {path}")
    try:
        with open(path, "rb") as file:
            found = np.load(file, allow_pickle=False)
            arrays = [found] if isinstance(found, np.ndarray) else [found[name] for name in found.files]
    except _DAMAGED:
        raise FileError(f"{path} is no readable .npy or .npz file: write it again with numpy.save") from None
    if len(arrays) != 1:
        raise FileError(f"{path} holds {len(arrays)} arrays: write the one that is meant with numpy.save")
    return arrays[0]
