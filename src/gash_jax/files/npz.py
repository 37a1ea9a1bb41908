"""npz files that are whole or absent, with a JSON `metadata` string beside the arrays; no pickle anywhere."""

import json
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.files.atomic import FileError, whole_file


def write_npz(path: str | Path, arrays: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Write to a temporary name beside `path`, then rename: readers see the old file or the new one."""
    with whole_file(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, allow_pickle=False, **arrays, metadata=np.array(json.dumps(metadata)))


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
