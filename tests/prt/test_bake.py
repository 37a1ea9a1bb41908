"""The bake against closed forms, its own laws, and its error bars."""

from itertools import pairwise

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import transform
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bake_job import choose_replicates
from gash_jax.prt.error_bars import standard_error_floor
from gash_jax.shapes.primitives import bumpy_sphere, icosphere, spherical_bowl, v_groove

ROOT = 0.28209479177387814  # Y_00


@pytest.mark.parametrize("backend", ["embree", "jax"])
def test_convex_body_is_unshadowed(backend: str) -> None:
    mesh = icosphere(2)
    baked = bake_transfer(mesh, bands=4, rays=256, replicates=1, backend=backend).coefficients
    exact = np.asarray(unshadowed_transfer(mesh.normals, 4))
    np.testing.assert_allclose(baked[:, 0], ROOT, atol=1e-6)  # every ray is free
    assert np.sqrt(np.mean((baked - exact) ** 2)) < 2e-3


@pytest.mark.parametrize(("backend", "rays"), [("embree", 256), ("jax", 64)])
def test_spherical_cavity(backend: str, rays: int) -> None:
    """Ambient occlusion (1 - cos a)/2 at every vertex of a bowl with opening half-angle a."""
    opening = np.radians(60)
    mesh = spherical_bowl(opening, 10)
    baked = bake_transfer(mesh, bands=1, rays=rays, backend=backend)
    assert baked.standard_error is not None
    found = baked.coefficients[:, 0] / ROOT
    # the tessellated bowl lies inside the sphere and its rim is a polygon: under half a per cent of the sky
    assert abs(found.mean() - (1 - np.cos(opening)) / 2) < 0.005


def test_groove() -> None:
    """AO = sin²(w/2) everywhere on the faces of an infinite groove of opening w."""
    opening = np.radians(70)
    mesh = v_groove(opening, 400.0, 12)
    baked = bake_transfer(mesh, bands=1, rays=1024)
    middle = np.abs(mesh.vertices[:, 1]) < 1.0
    inner = middle & (np.linalg.norm(mesh.vertices[:, [0, 2]], axis=1) > 0.05)
    inner &= (
        np.linalg.norm(mesh.vertices[:, [0, 2]], axis=1) < 0.5 * np.linalg.norm(mesh.vertices[:, [0, 2]], axis=1).max()
    )
    assert inner.sum() > 5
    assert baked.coefficients[inner, 0].mean() / ROOT == pytest.approx(np.sin(opening / 2) ** 2, abs=0.01)


def test_rotated_mesh_has_rotated_transfer() -> None:
    mesh = bumpy_sphere(24)
    q, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    rotation = (q * np.sign(np.linalg.det(q))).astype(np.float32)
    plain = bake_transfer(mesh, rays=1024)
    turned = bake_transfer(transform(mesh, rotation, np.array([3.0, -2, 7]), 40.0), rays=1024)
    expected = np.asarray(
        rotate_coefficients(plain.coefficients, np.broadcast_to(rotation, (len(mesh.vertices), 3, 3)))
    )
    difference = turned.coefficients - expected
    assert plain.standard_error is not None and turned.standard_error is not None
    sigma = np.sqrt(plain.standard_error**2 + turned.standard_error**2)
    assert np.sqrt(np.mean(difference**2)) < 1.3 * np.sqrt(np.mean(sigma**2))


def test_result_does_not_depend_on_chunks_or_repeats(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = bumpy_sphere(16)
    first = bake_transfer(mesh, rays=64, seed=5).coefficients
    np.testing.assert_array_equal(first, bake_transfer(mesh, rays=64, seed=5).coefficients)
    monkeypatch.setattr("gash_jax.prt.tracing.RAYS_PER_CHUNK", 4096)
    np.testing.assert_allclose(first, bake_transfer(mesh, rays=64, seed=5).coefficients, atol=1e-6)
    assert np.any(first != bake_transfer(mesh, rays=64, seed=6).coefficients)


def test_standard_error_predicts_the_error() -> None:
    mesh = bumpy_sphere(10)
    reference = bake_transfer(mesh, rays=16384, seed=1).coefficients
    for rays in (64, 256):
        baked = bake_transfer(mesh, rays=rays, seed=2)
        assert baked.standard_error is not None
        actual = np.sqrt(np.mean((baked.coefficients - reference) ** 2))
        claimed = np.sqrt(np.mean(baked.standard_error**2))
        assert 0.8 < claimed / actual < 1.3
        part = np.full(len(mesh.vertices), 0.5)
        assert np.all(baked.standard_error >= standard_error_floor(3, rays, part) * (1 - 1e-6))


def test_replicates_by_hand() -> None:
    assert choose_replicates(256, None) == 4
    assert choose_replicates(15, None) == 1
    assert choose_replicates(256, 2) == 2
    with pytest.raises(ValueError, match="use 96 or 100|use 248 or 252"):
        choose_replicates(250, 4)
    for rays, replicates in ((0, None), (2**21, None), (8, 9), (8, 0)):
        with pytest.raises(ValueError, match="use a whole number|must be"):
            choose_replicates(rays, replicates)


def test_plain_bake_has_no_standard_error_and_counts_its_rays() -> None:
    mesh = icosphere(1)
    baked = bake_transfer(mesh, rays=32, replicates=1)
    assert baked.standard_error is None
    assert baked.metadata["rays_total"] == 32 * len(mesh.vertices)
    assert baked.metadata["seconds"]["total"] > 0


def test_vertices_without_normal_get_zero() -> None:
    mesh = icosphere(1)
    normals = mesh.normals.copy()
    normals[[0, 5]] = 0
    baked = bake_transfer(mesh._replace(normals=normals), rays=32)
    assert baked.standard_error is not None
    assert not baked.coefficients[[0, 5]].any() and not baked.standard_error[[0, 5]].any()
    assert (baked.coefficients[[1, 2, 3], 0] > 0.28).all()
    dark = bake_transfer(mesh._replace(normals=np.zeros_like(normals)), rays=32)
    assert not dark.coefficients.any()


def _counts_up(seen: list[tuple[int, int]], total: int) -> bool:
    """Whether counts rise with every call, all out of the total, and end there."""
    done = [0, *(count for count, _ in seen)]
    rises = all(earlier < later for earlier, later in pairwise(done))
    return rises and done[-1] == total and {of for _, of in seen} == {total}


def test_progress_counts_up_to_the_end() -> None:
    """Chunks end in any order, in several threads; what is told of them is in order all the same."""
    seen: list[tuple[int, int]] = []
    mesh = icosphere(3)
    count = len(mesh.vertices)
    bake_transfer(mesh, rays=1024, progress=lambda done, total: seen.append((done, total)))
    assert len(seen) > 3 and _counts_up(seen, count)
    swapped = [seen[1], seen[0], *seen[2:]]
    for bad in (swapped, seen[::-1], seen[:-1], [seen[0], *seen], [], [(done, done) for done, _ in seen]):
        assert not _counts_up(bad, count)


def test_bands_out_of_range() -> None:
    for bands in (0, 11):
        with pytest.raises(ValueError, match="bands"):
            bake_transfer(icosphere(0), bands=bands)
