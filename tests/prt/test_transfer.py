"""The transfer file."""

from pathlib import Path

import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.transfer import load_transfer, save_transfer
from gash_jax.shapes.primitives import icosphere


def test_file_round_trip_and_plain_numpy(tmp_path: Path) -> None:
    baked = bake_transfer(icosphere(1), rays=32)
    save_transfer(tmp_path / "t.npz", baked)
    with np.load(tmp_path / "t.npz", allow_pickle=False) as raw:
        assert raw["coefficients"].dtype == np.float32 and raw["faces"].dtype == np.int32
        assert raw["metadata"].shape == ()
    loaded = load_transfer(tmp_path / "t.npz")
    for name in ("coefficients", "standard_error", "vertices", "normals", "faces"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(baked, name))
    assert loaded.metadata["bands"] == loaded.bands == 3
    keys = {"format", "version", "bands", "conventions", "method", "parameters", "rays_total", "seconds", "software"}
    assert keys <= set(loaded.metadata)


def test_a_failed_write_keeps_the_good_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "t.npz"
    write_npz(path, {"a": np.arange(3)}, {"x": 1})
    before = path.read_bytes()

    def broken(*_: object, **__: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez", broken)
    with pytest.raises(OSError):
        write_npz(path, {"a": np.arange(4)}, {})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["t.npz"]


def test_bad_files_are_named(tmp_path: Path) -> None:
    good = tmp_path / "t.npz"
    save_transfer(good, bake_transfer(icosphere(0), rays=16))
    cases = {
        "absent.npz": "no such file",
        "folder": "is a folder",
        "text.npz": "not a readable npz",
        "cut.npz": "not a readable npz",
        "other.npz": "no array 'coefficients'",
        "nan.npz": "not finite",
    }
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.npz").write_text("hello")
    (tmp_path / "cut.npz").write_bytes(good.read_bytes()[:-200])
    write_npz(tmp_path / "other.npz", {"a": np.zeros(1)}, {})
    arrays, metadata = read_npz(good, "transfer", ())
    write_npz(tmp_path / "nan.npz", {**arrays, "coefficients": arrays["coefficients"] * np.nan}, metadata)
    for name, message in cases.items():
        with pytest.raises(FileError, match=message):
            load_transfer(tmp_path / name)


def test_unwritable_outputs_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="does not exist"):
        write_npz(tmp_path / "no" / "t.npz", {}, {})
    with pytest.raises(FileError, match="is a folder"):
        write_npz(tmp_path, {}, {})
