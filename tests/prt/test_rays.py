"""Trace space and the ray offset: the same rays at any scale and place, no self-hit, no missed wall."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import MAX_LIFT, MIN_OFFSET, ray_offset, sliver_lifts, trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import visibility
from gash_jax.shapes.primitives import box, bumpy_sphere, grid, icosphere, plane, uv_sphere


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
    far = transform(icosphere(1), np.eye(3), np.array([1e5, 0, 0]), 1.0)
    spacing = float(np.spacing(np.float32(1e5)))
    assert ray_offset(1.0, 1.0) == MIN_OFFSET
    assert ray_offset(1e5, 1.0) == pytest.approx(4 * spacing, rel=1e-3)
    # half the diagonal of the sphere's box is nearly sqrt(3)
    assert trace_geometry(far).offset == pytest.approx(4 * spacing / np.sqrt(3), rel=0.05)
    loose = far._replace(vertices=np.concatenate([far.vertices, np.full((1, 3), 1e30, np.float32)]))
    loose = loose._replace(normals=np.concatenate([far.normals, np.zeros((1, 3), np.float32)]))
    assert trace_geometry(loose).offset == trace_geometry(far).offset


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


def _own_hits(mesh: Mesh, lifted: bool) -> int:
    """Rays of a convex body or a flat sheet, 128 per vertex, that meet it; `lifted` by `trace_geometry` or evenly."""
    geometry = trace_geometry(mesh)
    even = geometry.vertices + geometry.offset * mesh.normals.astype(np.float64)
    origins = geometry.origins if lifted else even.astype(np.float32)
    shifts = np.random.default_rng(5).random((len(origins), 1, 2), np.float32)
    rays = [np.asarray(a) for a in sample_rays(origins, orthonormal_frame(mesh.normals), shifts, 128)]
    return int((~visibility(geometry.vertices, geometry.faces)(*rays)).sum())


def _sheet(aspect: float, seed: int) -> Mesh:
    """A flat sheet of random slivers, turned at random."""
    rng, turn = np.random.default_rng(seed), _random_rotation(seed)
    u, w, faces = grid(4, 4)
    u, w = (t + rng.uniform(-0.05, 0.05, t.shape) for t in (u, w))
    points = np.stack([u, w / aspect, 0 * u], axis=1) @ turn.T
    normals = np.tile(turn[:, 2], (len(points), 1))
    return Mesh(points.astype(np.float32), normals.astype(np.float32), faces.astype(np.int32))


def _body(stretch: float, seed: int) -> Mesh:
    """The convex hull of 40 points of a ball's surface, drawn out and turned at random."""
    points = np.random.default_rng(seed).normal(size=(40, 3))
    points *= [1 / stretch, 1, 1 / stretch] / np.linalg.norm(points, axis=1, keepdims=True)
    points = (points @ _random_rotation(seed).T).astype(np.float32)
    return prepare_mesh(points, ConvexHull(points.astype(np.float64)).simplices.astype(np.int32))[0]


@pytest.mark.parametrize("aspect", [1e2, 1e3, 1e4, 1e5])
def test_slivers_do_not_shadow_themselves(aspect: float) -> None:
    """Of 10 flat sheets not one ray is lost, of 51200 of 10 convex bodies 3 at most; lifted evenly, many are."""
    sheets, bodies = [_sheet(aspect, seed) for seed in range(10)], [_body(aspect, seed) for seed in range(10)]
    assert sum(_own_hits(mesh, True) for mesh in sheets) == 0
    assert sum(_own_hits(mesh, True) for mesh in bodies) <= 3
    if aspect > 3e3:
        assert sum(_own_hits(mesh, False) for mesh in sheets) >= 30
        assert sum(_own_hits(mesh, False) for mesh in bodies) >= 200


@pytest.mark.parametrize("make", [lambda: bumpy_sphere(32), lambda: uv_sphere(30, 60), lambda: box((1.0, 3.0, 2.0), 9)])
def test_ordinary_meshes_are_lifted_evenly(make) -> None:
    mesh = make()
    mesh = transform(mesh, _random_rotation(1), np.zeros(3), 1.0)
    geometry = trace_geometry(mesh)
    assert geometry.offset == MIN_OFFSET
    assert sliver_lifts(geometry.vertices, geometry.faces).max() < MIN_OFFSET / 2
    even = geometry.vertices + MIN_OFFSET * mesh.normals.astype(np.float64)
    np.testing.assert_allclose(geometry.origins, even, rtol=0, atol=1.2e-7)


def test_lift_of_one_sliver_by_hand() -> None:
    """Twice u times the products of the worst two edges, weighted by the extents, over twice the area."""
    corners = np.array([[0, 0, 0], [128, 64, 64], [64, 33, 32]], np.float32) / 128
    # the edges (128, 64, 64), (64, 31, 32), (64, 33, 32) over 128: the worst |a_j b_k| + |a_k b_j| for each i
    worst = np.array([4160.0, 8192.0, 8320.0]) / 128**2
    extents = np.array([128.0, 64.0, 64.0]) / 128
    twice_area = np.linalg.norm(np.cross([128, 64, 64], [64, 33, 32])) / 128**2
    lifts = sliver_lifts(corners, np.array([[0, 1, 2]]))
    np.testing.assert_allclose(lifts, 2 * 2.0**-24 * worst @ extents / twice_area, rtol=1e-12)


def test_lifts_are_the_largest_of_the_faces_capped_and_none_without_area() -> None:
    tilted = np.array([[-0.6, -0.5, -0.4], [0.6, 0.5, 0.4], [0, 0, 0], [0.5, -0.6, 0.1], [0.3, 0.3, -0.9]])
    vertices = tilted.astype(np.float32)
    fat, flat = [0, 3, 4], [0, 2, 1]
    for height, expected in ((1e-2, None), (1e-6, MAX_LIFT), (0.0, 0.0)):
        vertices[2] = height * np.array([0.5, -0.6, 0.0])
        lifts = sliver_lifts(vertices, np.array([fat, flat]))
        alone = [sliver_lifts(vertices, np.array([face])) for face in (fat, flat)]
        np.testing.assert_array_equal(lifts, np.maximum(*alone))
        assert lifts.max() <= MAX_LIFT
        if expected is not None:
            assert alone[1][[0, 2, 1]] == pytest.approx(expected)
        assert not alone[0].any()


def test_slivers_along_the_axes_are_not_lifted() -> None:
    """Their cross products round to themselves: CAD models in the axes' directions keep the plain offset."""
    geometry = trace_geometry(transform(_sheet_along_axes(1e5), np.eye(3), np.zeros(3), 1.0))
    assert sliver_lifts(geometry.vertices, geometry.faces).max() < MIN_OFFSET
    assert _own_hits(_sheet_along_axes(1e5), True) == 0


def _sheet_along_axes(aspect: float) -> Mesh:
    u, w, faces = grid(4, 4)
    points = np.stack([u, w / aspect, 0 * u], axis=1).astype(np.float32)
    return Mesh(points, np.tile(np.array([0, 0, 1], np.float32), (len(points), 1)), faces.astype(np.int32))
