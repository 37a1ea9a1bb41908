"""Files that are whole or absent: written to a temporary name beside the target, then renamed.

The target may be a symbolic link: the file it points to is replaced, the link stays. What is no ordinary file (a
folder, a device, a pipe), is write-protected or is one of the inputs under any name is refused before any work.
"""

import errno
import json
import os
import stat
import tempfile
import uuid
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.EROFS}


class FileError(ValueError):
    """A file cannot be read or written; the message is one line that says what to do.

    >>> try:
    ...     gash_jax.load_transfer("absent.npz")
    ... except gash_jax.FileError as error:
    ...     print(error)
    no such file: absent.npz
    """


def as_path(value: object) -> Path:
    """A path that somebody gave. Raises FileError for what is none, and for names that no file can have."""
    if not isinstance(value, str | os.PathLike):
        raise FileError(f"a {type(value).__name__} is no path: give a string or a pathlib.Path")
    path = Path(value)
    try:
        path.stat()
    except ValueError:
        raise FileError(f"{str(path)!r} names no file: there is a zero byte in it") from None
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            raise FileError(f"{path} names no file: {error.strerror}") from None
    return path


def check_writable(path: str | Path, inputs: Iterable[str | Path | None] = ()) -> Path:
    """Fail before hours of work, not after; returns the file that would be written, links followed.

    Raises FileError if `path` is no place for an ordinary file, cannot be written, or is the same file as one of
    `inputs`, whatever both are called (relative, by a link, in other letters where these do not count). None and names
    of no file count for nothing.
    """
    path = as_path(path)
    target = _followed(path)
    try:
        mode = path.stat().st_mode
    except (FileNotFoundError, NotADirectoryError):
        mode = None  # no such file yet
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror}") from None
    if mode is not None:
        _check_replaceable(path, target, mode, inputs)
    if not target.parent.is_dir():
        raise FileError(f"cannot write {path}: the folder {target.parent} does not exist, create it first")
    if not os.access(target.parent, os.W_OK):
        raise FileError(f"cannot write {path}: no permission to write in {target.parent}")
    try:
        with tempfile.TemporaryFile(dir=target.parent):
            pass
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror}") from None
    return target


def _followed(path: Path) -> Path:
    """The file that a path leads to, through symbolic links; the path itself if it is none."""
    try:
        return path.resolve() if path.is_symlink() else path
    except RuntimeError:  # up to Python 3.12; later ones leave it to the system
        raise FileError(f"cannot write {path}: it is a link that leads in a circle") from None
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror}") from None


def _check_replaceable(path: Path, target: Path, mode: int, inputs: Iterable[str | Path | None]) -> None:
    if stat.S_ISDIR(mode):
        raise FileError(f"cannot write {path}: it is a folder, give a file name")
    if not stat.S_ISREG(mode):
        raise FileError(f"cannot write {path}: it is a device or a pipe, give the name of an ordinary file")
    for source in inputs:
        if source is not None and os.path.exists(source) and os.path.samefile(source, target):
            raise FileError(f"cannot write {path}: it is the input {source}, give the output another name")
    # the superuser may write anything: there the mode says what was meant
    if not os.access(target, os.W_OK) or not mode & (stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH):
        raise FileError(f"cannot write {path}: it is write-protected, give another name or allow writing")


@contextmanager
def whole_file(path: str | Path, inputs: Iterable[str | Path | None] = ()) -> Iterator[Path]:
    """A temporary path to write to; it becomes `path` where the block ends well, and is removed where it does not.

    Raises FileError where `path` cannot be written, before the block begins (`check_writable`), or where there is no
    room for it.
    """
    target = check_writable(path, inputs)
    # several machines may write into one folder, and number their processes alike
    temporary = target.with_name(f".{target.name[:40]}.{uuid.uuid4().hex[:16]}.tmp")
    try:
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        kept = "the file that was there is kept" if target.exists() else "nothing was written"
        raise FileError(f"cannot write {path}: {error.strerror}; {kept}, make room and try again") from None
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: str | Path, values: dict[str, Any]) -> None:
    """Write a JSON file whole."""
    write_text(path, json.dumps(values, indent=1) + "\n")


def write_text(path: str | Path, text: str) -> None:
    """Write a UTF-8 text file whole."""
    with whole_file(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
