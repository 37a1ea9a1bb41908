"""The transfer file."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.files.atomic import FileError
from gash_jax.files.containers import array_names
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.transfer import Transfer, load_transfer, make_metadata, save_transfer
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


def _full(bands: int, half: bool, coloured: bool) -> Transfer:
    """A transfer with every field there is, of random numbers."""
    rng, mesh, kind = np.random.default_rng(bands), icosphere(1), np.float16 if half else np.float32
    count, k = len(mesh.vertices), bands**2
    rows = (count, k, 3) if coloured else (count, k)
    coefficients, error, predicted = (rng.random(rows, np.float32) for _ in range(3))
    visibility, unsure = (rng.random((count, (2 * bands - 1) ** 2)).astype(kind) for _ in range(2))
    matrices = rng.random((count, k, k)).astype(kind)
    metadata = make_metadata(bands, "bake", {})
    return Transfer(coefficients, error, *mesh, metadata, predicted, visibility, matrices, unsure)


@pytest.mark.parametrize("bands", [1, 3, 10])
@pytest.mark.parametrize(("half", "coloured"), [(True, True), (False, False)])
def test_every_field_survives_the_file(tmp_path: Path, bands: int, half: bool, coloured: bool) -> None:
    transfer = _full(bands, half, coloured)
    save_transfer(tmp_path / "t.npz", transfer)
    loaded = load_transfer(tmp_path / "t.npz")
    assert loaded.bands == bands and loaded.metadata == transfer.metadata
    for name in array_names(Transfer):
        saved, found = getattr(transfer, name), getattr(loaded, name)
        np.testing.assert_array_equal(found, saved)
        assert found.dtype == saved.dtype, name
    on_device = jax.tree.map(jnp.asarray, transfer)
    save_transfer(tmp_path / "d.npz", on_device)
    again = load_transfer(tmp_path / "d.npz")
    np.testing.assert_array_equal(again.coefficients, transfer.coefficients)
    # a transformation drops the metadata; what the file needs to be read is there all the same
    assert again.metadata["bands"] == bands and again.metadata["conventions"] == transfer.metadata["conventions"]


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        ("standard_error", (42, 9)),
        ("predicted_error", (42, 9)),
        ("visibility", (42, 9)),
        ("visibility", (41, 25)),
        ("visibility_error", (42, 9)),
        ("matrices", (42, 9)),
        ("matrices", (42, 9, 25)),
        ("normals", (42, 2)),
    ],
)
def test_shapes_that_do_not_fit_are_refused_when_saved_and_when_loaded(
    tmp_path: Path, name: str, shape: tuple[int, ...]
) -> None:
    """Of a coloured transfer in three bands; nothing is written, and the message is one line that names the array."""
    good = _full(3, False, True)
    bad = jax.tree.map(lambda leaf: leaf, good)
    bad.__dict__[name] = np.zeros(shape, np.float32)
    with pytest.raises(FileError, match=f"'{name}' has shape") as saved:
        save_transfer(tmp_path / "t.npz", bad)
    assert "\n" not in str(saved.value) and not (tmp_path / "t.npz").exists()
    arrays = {field: getattr(bad, field) for field in array_names(Transfer)}
    write_npz(tmp_path / "t.npz", arrays, good.metadata)
    with pytest.raises(FileError, match=f"'{name}' has shape"):
        load_transfer(tmp_path / "t.npz")


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
