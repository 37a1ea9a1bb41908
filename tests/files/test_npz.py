"""npz files: whole or refused in one line, whatever was done to them."""

import json
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import check_arrays, names_in_npz, open_npz, read_npz, write_npz

ARRAYS = {"a": np.arange(12, dtype=np.float32).reshape(4, 3), "faces": np.zeros((5, 3), np.int32)}
SHAPES = {"a": ("v", 3), "faces": ("f", 3), "error": ("v", "k")}


def _written(tmp_path: Path) -> Path:
    write_npz(tmp_path / "a.npz", ARRAYS, {"format": "test", "note": "grün"})
    return tmp_path / "a.npz"


def test_round_trip_without_pickle(tmp_path: Path) -> None:
    arrays, metadata = read_npz(_written(tmp_path), "test", ("a",))
    assert metadata == {"format": "test", "note": "grün"} and set(arrays) == set(ARRAYS)
    for name, array in arrays.items():
        np.testing.assert_array_equal(array, ARRAYS[name])
    with np.load(tmp_path / "a.npz", allow_pickle=False) as archive:
        assert json.loads(str(archive["metadata"]))["format"] == "test"
    with pytest.raises(ValueError, match="allow_pickle"):
        write_npz(tmp_path / "b.npz", {"a": np.array([{}], dtype=object)}, {})
    assert not (tmp_path / "b.npz").exists()


def _metadata(text: str) -> Callable[[Path], None]:
    return lambda path: np.savez(path, a=np.ones(3), metadata=np.array(text))


def _objects(path: Path) -> None:
    np.savez(path, allow_pickle=True, a=np.array([{"x": 1}], dtype=object), metadata=np.array("{}"))


def _one_array(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, np.ones(3))


def _another_archive(path: Path) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "hello")


def _huge(path: Path) -> None:
    """A header that announces more than any memory holds."""
    with zipfile.ZipFile(path, "w") as archive:
        head = b"{'descr': '<f4', 'fortran_order': False, 'shape': (10000000000000,), }".ljust(117) + b"\n"
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00\x76\x00" + head)
        archive.writestr("metadata.npy", b"")


BAD = {
    "missing": (lambda path: None, "no such file"),
    "folder": (lambda path: path.mkdir(), "is a folder, not a test file"),
    "empty": (lambda path: path.write_bytes(b""), "not a readable npz file"),
    "text": (lambda path: path.write_bytes(b"hello"), "not a readable npz file"),
    "one array": (_one_array, "not a readable npz file"),
    "pickle": (lambda path: path.write_bytes(pickle.dumps({"a": 1})), "not a readable npz file"),
    "objects": (_objects, "not a readable npz file"),
    "another archive": (_another_archive, "no array 'a'"),
    "no array": (
        lambda path: np.savez(path, b=np.ones(3), metadata=np.array("{}")),
        "not a test file: .* no array 'a'",
    ),
    "no metadata": (lambda path: np.savez(path, a=np.ones(3)), "no array 'metadata'"),
    "metadata": (_metadata("{"), "metadata is not a JSON object"),
    "a list": (_metadata("[1, 2]"), "metadata is not a JSON object"),
    "a number": (_metadata("3"), "metadata is not a JSON object"),
    "deep": (_metadata("[" * 100000), "metadata is not a JSON object"),
    "huge": (_huge, "not a readable npz file"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_such_file_is_refused(tmp_path: Path, name: str) -> None:
    make, words = BAD[name]
    make(tmp_path / "a.npz")
    with pytest.raises(FileError, match=words) as error:
        read_npz(tmp_path / "a.npz", "test", ("a",))
    assert "\n" not in str(error.value) and "a.npz" in str(error.value)


def test_every_truncation_is_noticed(tmp_path: Path) -> None:
    path = _written(tmp_path)
    data = path.read_bytes()
    for length in range(0, len(data), 7):
        path.write_bytes(data[:length])
        with pytest.raises(FileError, match="truncated or another format"):
            read_npz(path, "test", ())


def test_damaged_bytes_are_noticed_or_harmless(tmp_path: Path) -> None:
    """One byte of every place, and several at random: the arrays as they were, or one line."""
    path = _written(tmp_path)
    data, rng, refused = path.read_bytes(), np.random.default_rng(0), 0
    changes = [[(place, value)] for place in range(len(data)) for value in (0, 255, data[place] ^ 1)]
    changes += [[(int(p), int(rng.integers(256))) for p in rng.integers(0, len(data), 4)] for _ in range(500)]
    for change in changes:
        damaged = bytearray(data)
        for place, value in change:
            damaged[place] = value
        path.write_bytes(damaged)
        try:
            arrays, _ = read_npz(path, "test", ("a",))
            np.testing.assert_array_equal(arrays["a"], ARRAYS["a"])
        except FileError as error:
            assert "\n" not in str(error)
            refused += 1
    assert refused > len(changes) / 2


def _check(**changes: np.ndarray) -> dict[str, int]:
    arrays = {name: array for name, array in {**ARRAYS, **changes}.items() if array is not None}
    return check_arrays("a.npz", "test", arrays, SHAPES, optional=("error",), integers=("faces",))


def test_arrays_that_fit() -> None:
    assert _check() == {"v": 4, "f": 5}
    assert _check(error=np.zeros((4, 9), np.float16)) == {"v": 4, "f": 5, "k": 9}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"a": None}, "no array 'a'"),
        ({"a": np.zeros((4, 3), np.int32)}, "'a' holds int32, not floats"),
        ({"a": np.zeros((4, 3), np.complex64)}, "'a' holds complex64, not floats"),
        ({"a": np.zeros((4, 3), "U1")}, "'a' holds <U1, not floats"),
        ({"a": np.zeros((4, 3), bool)}, "'a' holds bool, not floats"),
        ({"faces": np.zeros((5, 3), np.float32)}, "'faces' holds float32, not integers"),
        ({"a": np.zeros((4, 2), np.float32)}, r"'a' has shape \(4, 2\), not \(v, 3\)"),
        ({"a": np.zeros(4, np.float32)}, r"'a' has shape \(4,\), not \(v, 3\)"),
        ({"a": np.zeros((4, 3, 1), np.float32)}, r"'a' has shape \(4, 3, 1\), not \(v, 3\)"),
        ({"error": np.zeros((5, 9), np.float32)}, r"'error' has shape \(5, 9\), not \(4, k\)"),
        ({"a": np.full((4, 3), np.nan, np.float32)}, "values in 'a' that are not finite"),
        ({"error": np.full((4, 9), np.inf, np.float32)}, "values in 'error' that are not finite"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changes: dict, words: str) -> None:
    with pytest.raises(FileError, match=words) as error:
        _check(**changes)
    assert "\n" not in str(error.value) and "a.npz" in str(error.value)


def test_files_of_other_programs_are_opened_without_metadata(tmp_path: Path) -> None:
    large = np.arange(1 << 19, dtype=np.float32).reshape(2, -1)
    arrays = {"small": np.arange(3), "large": large, "columns": np.asfortranarray(large), "none": np.zeros((0, 3))}
    np.savez(tmp_path / "plain.npz", **arrays)
    np.savez_compressed(tmp_path / "packed.npz", **arrays)
    for name, mapped in (("plain.npz", True), ("packed.npz", False)):
        assert names_in_npz(tmp_path / name) == list(arrays)
        opened = open_npz(tmp_path / name, "test")
        for key, array in arrays.items():
            np.testing.assert_array_equal(opened[key], array)
        assert isinstance(opened["large"], np.memmap) == isinstance(opened["columns"], np.memmap) == mapped
        assert not isinstance(opened["small"], np.memmap)


def test_what_cannot_be_opened_is_refused(tmp_path: Path) -> None:
    (tmp_path / "bad.npz").write_bytes(b"PK no archive")
    np.savez(tmp_path / "objects.npz", large=np.full(1 << 18, "x", dtype=object))
    for name, message in (
        ("bad.npz", "is not a readable npz file"),
        ("absent.npz", "no such file"),
        ("", "is a folder"),
    ):
        for read in (names_in_npz, lambda path: open_npz(path, "test")):
            with pytest.raises(FileError, match=message):
                read(tmp_path / name)
    with pytest.raises(FileError, match="is not a readable npz file"):
        open_npz(tmp_path / "objects.npz", "test")
