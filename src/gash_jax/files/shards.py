"""Work that several machines share through files: which pieces are whose, and how a finished piece is known.

The work of a command is a list of pieces in an order that every machine sees alike: the shapes of a corpus, files of
baked frames, runs of a sweep, meshes of a folder. Shard i of n, counted from 1, takes the i-th piece and every n-th
after it. A piece follows from the command alone, never from the shard that it falls into, and its file is whole or
absent (`files.atomic`). So shards of any number may run in any order, at the same time or twice, and what is there
already is left alone.

A merge believes no file: each is read and compared with the hash of its arrays that was written with it. That hash
stands in the file itself, or in a record beside it where the file is the user's own (`write_record`). It covers arrays,
not bytes of files, as metadata may hold seconds, which differ each time.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from gash_jax.files.atomic import FileError, write_text
from gash_jax.files.npz import arrays_hash, read_npz

Piece = TypeVar("Piece")


class Shard(NamedTuple):
    """Part `number` of `total`, counted from 1; 1 of 1 is everything."""

    number: int = 1
    total: int = 1

    def __str__(self) -> str:
        return f"{self.number}/{self.total}"

    def of(self, pieces: Sequence[Piece]) -> Sequence[Piece]:
        """Its own pieces: neighbours in the list, which often cost the same, go to different shards."""
        return pieces[self.number - 1 :: self.total]


def read_shard(text: str) -> Shard:
    """The shard that "i/n" names. Raises ValueError for anything else, and where i is not from 1 to n."""
    parts = text.split("/")
    if len(parts) != 2 or not all(part.isascii() and part.isdecimal() for part in parts):
        raise ValueError(f"{text!r} is no shard: give its number and how many there are, such as 2/8")
    number, count = map(int, parts)
    if not 1 <= number <= count:
        known = f"the shards are 1/{count} to {count}/{count}" if count else "give 1/1 or more shards, such as 2/8"
        raise ValueError(f"there is no shard {text}: {known}")
    return Shard(number, count)


def fault_of(name: str, path: Path, whole: bool, wrong: str = "damaged") -> str:
    """What is wrong with a piece, in words; "" where nothing is. `wrong` says it of a file that is there."""
    return "" if whole else f"{name} is {wrong}" if path.exists() else f"{name} is missing"


def check_merge(faults: Sequence[str], count: int) -> None:
    """Raise FileError unless all pieces are whole: the first fault, and which of `count` shards to run again.

    `faults` says of every piece, in their order, what is wrong with it; "" where nothing is.
    """
    bad = [number for number, fault in enumerate(faults) if fault]
    if not bad:
        return
    shards = sorted({number % count + 1 for number in bad})
    more = f" (and {len(bad) - 1} more of {len(faults)} pieces)" if len(bad) > 1 else ""
    again = " and ".join(f"--shard {number}/{count}" for number in shards)
    raise FileError(f"cannot merge, {faults[bad[0]]}{more}: run {again} again, then --merge {count}")


def write_record(folder: Path, name: str, of: str, file: Path, values: Mapping[str, Any]) -> None:
    """Record in `folder`/pieces that `file` (.npz) is the finished piece `name`.

    `of` is the hash of everything that determines it; `values` (JSON) are kept with it. Raises FileError where the file
    cannot be read.
    """
    path = _record(folder, name)
    path.parent.mkdir(parents=True, exist_ok=True)
    held = {"of": of, "arrays": arrays_hash(read_npz(file, "piece", ())[0]), "values": values}
    write_text(path, json.dumps({**held, "sha256": _hash(held)}) + "\n")


def read_record(folder: Path, name: str, of: str, file: Path) -> dict[str, Any] | None:
    """The values of a finished piece; None unless its record and its file are there and are what was written."""
    try:
        held = json.loads(_record(folder, name).read_text(encoding="utf-8"))
        said = held.pop("sha256")
        arrays, _ = read_npz(file, "piece", ())
        whole = said == _hash(held) and held["of"] == of and held["arrays"] == arrays_hash(arrays)
        return held["values"] if whole else None
    except (OSError, ValueError, LookupError, TypeError, AttributeError):  # absent or damaged
        return None


def _record(folder: Path, name: str) -> Path:
    return folder / "pieces" / f"{name}.json"


def _hash(values: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()
