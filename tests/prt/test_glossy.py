"""Glossy bakes: what they leave as it was, their integral, their error bars, their matrices, their file."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import hemisphere
from gash_jax.algebra.gaunt import gaunt_terms, product_matrices
from gash_jax.algebra.sh import band_index
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import transform
from gash_jax.measure.metrics import calibration
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bake_job import draw_shifts
from gash_jax.prt.glossy import bake_gloss, gloss_entries, glossy_matrices
from gash_jax.prt.plan import plan_bake
from gash_jax.prt.tracing import Rows
from gash_jax.prt.transfer import Transfer, load_transfer, save_transfer
from gash_jax.shapes.primitives import bumpy_sphere, icosphere
from tests.helpers.bumpy import random_rotation
from tests.helpers.gloss import half_sphere, harmonics
from tests.helpers.random_rows import random_rows

HALF = 2.0**-11  # relative rounding of float16


@cache
def bumpy() -> Transfer:
    """A glossy bake, one vertex without a normal."""
    mesh = bumpy_sphere(8)
    normals = mesh.normals.copy()
    normals[7] = 0
    return bake_transfer(mesh._replace(normals=normals), rays=64, glossy=True, seed=3)


def hemispheres(normals: np.ndarray, bands: int) -> np.ndarray:
    """H_l Y_lm(n) in 2 bands - 1 bands."""
    high = 2 * bands - 1
    return harmonics(normals, high) * np.array([hemisphere(int(band)) for band in band_index(high)])


def beside_a_wall(origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Free are the directions on one side of a slanted plane through the origin."""
    return directions @ np.array([0.6, 0.48, 0.64], np.float32) > 0.1


@cache
def seen_beside_a_wall(bands: int) -> np.ndarray:
    """The same visibility of the vertices of `wall_bake` by quadrature in float64, in 2 bands - 1 bands."""
    parts = []
    for normal in random_rows(12, 1, seed=5)[1][..., 2].astype(np.float64):
        w, area = half_sphere(normal, 200)
        parts.append((area * beside_a_wall(w, w.astype(np.float32))) @ harmonics(w, 2 * bands - 1))
    return np.array(parts)


def wall_bake(bands: int, rays: int, replicates: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Visibility and standard errors of 12 vertices beside the wall; zeros without replicates."""
    rows = Rows(*random_rows(12, 1, seed=5))
    rows = rows._replace(shifts=draw_shifts(seed, 12, replicates, 0, 12))
    found, error = bake_gloss(rows, bands, rays, beside_a_wall)
    return found, np.zeros_like(found) if error is None else error


def test_diffuse_coefficients_are_those_of_a_bake_that_is_not_glossy() -> None:
    glossy, mesh = bumpy(), bumpy().mesh
    plain = bake_transfer(mesh, rays=64, seed=3)
    np.testing.assert_array_equal(glossy.coefficients, plain.coefficients)
    assert glossy.standard_error is not None and plain.standard_error is not None
    np.testing.assert_array_equal(glossy.standard_error, plain.standard_error)
    assert plain.visibility is None and "visibility" not in plain.metadata
    assert glossy.metadata["rays_total"] == 2 * plain.metadata["rays_total"]
    assert glossy.visibility is not None and glossy.visibility.shape == (len(mesh.vertices), 25)
    assert not np.any(glossy.visibility[7]) and np.all(np.any(glossy.visibility[:7], axis=1))


def test_rows_are_those_of_the_whole_bake() -> None:
    whole = bumpy()
    some = bake_transfer(whole.mesh, rays=64, glossy=True, seed=3, rows=slice(5, 90))
    assert whole.visibility is not None
    np.testing.assert_array_equal(some.visibility, whole.visibility[5:90])
    nothing = bake_transfer(whole.mesh, rays=64, glossy=True, seed=3, rows=slice(7, 8))
    assert not np.any(nothing.visibility) and "visibility" not in nothing.metadata


def test_progress_counts_both_passes() -> None:
    told: list[tuple[int, int]] = []
    mesh = icosphere(1)
    bake_transfer(mesh, rays=16, glossy=True, progress=lambda done, total: told.append((done, total)))
    assert told == [(42, 84), (84, 84)]


@pytest.mark.parametrize("bands", [1, 3, 4])
def test_a_convex_body_has_the_hemispheres_matrices(bands: int) -> None:
    """Every ray is free, so the blend is the formula, but for float16."""
    mesh = icosphere(2)
    baked = bake_transfer(mesh, bands, 64, glossy=True)
    expected = hemispheres(mesh.normals, bands)
    assert baked.visibility is not None and baked.visibility.dtype == np.float16
    np.testing.assert_allclose(baked.visibility, expected, rtol=HALF, atol=2e-6)
    matrices = np.asarray(glossy_matrices(baked))
    np.testing.assert_allclose(matrices, product_matrices(expected.astype(np.float32)), atol=HALF)
    np.testing.assert_allclose(matrices, matrices.swapaxes(1, 2), atol=1e-6)
    w, area = half_sphere(mesh.normals[0].astype(np.float64))
    basis = harmonics(w, bands)
    np.testing.assert_allclose(matrices[0], basis.T @ (area[:, None] * basis), atol=2 * HALF)


def test_visibility_beside_a_wall_is_its_integral_within_its_error_bars() -> None:
    """Rms z-score 0.8 to 1.25 over 24 seeds, 95 % intervals of Student's t; known bad: coefficients 5 % too large."""
    bands = 3
    exact = seen_beside_a_wall(bands)
    bakes = [wall_bake(bands, 256, 4, seed) for seed in range(24)]
    errors = np.array([found - exact for found, _ in bakes], np.float64)
    claimed = np.array([error for _, error in bakes], np.float64)
    score = np.sqrt(np.mean(errors**2) / np.mean(claimed**2))
    assert 0.8 < score < 1.25
    assert np.mean(np.abs(errors) < 3.182 * claimed) == pytest.approx(0.95, abs=0.04)
    # the mean over seeds, against its own scatter
    scatter = errors.std(0, ddof=1) / np.sqrt(len(errors))
    assert np.sqrt(np.mean(errors.mean(0) ** 2) / np.mean(scatter**2)) < 1.25
    assert np.sqrt(np.mean((errors.mean(0) + 0.05 * exact) ** 2) / np.mean(scatter**2)) > 1.25


def test_the_errors_in_a_bake_are_those_of_its_visibility() -> None:
    """Against 4096 rays, bumps among themselves: rms z 0.8 to 1.25, 95 % intervals. Known bad: of half the errors."""
    mesh = bumpy().mesh
    fine = bake_transfer(mesh, rays=4096, glossy=True, seed=99)
    assert fine.visibility is not None and fine.visibility_error is not None
    bakes = [bake_transfer(mesh, rays=128, glossy=True, seed=seed) for seed in range(3)]
    shadowed = np.any(fine.visibility_error > 1e-3, axis=1)
    assert shadowed.sum() > 100
    errors, claimed = [], []
    for baked in bakes:
        assert baked.visibility is not None and baked.visibility_error is not None
        assert baked.visibility_error.dtype == np.float16
        said = baked.metadata["visibility"]["standard_error_rms"]
        usable = np.any(mesh.normals != 0, axis=1)
        stored = baked.visibility_error.astype(np.float64)
        assert np.sqrt(np.mean(stored[usable] ** 2)) == pytest.approx(said, rel=1e-3) and not np.any(stored[7])
        errors.append((baked.visibility.astype(np.float64) - fine.visibility)[shadowed])
        claimed.append(stored[shadowed])
    score, covered = calibration(np.concatenate(errors), np.concatenate(claimed))
    assert 0.8 < score < 1.25 and 0.92 < covered < 0.99
    assert not 0.8 < calibration(np.concatenate(errors), np.concatenate(claimed) / 2)[0] < 1.25
    plain = bake_transfer(mesh, rays=16, replicates=1, glossy=True)
    assert plain.visibility is not None and plain.visibility_error is None


def test_the_plain_estimate_has_matrices_of_a_projection() -> None:
    """Sums of V Y Y^T: no eigenvalue below zero; the largest is right within its error, which falls with the rays.

    An error of the visibility moves no eigenvalue by more than the norm of the matrix that it makes.
    """
    size = np.sqrt(np.sum(gaunt_terms(3).value ** 2))
    exact = np.linalg.eigvalsh(np.asarray(product_matrices(seen_beside_a_wall(3))))
    assert exact.min() > -2e-5 and exact.max() < 1
    off = []
    for rays in (64, 512, 4096):
        found = wall_bake(3, rays, 1, 0)[0].astype(np.float16).astype(np.float32)
        values = np.linalg.eigvalsh(np.asarray(product_matrices(found)))
        assert values.min() >= -1e-3
        claimed = np.sqrt(np.mean(wall_bake(3, rays, 4, 0)[1] ** 2))
        off.append(float(np.abs(values[:, -1] - exact[:, -1]).max()))
        assert off[-1] < size * claimed
        assert values[:, -1].max() < 1 + size * claimed
    assert off[0] > 2 * off[1] > 4 * off[2]
    # known bad: the blend is no sum of squares
    blend = wall_bake(3, 64, 4, 0)[0]
    assert np.linalg.eigvalsh(np.asarray(product_matrices(blend))).min() < -1e-3


def test_visibility_turns_with_the_mesh() -> None:
    """Rays of their own frames: within the error bars of both, D(R) v."""
    rotation = random_rotation(2).astype(np.float32)
    plain = bumpy()
    turned = bake_transfer(transform(plain.mesh, rotation), rays=64, glossy=True, seed=4)
    assert plain.visibility is not None and turned.visibility is not None
    expected = np.asarray(rotate_coefficients(plain.visibility.astype(np.float32), rotation))
    apart = np.sqrt(np.mean((turned.visibility - expected) ** 2))
    claimed = np.hypot(*(b.metadata["visibility"]["standard_error_rms"] for b in (plain, turned)))
    assert 0.6 * claimed < apart < 1.2 * claimed  # the floor of the errors is a bound
    unturned = np.sqrt(np.mean((turned.visibility - plain.visibility.astype(np.float32)) ** 2))
    assert unturned > 5 * claimed


def test_metadata_says_what_rounding_and_rays_cost() -> None:
    values = np.array([[1.0, 0.5 + 2.0**-13, 0], [2.0, 0.25, 0]], np.float32)
    error = np.full((2, 3), 0.1, np.float32)
    found = gloss_entries(values, error)
    assert found["rounding_largest"] == 2.0**-13 and found["dtype"] == "float16"
    assert found["rounding_rms"] == pytest.approx(2.0**-13 / np.sqrt(6))
    size = np.sqrt(np.mean(values.astype(np.float64) ** 2))
    assert found["standard_error_rms"] == pytest.approx(0.1)
    assert found["relative_error"] == pytest.approx(0.1 / size)
    assert set(gloss_entries(values, None)) == {"dtype", "rounding_rms", "rounding_largest"}
    baked = bumpy().metadata["visibility"]
    assert 0.02 < baked["relative_error"] < 0.2 and baked["rounding_largest"] <= HALF < baked["standard_error_rms"]


def test_a_file_holds_it_in_half_precision_and_the_plan_knows_its_size(tmp_path: Path) -> None:
    save_transfer(tmp_path / "t.npz", bumpy())
    read = load_transfer(tmp_path / "t.npz")
    assert read.visibility is not None and read.visibility.dtype == np.float16
    np.testing.assert_array_equal(read.visibility, bumpy().visibility)
    np.testing.assert_array_equal(read.visibility_error, bumpy().visibility_error)
    np.testing.assert_array_equal(glossy_matrices(read), glossy_matrices(bumpy()))
    planned = plan_bake(bumpy().mesh, 0.1, glossy=True)
    size = (tmp_path / "t.npz").stat().st_size
    assert planned.bytes <= size <= planned.bytes + 16384
    alone = plan_bake(bumpy().mesh, 0.1)
    assert planned.rays_total == pytest.approx(2 * alone.rays_total, rel=0.01)
    assert planned.bytes - alone.bytes == 2 * 50 * len(bumpy().vertices)


def test_what_is_not_glossy_has_no_matrices() -> None:
    with pytest.raises(ValueError, match="bake it with glossy=True"):
        glossy_matrices(bumpy()._replace(visibility=None))
    held = np.random.default_rng(0).normal(size=(len(bumpy().vertices), 9, 9)).astype(np.float16)
    np.testing.assert_array_equal(glossy_matrices(bumpy()._replace(matrices=held)), held.astype(np.float32))
