"""Where what can be made again is kept: corpora, references, compiled programs."""

import hashlib
import os
from collections.abc import Iterable
from functools import cache
from pathlib import Path


def cache_folder() -> Path:
    """$GASH_CACHE, or the user's cache folder."""
    default = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "gash_jax"
    return Path(os.environ.get("GASH_CACHE", default))


@cache
def source_hash(rooms: tuple[str, ...]) -> str:
    """Hash of the source of some rooms of the package: what they made is found again as long as they stay the same."""
    package = Path(__file__).parents[1]
    return _hash(file for room in rooms for file in sorted((package / room).glob("*.py")))


def _hash(files: Iterable[Path]) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
