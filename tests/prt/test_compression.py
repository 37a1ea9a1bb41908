"""Compressed visibility: what PCA promises, by hand, files, refusals."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.atomic import FileError
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.compression import compress_visibility, expand_visibility
from gash_jax.prt.transfer import Transfer, load_transfer, save_transfer
from gash_jax.shapes.primitives import bumpy_sphere, icosphere

HALF = 2.0**-11


@cache
def bumpy() -> Transfer:
    """A glossy bake, one vertex without a normal."""
    mesh = bumpy_sphere(8)
    normals = mesh.normals.copy()
    normals[7] = 0
    return bake_transfer(mesh._replace(normals=normals), rays=64, glossy=True)


def _error(count: int) -> float:
    baked = bumpy()
    assert baked.visibility is not None
    whole = baked.visibility.astype(np.float32)
    lost = expand_visibility(compress_visibility(baked.visibility, baked.normals, count), baked.normals) - whole
    assert not np.any(lost[7])
    return float(np.linalg.norm(lost) / np.linalg.norm(whole))


def test_all_components_are_the_visibility_and_fewer_the_best_linear_model() -> None:
    """The error is that of the singular values left out, in the vertices' frames; it falls with every component."""
    baked = bumpy()
    assert baked.visibility is not None
    assert _error(25) < 2 * HALF
    frames = np.asarray(orthonormal_frame(baked.normals)).swapaxes(1, 2)
    local = np.asarray(rotate_coefficients(baked.visibility.astype(np.float32), frames), np.float64)
    local = np.delete(local, 7, axis=0)
    left = np.linalg.svd(local - local.mean(0), compute_uv=False)
    errors = [_error(count) for count in (2, 8, 16)]
    expected = [np.sqrt(np.sum(left[count:] ** 2) / np.sum(local**2)) for count in (2, 8, 16)]
    np.testing.assert_allclose(errors, expected, atol=2 * HALF)
    assert errors[0] > errors[1] > errors[2]


def test_convex_bodies_need_no_components_by_hand() -> None:
    """Every vertex sees the hemisphere of its normal: in its frame the mean, H_l Y_l0(z), and the weights vanish."""
    mesh = icosphere(1)
    visibility = bake_transfer(mesh, 2, 16, glossy=True).visibility
    assert visibility is not None
    arrays = compress_visibility(visibility, mesh.normals, 1)
    np.testing.assert_allclose(arrays["visibility_mean"][[0, 2]], [np.sqrt(np.pi), np.sqrt(3 * np.pi) / 2], atol=1e-3)
    assert np.abs(arrays["visibility_weights"]).max() < 2e-3
    np.testing.assert_allclose(expand_visibility(arrays, mesh.normals), visibility, atol=3e-3)


def test_a_file_with_components_is_smaller_and_reads_as_visibility(tmp_path: Path) -> None:
    save_transfer(tmp_path / "whole.npz", bumpy())
    save_transfer(tmp_path / "small.npz", bumpy(), components=8)
    read = load_transfer(tmp_path / "small.npz")
    assert read.visibility is not None and read.visibility.shape == (len(bumpy().vertices), 25)
    assert read.metadata["compression"]["components"] == 8
    assert read.metadata["compression"]["relative_error"] == pytest.approx(_error(8), rel=1e-3)
    np.testing.assert_array_equal(read.coefficients, bumpy().coefficients)
    saved = (tmp_path / "whole.npz").stat().st_size - (tmp_path / "small.npz").stat().st_size
    left_out = 2 * (17 + 25) * len(bumpy().vertices)  # of 25 numbers 17, and the standard errors of all
    assert left_out - 4000 < saved < left_out
    plain = np.load(tmp_path / "small.npz")
    local = plain["visibility_mean"] + plain["visibility_weights"].astype(np.float32) @ plain["visibility_components"]
    world = rotate_coefficients(local, np.asarray(orthonormal_frame(plain["normals"])))
    np.testing.assert_allclose(np.delete(world, 7, 0), np.delete(read.visibility, 7, 0), atol=2e-3)


def test_what_does_not_fit_is_refused(tmp_path: Path) -> None:
    for components in (0, 26, 2.5):
        with pytest.raises(ValueError, match="use a whole number from 1 to 25"):
            save_transfer(tmp_path / "t.npz", bumpy(), components=components)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="the transfer has none: bake it with glossy=True"):
        save_transfer(tmp_path / "t.npz", bumpy()._replace(visibility=None), components=3)
    save_transfer(tmp_path / "t.npz", bumpy(), components=3)
    arrays = dict(np.load(tmp_path / "t.npz"))
    arrays.pop("visibility_mean")
    np.savez(tmp_path / "less.npz", **arrays)
    with pytest.raises(FileError, match="has no array 'visibility_mean'"):
        load_transfer(tmp_path / "less.npz")
    wrong = {**dict(np.load(tmp_path / "t.npz")), "visibility_components": np.zeros((3, 9), np.float32)}
    np.savez(tmp_path / "wrong.npz", **wrong)
    with pytest.raises(FileError, match="visibility_components"):
        load_transfer(tmp_path / "wrong.npz")
