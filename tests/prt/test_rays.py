"""Trace space and the ray offset: the same rays at any scale and place, no self-hit, no missed wall."""

import numpy as np
import pytest

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.geometry.primitives import box, icosphere, plane
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import MIN_OFFSET, ray_offset, trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import visibility


def _random_rotation(seed: int) -> np.ndarray:
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def test_trace_space_is_centred_and_of_unit_half_diagonal() -> None:
    mesh = transform(box((2.0, 4.0, 4.0)), np.eye(3), np.array([5.0, -7.0, 11.0]), 10.0)
    geometry = trace_geometry(mesh)
    np.testing.assert_allclose(geometry.vertices.max(0), [1 / 3, 2 / 3, 2 / 3], atol=1e-6)
    np.testing.assert_allclose(geometry.vertices.min(0), [-1 / 3, -2 / 3, -2 / 3], atol=1e-6)
    np.testing.assert_allclose(geometry.origins - geometry.vertices, geometry.offset * mesh.normals, atol=1e-7)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_scale_does_not_change_trace_space(scale: float) -> None:
    mesh = icosphere(2)
    scaled = transform(mesh, np.eye(3), np.zeros(3), scale)
    np.testing.assert_allclose(trace_geometry(scaled).vertices, trace_geometry(mesh).vertices, atol=5e-7)
    assert trace_geometry(scaled).offset == pytest.approx(MIN_OFFSET)


def test_offset_grows_with_the_distance_from_the_origin() -> None:
    near, far = icosphere(1), transform(icosphere(1), np.eye(3), np.array([1e5, 0, 0]), 1.0)
    assert ray_offset(near, 1.0) == MIN_OFFSET
    spacing = float(np.spacing(np.float32(1e5)))
    assert ray_offset(far, 1.0) == pytest.approx(4 * spacing, rel=1e-3)


def test_isolated_vertices_anywhere_do_not_disturb() -> None:
    mesh = icosphere(1)
    vertices = np.concatenate([mesh.vertices, [[1e30, 0, 0]]]).astype(np.float32)
    normals = np.concatenate([mesh.normals, [[0, 0, 0]]]).astype(np.float32)
    geometry = trace_geometry(Mesh(vertices, normals, mesh.faces))
    assert np.abs(geometry.vertices).max() < 1.01
    assert np.isfinite(geometry.origins).all()


def _self_hits(offset: float, seeds: range) -> int:
    """Rays of finely tessellated planes, turned at random, that meet their own plane when lifted by `offset`."""
    hits = 0
    for seed in seeds:
        mesh = transform(plane(2.0, 24), _random_rotation(seed), np.zeros(3), 1.0)
        geometry = trace_geometry(mesh)
        origins = (geometry.vertices + offset * mesh.normals.astype(np.float64)).astype(np.float32)
        shifts = np.random.default_rng(seed).random((len(origins), 1, 2), np.float32)
        rays = [np.asarray(a) for a in sample_rays(origins, orthonormal_frame(mesh.normals), shifts, 64)]
        hits += int((~visibility(geometry.vertices, geometry.faces)(*rays)).sum())
    return hits


def test_the_offset_is_large_enough_and_smaller_ones_are_not() -> None:
    """Both sides: no self-hit at the offset in use or at a quarter of it; without one, rounding makes them."""
    assert _self_hits(MIN_OFFSET, range(12)) == 0
    assert _self_hits(MIN_OFFSET / 4, range(12)) == 0
    assert _self_hits(0.0, range(12)) > 100


def test_the_offset_is_small_enough_for_crevices() -> None:
    """Two parallel squares 1e-4 of their size apart, facing each other, see only each other, at any scale."""
    for scale in (1e-3, 1.0, 1e3):
        gap = 2e-4
        corners = np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1], [0, 0, 0]], np.float64)
        vertices = np.concatenate([corners, corners + [0, gap, 0]]) * scale
        fan = np.array([[4, 0, 3], [4, 3, 2], [4, 2, 1], [4, 1, 0]])
        faces = np.concatenate([fan[:, ::-1], fan + 5])
        lower = np.tile([0.0, 1.0, 0.0], (5, 1))
        mesh, _ = prepare_mesh(vertices.astype(np.float32), faces.astype(np.int32))
        mesh = mesh._replace(normals=np.concatenate([lower, -lower]).astype(np.float32))
        baked = bake_transfer(mesh, rays=64, replicates=1).coefficients
        # the middles of both squares are dark: a hit is never skipped
        np.testing.assert_array_equal(baked[[4, 9]], 0.0)
