"""The unshadowed closed form and the transfer file."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.sh import evaluate_sh
from gash_jax.files.atomic import FileError
from gash_jax.files.npz import read_npz, write_npz
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.transfer import load_transfer, save_transfer, unshadowed_transfer
from gash_jax.shapes.primitives import icosphere


def test_closed_form_against_quadrature() -> None:
    """(1/pi) integral of max(n.w, 0) Y over the sphere, on a product Gauss-Legendre x uniform grid."""
    nodes, weights = np.polynomial.legendre.leggauss(200)
    phi = (np.arange(400) + 0.5) / 400 * 2 * np.pi
    z, p = np.meshgrid(nodes, phi, indexing="ij")
    directions = np.stack([np.sqrt(1 - z**2) * np.cos(p), np.sqrt(1 - z**2) * np.sin(p), z], -1).reshape(-1, 3)
    area = np.repeat(weights * 2 * np.pi / 400, 400)
    normals = np.random.default_rng(0).normal(size=(5, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    basis = np.asarray(evaluate_sh(directions.astype(np.float32), 5), np.float64)
    cosine = np.maximum(normals @ directions.T, 0)
    expected = (cosine * area) @ basis / np.pi
    np.testing.assert_allclose(np.asarray(unshadowed_transfer(normals.astype(np.float32), 5)), expected, atol=2e-4)


def test_closed_form_by_hand() -> None:
    """n = +z: (1, 0, 2/3 * sqrt(3), 0) * Y_00, and Y_00 alone lights a vertex to exactly 1 with L_00 = 2 sqrt(pi)."""
    found = np.asarray(unshadowed_transfer(np.array([[0, 0, 1]], np.float32), 2))[0]
    np.testing.assert_allclose(found, [0.28209479, 0, 0.32573501, 0], atol=1e-7)
    assert found[0] * 2 * np.sqrt(np.pi) == pytest.approx(1.0, abs=1e-6)


def test_closed_form_of_a_missing_normal_is_zero_with_finite_gradient() -> None:
    normals = jnp.array([[0.0, 0, 0], [0, -1, 0]])
    assert not np.asarray(unshadowed_transfer(normals, 3))[0].any()
    gradient = jax.grad(lambda n: unshadowed_transfer(n, 3).sum())(normals)
    assert np.isfinite(np.asarray(gradient)).all()
    np.testing.assert_allclose(jax.jit(lambda n: unshadowed_transfer(n, 3))(normals), unshadowed_transfer(normals, 3))


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
