"""Shapes unlike those that networks are trained on: each is broken in its own way, and only that."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.broken import BROKEN, LOOSE, MOST_THROWN
from gash_jax.shapes.primitives import icosphere
from gash_jax.shapes.procedural import ALL_KINDS, make_shape
from gash_jax.shapes.triangles import signed_volume
from tests.helpers.recipes import closed

SPHERE = RawMesh(icosphere(8).vertices.astype(float), icosphere(8).faces.astype(np.int64))


def _broken(kind: str, seed: int) -> RawMesh:
    return BROKEN[kind](np.random.default_rng(seed), SPHERE)


def _areas(surface: RawMesh) -> np.ndarray:
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


@pytest.mark.parametrize("kind", BROKEN)
def test_the_same_again_and_finite(kind: str) -> None:
    for index in range(12):
        (name, mesh), (_, again) = (make_shape(3, index, (200, 900), "broken") for _ in range(2))
        np.testing.assert_array_equal(mesh.vertices, again.vertices)
        np.testing.assert_array_equal(mesh.faces, again.faces)
        assert name in BROKEN and len(mesh.faces) > 20 and np.isfinite(mesh.vertices).all()
    first, again, other = (_broken(kind, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.faces, again.faces)
    assert first.vertices.shape != other.vertices.shape or not np.array_equal(
        first.vertices[first.faces], other.vertices[other.faces]
    )


def test_none_is_a_kind_to_train_on() -> None:
    assert not set(BROKEN) & set(ALL_KINDS)
    assert {make_shape(0, index, (200, 300), "broken")[0] for index in range(len(BROKEN))} == set(BROKEN)


def test_loose_triangles_share_no_vertex() -> None:
    for kind in LOOSE:
        for seed in range(4):
            surface = _broken(kind, seed)
            np.testing.assert_array_equal(surface.faces.ravel(), np.arange(len(surface.vertices)))
    assert len(_broken("exploded", 0).faces) == len(SPHERE.faces)
    counts = [len(_broken("soup", seed).faces) for seed in range(20)]
    assert max(counts) <= MOST_THROWN and max(counts) > 4 * min(counts)
    # each where it was but for a little, and as large but for a factor
    ratio = _areas(_broken("exploded", 0)) / _areas(SPHERE)
    assert np.ptp(ratio) < 1e-9 and 0.49 <= ratio[0] <= 1.69


def test_panels_are_all_of_the_surface_in_pieces_that_have_moved() -> None:
    surface = _broken("panels", 0)
    np.testing.assert_allclose(np.sort(_areas(surface)), np.sort(_areas(SPHERE)), rtol=1e-9)
    assert len(surface.vertices) > len(SPHERE.vertices) and not closed(surface.faces)
    assert 0 < np.abs(np.linalg.norm(surface.vertices, axis=1) - 1).max() < 0.7


def test_holes_take_faces_and_move_nothing() -> None:
    shares = [len(_broken("holed", seed).faces) / len(SPHERE.faces) for seed in range(20)]
    assert 0.2 < min(shares) < 0.5 and 0.6 < max(shares) < 1
    np.testing.assert_allclose(np.linalg.norm(_broken("holed", 0).vertices, axis=1), 1, rtol=1e-6)


def test_noise_moves_vertices_by_part_of_an_edge() -> None:
    edge = np.median(np.linalg.norm(np.diff(SPHERE.vertices[SPHERE.faces[:, :2]], axis=1), axis=-1))
    moved = [float(np.std(_broken("noisy", seed).vertices - SPHERE.vertices)) / edge for seed in range(20)]
    assert 0.04 < min(moved) < 0.15 < 0.3 < max(moved) < 0.45


def test_flipped_faces_are_the_same_faces() -> None:
    volumes = [signed_volume(_broken("flipped", seed)) / signed_volume(SPHERE) for seed in range(20)]
    assert min(volumes) == pytest.approx(-1) and -0.9 < max(volumes) < 1
    assert np.array_equal(np.sort(_broken("flipped", 0).faces, axis=1), np.sort(SPHERE.faces, axis=1))


def test_stretched_is_longer_one_way() -> None:
    spans = np.array([np.ptp(_broken("stretched", seed).vertices, axis=0) for seed in range(20)])
    assert np.median(spans.max(axis=1) / spans.min(axis=1)) > 2 and closed(_broken("stretched", 0).faces)


def test_doubled_has_both_sides_of_every_face() -> None:
    for seed in range(6):
        surface = _broken("doubled", seed)
        half = len(surface.faces) // 2
        np.testing.assert_array_equal(surface.faces[half:], surface.faces[:half, ::-1])
        assert signed_volume(surface) == pytest.approx(0, abs=1e-9)
