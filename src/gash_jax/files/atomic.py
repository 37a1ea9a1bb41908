"""Files that are whole or absent: written to a temporary name beside the target, then renamed."""

import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class FileError(ValueError):
    """A file cannot be read or written; the message is one line that says what to do."""


def check_writable(path: str | Path) -> Path:
    """Fail before hours of work, not after: the folder must exist and be writable, the path must not be a folder."""
    path = Path(path)
    if path.is_dir():
        raise FileError(f"cannot write {path}: it is a folder, give a file name")
    if not path.parent.is_dir():
        raise FileError(f"cannot write {path}: the folder {path.parent} does not exist, create it first")
    if not os.access(path.parent, os.W_OK):
        raise FileError(f"cannot write {path}: no permission to write in {path.parent}")
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror}") from None
    return path


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """A temporary path to write to; it becomes `path` where the block ends well, and is removed where it does not.

    Raises FileError where `path` cannot be written, before the block begins.
    """
    path = check_writable(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: str | Path, values: dict[str, Any]) -> None:
    """Write a JSON file whole."""
    write_text(path, json.dumps(values, indent=1) + "\n")


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file whole."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
