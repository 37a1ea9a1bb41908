"""npz files that are whole or absent, with a JSON `metadata` string beside the arrays; no pickle anywhere."""

import json
import os
import tempfile
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np


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


def write_npz(path: str | Path, arrays: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Write to a temporary name beside `path`, then rename: readers see the old file or the new one."""
    path = check_writable(path)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, "wb") as file:
            np.savez(file, allow_pickle=False, **arrays, metadata=np.array(json.dumps(metadata)))
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_npz(path: str | Path, kind: str, required: tuple[str, ...]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Arrays and metadata of a file written by `write_npz`; `kind` ("transfer", "light", ...) is for messages."""
    path = Path(path)
    if not path.exists():
        raise FileError(f"no such file: {path}")
    if path.is_dir():
        raise FileError(f"{path} is a folder, not a {kind} file (.npz)")
    try:
        # numpy leaves the file open when it fails on a path, so it is given the open file
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, ValueError, KeyError):
        raise FileError(f"{path} is not a readable npz file: truncated or another format; write it again") from None
    missing = [name for name in (*required, "metadata") if name not in arrays]
    if missing:
        raise FileError(f"{path} is not a {kind} file: it has no array {missing[0]!r}")
    try:
        metadata = json.loads(str(arrays.pop("metadata")))
    except json.JSONDecodeError:
        raise FileError(f"{path} is not a {kind} file: its metadata is not JSON") from None
    return arrays, metadata
