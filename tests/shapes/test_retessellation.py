"""Refinement keeps the surface exactly, decimation nearly; closed stays closed, manifold stays manifold."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.lattices import lattice_surface
from gash_jax.shapes.parametric import flat_domain, revolved
from gash_jax.shapes.retessellation import collapse, jitter, refine, refine_regions, refine_to, relax
from gash_jax.shapes.triangles import face_normals, outward, signed_volume, unique_edges


def cube(cuts: int) -> RawMesh:
    spans = [np.linspace(-0.5, 0.5, cuts + 1)] * 3
    return lattice_surface(np.ones((cuts, cuts, cuts), bool), spans, np.random.default_rng(0))


def ball(count: int = 800) -> RawMesh:
    points = np.random.default_rng(1).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    hull = ConvexHull(points)
    a, b, c = points[hull.simplices].transpose(1, 0, 2)
    turned = np.einsum("fi,fi->f", np.cross(b - a, c - a), a) < 0
    return RawMesh(points, np.where(turned[:, None], hull.simplices[:, ::-1], hull.simplices).astype(np.int64))


def area(surface: RawMesh) -> float:
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def assert_closed_manifold(surface: RawMesh) -> None:
    edges = np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])
    keys, back = edges @ [10**6, 1], edges @ [1, 10**6]
    assert len(np.unique(keys)) == len(keys)
    np.testing.assert_array_equal(np.sort(keys), np.sort(back))


def test_refine_by_hand() -> None:
    triangle = RawMesh(np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]), np.array([[0, 1, 2]]))
    edges, _ = unique_edges(triangle.faces)
    np.testing.assert_array_equal(edges, [[0, 1], [0, 2], [1, 2]])
    split = refine(triangle, np.array([False, True, False]))
    np.testing.assert_array_equal(split.vertices[3], [0, 1, 0])
    assert {tuple(np.roll(face, -int(face.argmin()))) for face in split.faces} == {(0, 1, 3), (1, 2, 3)}


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 1.0])
def test_refine_keeps_area_volume_winding_and_closedness(share: float) -> None:
    surface = cube(3)
    edges, _ = unique_edges(surface.faces)
    marked = np.random.default_rng(2).random(len(edges)) < share
    split = refine(surface, marked)
    assert len(split.vertices) == len(surface.vertices) + marked.sum()
    assert_closed_manifold(split)
    assert signed_volume(split) == pytest.approx(1.0, abs=1e-12)
    assert area(split) == pytest.approx(6.0, abs=1e-12)


def test_refine_to_meets_the_count_and_evens_out_edges() -> None:
    slab = RawMesh(cube(1).vertices * [8.0, 1, 1], cube(1).faces)
    fine = refine_to(slab, 500)
    assert len(fine.vertices) == 500 and refine_to(fine, 100) is fine
    spread = np.linalg.norm(np.diff(fine.vertices[unique_edges(fine.faces)[0]], axis=1)[:, 0], axis=1)
    assert spread.max() < 4 * np.median(spread)
    skewed = refine_to(slab, 500, np.array([0.05, 1.0, 1.0]))
    steps = np.abs(np.diff(skewed.vertices[unique_edges(skewed.faces)[0]], axis=1)[:, 0])
    assert steps[:, 0].mean() > 8 * steps[:, 1].mean()


def test_refine_regions_adds_vertices_in_few_places() -> None:
    surface = ball(400)
    fine = refine_regions(surface, np.random.default_rng(3), 800)
    assert len(fine.vertices) == 800
    assert_closed_manifold(fine)
    crowd = np.linalg.norm(fine.vertices[400:, None] - fine.vertices[None, :400], axis=-1).min(axis=0)
    assert np.median(crowd) > 2 * crowd.min()  # most of the old vertices have no new one near


def test_collapse_keeps_a_closed_manifold_and_nearly_the_volume() -> None:
    surface = ball(1500)
    coarse = collapse(surface, np.random.default_rng(4), 900)
    assert len(coarse.vertices) == 900
    assert_closed_manifold(coarse)
    assert len(coarse.faces) == 2 * len(coarse.vertices) - 4  # Euler: still a sphere
    assert signed_volume(coarse) == pytest.approx(signed_volume(surface), rel=0.02)
    assert (np.einsum("fi,fi->f", face_normals(coarse), coarse.vertices[coarse.faces].mean(axis=1)) > 0).all()


def test_collapse_does_not_pinch_a_thin_tube() -> None:
    """Around a tube of three columns every edge has a third common neighbour: contracting it would pinch the tube."""
    profile = np.stack([np.full(80, 0.01), np.linspace(-2, 2, 80)], -1)
    tube = revolved(profile, 3, np.random.default_rng(0), poles=(True, True))
    coarse = collapse(tube, np.random.default_rng(1), 60)
    assert len(coarse.vertices) < len(tube.vertices)
    assert_closed_manifold(coarse)
    assert len(coarse.faces) == 2 * len(coarse.vertices) - 4


def test_collapse_spares_edges_of_a_cube_before_its_flats() -> None:
    coarse = collapse(cube(8), np.random.default_rng(5), 300)
    assert_closed_manifold(coarse)
    assert signed_volume(coarse) == pytest.approx(1.0, abs=0.01)


def test_collapse_leaves_boundary_vertices_alone() -> None:
    flat = flat_domain(np.random.default_rng(6), 400)
    coarse = collapse(flat, np.random.default_rng(7), 250)
    assert len(coarse.vertices) < len(flat.vertices)
    on_rim = ((flat.vertices[:, :2] == 0) | (flat.vertices[:, :2] == 1)).any(axis=1)
    kept = {tuple(point) for point in coarse.vertices}
    assert {tuple(point) for point in flat.vertices[on_rim]} <= kept
    assert area(coarse) == pytest.approx(1.0, abs=1e-9)


def test_relax_evens_triangles_and_stays_on_the_surface() -> None:
    surface = ball(600)
    smooth = relax(surface, 10)
    lengths = [
        np.linalg.norm(np.diff(s.vertices[unique_edges(s.faces)[0]], axis=1), axis=-1) for s in (surface, smooth)
    ]
    assert lengths[1].std() < 0.7 * lengths[0].std()
    assert np.abs(np.linalg.norm(smooth.vertices, axis=1) - 1).max() < 0.05


@pytest.mark.parametrize("seed", range(3))
def test_jitter_moves_vertices_along_the_surface_without_folding_it(seed: int) -> None:
    flat = flat_domain(np.random.default_rng(seed), 400)
    moved = jitter(flat, np.random.default_rng(8), 0.45)
    np.testing.assert_array_equal(moved.vertices[:, 2], 0.0)
    assert (face_normals(moved)[:, 2] > 0.99).all()
    still = (moved.vertices == flat.vertices).all(axis=1)
    on_rim = ((flat.vertices[:, :2] == 0) | (flat.vertices[:, :2] == 1)).any(axis=1)
    np.testing.assert_array_equal(still, on_rim)


def test_outward_turns_an_inverted_body() -> None:
    inverted = RawMesh(cube(2).vertices, cube(2).faces[:, ::-1])
    assert signed_volume(inverted) == pytest.approx(-1.0)
    assert signed_volume(outward(inverted)) == pytest.approx(1.0)
