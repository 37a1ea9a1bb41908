"""Output is whole or absent, goes where it is meant to go, and never onto an input."""

import errno
import os
import resource
from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.atomic import FileError, check_writable, whole_file, write_json, write_text
from gash_jax.files.npz import read_npz, write_npz


def _refused(path: Path | str, words: str, inputs=()) -> None:
    with pytest.raises(FileError, match=words) as error:
        check_writable(path, inputs)
    assert "\n" not in str(error.value) and str(Path(path)) in str(error.value)
    with pytest.raises(FileError, match=words), whole_file(path, inputs):
        pytest.fail("the block must not begin")


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "old")
    write_json(path, {"new": 1})
    assert path.read_text() == '{\n "new": 1\n}\n'
    with pytest.raises(KeyboardInterrupt), whole_file(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == '{\n "new": 1\n}\n'
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def test_inputs_under_any_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    source, other = tmp_path / "mesh.ply", tmp_path / "other.ply"
    source.write_text("mesh")
    other.write_text("other")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link.ply").symlink_to("mesh.ply")
    (tmp_path / "chain.ply").symlink_to("folder/../link.ply")
    (tmp_path / "linked").symlink_to("folder/..")
    os.link(source, tmp_path / "hard.ply")
    spellings = ["mesh.ply", "./mesh.ply", "folder/../mesh.ply", "link.ply", "chain.ply", "linked/mesh.ply", "hard.ply"]
    for name in [*spellings, str(source)]:
        for given in ("mesh.ply", "link.ply", source):
            _refused(name, f"it is the input {given}", [other, given])
        check_writable(name, [other])
        check_writable(name, ["mesh.ply.missing"])
    assert source.read_text() == "mesh"


def test_letters_that_do_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a disk that knows no capitals both names are one file; here the system is told to say so."""
    source, spelt = tmp_path / "mesh.ply", tmp_path / "MESH.PLY"
    for path in (source, spelt):
        path.write_text("mesh")
    check_writable(spelt, [source])
    monkeypatch.setattr(os.path, "samefile", lambda a, b: str(a).lower() == str(b).lower())
    _refused(spelt, "it is the input", [source])


def test_what_is_no_ordinary_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "null").symlink_to("/dev/null")
    (tmp_path / "place").symlink_to(tmp_path)
    for name in (tmp_path / "pipe", tmp_path / "null", "/dev/null"):
        _refused(name, "it is a device or a pipe, give the name of an ordinary file")
    for name in (tmp_path, tmp_path / "place"):
        _refused(name, "it is a folder, give a file name")
    (tmp_path / "one").symlink_to("two")
    (tmp_path / "two").symlink_to("one")
    _refused(tmp_path / "one", "leads in a circle|Too many levels")
    _refused(tmp_path / "none" / "a.txt", "does not exist, create it first")
    write_text(tmp_path / "file", "x")
    _refused(tmp_path / "file" / "a.txt", "does not exist, create it first")
    _refused(tmp_path / ("long" * 100), "File name too long")
    assert not [entry for entry in tmp_path.iterdir() if entry.name.endswith(".tmp")]


def test_a_write_protected_target_stays(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("kept")
    path.chmod(0o444)
    _refused(path, "write-protected, give another name or allow writing")
    (tmp_path / "link").symlink_to(path)
    _refused(tmp_path / "link", "write-protected")
    assert path.read_text() == "kept"
    path.chmod(0o644)
    write_text(path, "new")
    assert path.read_text() == "new"


def test_a_link_is_written_through(tmp_path: Path) -> None:
    """The file it leads to is replaced, in its own folder, or made; the link stays what it is."""
    (tmp_path / "there").mkdir()
    target = tmp_path / "there" / "real.txt"
    target.write_text("old")
    (tmp_path / "link.txt").symlink_to("there/real.txt")
    (tmp_path / "second.txt").symlink_to("link.txt")
    for name, text in (("link.txt", "new"), ("second.txt", "newer")):
        write_text(tmp_path / name, text)
        assert target.read_text() == text and (tmp_path / name).is_symlink()
    (tmp_path / "dangling.txt").symlink_to("there/made.txt")
    write_text(tmp_path / "dangling.txt", "made")
    assert (tmp_path / "there" / "made.txt").read_text() == "made" and (tmp_path / "dangling.txt").is_symlink()
    assert sorted(entry.name for entry in (tmp_path / "there").iterdir()) == ["made.txt", "real.txt"]


def test_the_longest_name_can_be_written(tmp_path: Path) -> None:
    for name in ("a" * 255, "ä" * 127):
        write_text(tmp_path / name, "x")
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT, errno.EIO])
def test_a_full_disk_names_the_file_and_what_is_kept(
    tmp_path: Path, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: Path, data: bytes) -> int:
        raise OSError(code, os.strerror(code))

    write_text(tmp_path / "old.txt", "old")
    monkeypatch.setattr(Path, "write_bytes", full)
    for name, kept in (("old.txt", "the file that was there is kept"), ("new.txt", "nothing was written")):
        with pytest.raises(FileError, match=f"cannot write .*{name}: .*; {kept}, make room"):
            with whole_file(tmp_path / name) as temporary:
                temporary.write_bytes(b"much")
    assert [entry.name for entry in tmp_path.iterdir()] == ["old.txt"]
    with pytest.raises(OSError, match="other"), whole_file(tmp_path / "old.txt"):  # not ours to explain
        raise OSError(errno.ENOENT, "other")


def test_a_file_that_may_grow_no_further(tmp_path: Path) -> None:
    """The system's own limit on the size of files, met while an archive is written."""
    path, limits = tmp_path / "a.npz", resource.getrlimit(resource.RLIMIT_FSIZE)
    write_npz(path, {"a": np.ones(3)}, {})
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (8192, limits[1]))
        with pytest.raises(FileError, match=r"a\.npz: .*; the file that was there is kept"):
            write_npz(path, {"a": np.ones(10000)}, {})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert read_npz(path, "test", ("a",))[0]["a"].shape == (3,)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.npz"]
