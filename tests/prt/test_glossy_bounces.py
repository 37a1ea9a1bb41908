"""Glossy transfer with light that bounces: ray by ray, the integrating sphere, albedo 0, what has no room."""

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import hemisphere
from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.sh import band_index
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.bake_job import draw_shifts
from gash_jax.prt.glossy import glossy_matrices
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import UNIFORM, sample_rays
from gash_jax.prt.visibility import closest_hit
from gash_jax.shapes.primitives import bumpy_sphere, spherical_bowl
from tests.helpers.gloss import harmonics


def test_matrices_are_their_sums_over_rays() -> None:
    """Every ray by itself: 2 pi / n of Y_i Y_j where it is free, of Y_i times what it finds on a front elsewhere."""
    mesh, albedo, rays = bumpy_sphere(5), 0.7, 32
    baked = bake_transfer(mesh, 3, rays, bounces=1, albedo=albedo, glossy=True, replicates=1, seed=2)
    direct = bake_transfer(
        mesh, 3, rays, replicates=1, seed=2
    ).coefficients  # light that bounced once was direct before
    geometry, count = trace_geometry(mesh), len(mesh.vertices)
    shifts = draw_shifts(np.random.SeedSequence(2, spawn_key=(1,)), count, 1, 0, count)
    frames = np.asarray(orthonormal_frame(mesh.normals), np.float32)
    origins, w = (np.asarray(a) for a in sample_rays(geometry.origins, frames, shifts, rays, density=UNIFORM))
    hits = closest_hit(geometry.vertices, geometry.faces, "jax")(origins, w)
    corners = mesh.faces[np.maximum(hits.face, 0)]
    weights = np.stack([1 - hits.u - hits.v, hits.u, hits.v], axis=1)
    a, b, c = (mesh.vertices[corners[:, i]].astype(np.float64) for i in range(3))
    front = np.einsum("ri,ri->r", np.cross(b - a, c - a), w) < 0  # the faces are wound outwards, as the normals are
    found = albedo * np.einsum("rj,rjk->rk", weights, direct[corners]) * ((hits.face >= 0) & front)[:, None]
    basis = harmonics(w, 3)
    arriving = np.where((hits.face < 0)[:, None], basis, found)
    expected = np.einsum("vni,vnj->vij", *(x.reshape(count, rays, 9) for x in (basis, arriving))) * 2 * np.pi / rays
    apart = np.abs(np.asarray(glossy_matrices(baked)) - expected).max(axis=(1, 2))
    assert (apart < 1e-3).mean() > 0.97  # but for rays that graze an edge
    assert np.abs(np.asarray(baked.matrices) - np.asarray(baked.matrices).swapaxes(1, 2)).max() > 0.02


@pytest.mark.parametrize(("bounces", "albedo"), [(1, 0.5), (4, 0.8)])
def test_walls_of_an_integrating_sphere_shine_evenly(bounces: int, albedo: float) -> None:
    """Under constant light 1 every wall sends c = a f sum_(q < n) (a (1-f))^q, so M L is v + c (H - v)."""
    opening = np.radians(70)
    mesh = spherical_bowl(opening, 12)
    share = (1 - np.cos(opening)) / 2
    sent = albedo * share * sum((albedo * (1 - share)) ** q for q in range(bounces))
    baked = bake_transfer(mesh, 3, 256, bounces=bounces, albedo=albedo, glossy=True)
    seen = bake_transfer(mesh, 3, 256, glossy=True).visibility  # the same uniform rays
    assert baked.matrices is not None and baked.visibility is None and seen is not None
    factors = np.array([hemisphere(int(band)) for band in band_index(3)])
    whole = harmonics(mesh.normals, 3) * factors
    light = 2 * np.sqrt(np.pi)
    arriving = np.asarray(glossy_matrices(baked))[:, :, 0] * light
    wanted = seen[:, :9] + sent * (whole - seen[:, :9])
    error = arriving - wanted
    assert np.abs(error.mean(0)).max() < 0.01 * np.sqrt(np.pi)
    assert np.sqrt(np.mean(error**2)) < 0.03 * np.sqrt(np.pi)
    # known bad: one bounce less
    less = albedo * share * sum((albedo * (1 - share)) ** q for q in range(bounces - 1))
    assert np.abs((arriving - (seen[:, :9] + less * (whole - seen[:, :9]))).mean(0)).max() > 0.01 * np.sqrt(np.pi)


def test_black_surfaces_send_nothing_back() -> None:
    mesh = bumpy_sphere(5)
    black = bake_transfer(mesh, 2, 64, bounces=2, albedo=0, glossy=True)
    plain = bake_transfer(mesh, 2, 64, glossy=True)
    np.testing.assert_allclose(glossy_matrices(black), glossy_matrices(plain), atol=2e-3)
    matrices = np.asarray(black.matrices, np.float32)
    np.testing.assert_array_equal(matrices, matrices.swapaxes(1, 2))


def test_rows_points_and_occluders() -> None:
    mesh = bumpy_sphere(5)
    whole = bake_transfer(mesh, 2, 32, bounces=1, albedo=0.5, glossy=True)
    assert whole.matrices is not None and whole.metadata["matrices"]["relative_error"] > 0
    some = bake_transfer(mesh, 2, 32, bounces=1, albedo=0.5, glossy=True, rows=slice(20, 40))
    np.testing.assert_array_equal(some.matrices, whole.matrices[20:40])
    alone = bake_transfer(mesh, 2, 32, glossy=True)
    probes = bake_transfer(mesh, 2, 32, glossy=True, points=mesh.vertices, normals=mesh.normals)
    assert probes.visibility is not None and alone.visibility is not None
    np.testing.assert_array_equal(probes.visibility, alone.visibility)


def test_coloured_reflections_are_refused_in_one_line() -> None:
    with pytest.raises(ValueError, match="no room for coloured reflections: give a grey albedo") as caught:
        bake_transfer(bumpy_sphere(3), rays=16, bounces=1, albedo=[0.5, 0.4, 0.3], glossy=True)
    assert "\n" not in str(caught.value)
