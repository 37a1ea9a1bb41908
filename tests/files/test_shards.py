"""What a shard is: every piece once, records that are believed only where they are right, and what a merge refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import arrays_hash, write_npz
from gash_jax.files.shards import Shard, check_merge, fault_of, read_record, read_shard, write_record


@pytest.mark.parametrize("pieces", [0, 1, 2, 7, 16])
@pytest.mark.parametrize("count", [1, 2, 3, 20])
def test_every_piece_is_in_one_shard(pieces: int, count: int) -> None:
    shares = [list(Shard(number, count).of(range(pieces))) for number in range(1, count + 1)]
    assert sorted(piece for share in shares for piece in share) == list(range(pieces))
    assert max(map(len, shares)) - min(map(len, shares)) <= 1


def test_shards_are_counted_from_one() -> None:
    assert read_shard("2/3") == Shard(2, 3) and str(Shard(2, 3)) == "2/3"
    assert Shard(2, 3).of("abcdefgh") == "beh" and Shard().of("abc") == "abc"


@pytest.mark.parametrize(
    "text", ["3/2", "0/2", "a/b", "1/0", "0/0", "2", "", "1/2/3", "-1/2", "1.0/2", "1/", "²/3", "١/٢"]
)
def test_what_is_no_shard_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="shard") as caught:
        read_shard(text)
    assert "\n" not in str(caught.value)


def test_a_merge_names_the_shards_to_run_again(tmp_path: Path) -> None:
    check_merge(["", "", ""], 2)
    (tmp_path / "b").touch()
    faults = ["", fault_of("b", tmp_path / "b", False), "", fault_of("d", tmp_path / "d", False), ""]
    with pytest.raises(
        FileError, match=r"^cannot merge, b is damaged \(and 1 more of 5 pieces\): run --shard 2/2 again,"
    ):
        check_merge(faults, 2)
    with pytest.raises(FileError, match="run --shard 1/3 and --shard 2/3 again, then --merge 3$"):
        check_merge(faults, 3)
    with pytest.raises(FileError, match="^cannot merge, d is missing: run --shard 4/5 again"):
        check_merge([*faults[:1], "", *faults[2:]], 5)


def _piece(folder: Path) -> Path:
    write_npz(folder / "a.npz", {"x": np.arange(300.0), "y": np.ones((2, 2), np.float32)}, {"seconds": 1})
    write_record(folder, "a", "key", folder / "a.npz", {"skill": 0.5})
    return folder / "a.npz"


def test_a_record_knows_its_piece(tmp_path: Path) -> None:
    path = _piece(tmp_path)
    assert read_record(tmp_path, "a", "key", path) == {"skill": 0.5}
    assert read_record(tmp_path, "a", "other", path) is None and read_record(tmp_path, "b", "key", path) is None
    write_npz(path, {"y": np.ones((2, 2), np.float32), "x": np.arange(300.0)}, {"seconds": 2})
    assert read_record(tmp_path, "a", "key", path) == {"skill": 0.5}, "seconds and the order of arrays do not count"


@pytest.mark.parametrize(
    "harm", ["gone", "cut", "changed", "other numbers", "record cut", "record changed", "record {}"]
)
def test_a_damaged_piece_is_not_believed(tmp_path: Path, harm: str) -> None:
    path = _piece(tmp_path)
    record = tmp_path / "pieces" / "a.json"
    data, text = bytearray(path.read_bytes()), record.read_text()
    if harm == "gone":
        path.unlink()
    elif harm == "cut":
        path.write_bytes(data[:-40])
    elif harm == "changed":
        data[data.index(np.arange(300.0).tobytes()) + 800] ^= 1
        path.write_bytes(data)
    elif harm == "other numbers":
        write_npz(path, {"x": np.arange(300.0), "y": np.zeros((2, 2), np.float32)}, {})
    elif harm == "record cut":
        record.write_text(text[:-20])
    elif harm == "record changed":
        record.write_text(json.dumps({**json.loads(text), "values": {"skill": 0.9}}))
    else:
        record.write_text("{}")
    assert read_record(tmp_path, "a", "key", path) is None


def test_the_hash_is_of_names_types_shapes_and_contents() -> None:
    x = np.arange(6, dtype=np.float32)
    kinds = [
        {"x": x},
        {"y": x},
        {"x": x.reshape(2, 3)},
        {"x": x.astype(np.float64)},
        {"x": x + 1},
        {"x": x, "y": x},
        {},
    ]
    kinds += [{"x": np.array("a")}, {"x": np.array(["a"])}]
    assert len({arrays_hash(arrays) for arrays in kinds}) == len(kinds)
    assert arrays_hash({"a": x, "b": x + 1}) == arrays_hash({"b": x + 1, "a": x})
    assert arrays_hash({"x": np.asfortranarray(x.reshape(2, 3))}) == arrays_hash({"x": x.reshape(2, 3)})
