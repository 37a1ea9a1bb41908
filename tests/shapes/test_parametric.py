"""Swept surfaces: closed where they should be, outward, with the volume of the body they stand for."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import RawMesh
from gash_jax.shapes.parametric import flat_domain, grid_shape, revolved, spacing, sphere_points, swept, tube
from gash_jax.shapes.triangles import face_normals, signed_volume


def is_closed(surface: RawMesh) -> bool:
    edges = np.concatenate([surface.faces[:, [0, 1]], surface.faces[:, [1, 2]], surface.faces[:, [2, 0]]])
    return bool(np.array_equal(np.sort(edges @ [10**6, 1]), np.sort(edges @ [1, 10**6])))


@pytest.mark.parametrize("seed", range(4))
def test_revolved_cylinder_is_closed_and_outward(seed: int) -> None:
    profile = np.stack([np.full(9, 0.5), np.linspace(-1, 1, 9)], -1)
    body = revolved(profile, 200, np.random.default_rng(seed), poles=(True, True))
    assert is_closed(body) and len(body.vertices) == 9 * 200 + 2
    assert signed_volume(body) == pytest.approx(np.pi / 2, rel=1e-3)
    open_body = revolved(profile, 200, np.random.default_rng(seed))
    assert not is_closed(open_body)
    assert (np.einsum("fi,fi->f", face_normals(open_body), open_body.vertices[open_body.faces[:, 0]]) > 0).all()


def test_columns_run_from_z_to_x() -> None:
    body = revolved(np.array([[1.0, 0.0], [1.0, 1.0]]), 4, np.random.default_rng(0))
    np.testing.assert_allclose(body.vertices[:4], [[0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-15)


@pytest.mark.parametrize("closed", [True, False])
def test_tube_volume_is_section_times_length(closed: bool) -> None:
    s = 2 * np.pi * np.arange(160) / 160 if closed else np.linspace(0, np.pi, 160)
    curve = np.stack([np.cos(s), 0 * s, np.sin(s)], -1)
    body = tube(
        curve, np.full((160, 64), 0.1), np.broadcast_to([0.0, 1, 0], curve.shape), np.random.default_rng(0), closed
    )
    length = 2 * np.pi if closed else np.pi
    assert is_closed(body)
    assert signed_volume(body) == pytest.approx(np.pi * 0.01 * length, rel=0.02)


def test_spheres_of_every_style_are_closed_unit_and_outward() -> None:
    counts = []
    for seed in range(20):
        ball = sphere_points(np.random.default_rng(seed), 700)
        counts.append(len(ball.vertices))
        assert is_closed(ball)
        np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 1.0, atol=1e-12)
        assert 0.9 < signed_volume(ball) / (4 * np.pi / 3) < 1.0
        middles = ball.vertices[ball.faces].mean(axis=1)
        assert (np.einsum("fi,fi->f", face_normals(ball), middles) >= 0).all()
    assert len(set(counts)) > 1 and min(counts) > 600 and max(counts) < 800


@pytest.mark.parametrize("seed", range(6))
def test_flat_domain_covers_the_unit_square_facing_up(seed: int) -> None:
    flat = flat_domain(np.random.default_rng(seed), 500, 0.7)
    a, b, c = flat.vertices[flat.faces].transpose(1, 0, 2)
    area = 0.5 * np.cross(b - a, c - a)
    assert (area[:, 2] > 0).all() and area[:, 2].sum() == pytest.approx(1.0, abs=1e-9)


def test_spacing_increases_from_nought_to_one() -> None:
    for seed in range(10):
        open_steps, round_steps = (spacing(np.random.default_rng(seed), 50, closed) for closed in (False, True))
        assert open_steps[0] == 0 and open_steps[-1] == pytest.approx(1.0) and (np.diff(open_steps) > 0).all()
        assert (np.diff(round_steps) > 0).all() and round_steps[-1] < 1


def test_grid_shape_by_hand() -> None:
    assert grid_shape(400, 4.0) == (40, 10)
    assert grid_shape(10, 1.0) == (4, 6)


def test_swept_plain_grid_has_two_triangles_per_cell() -> None:
    grid = np.stack([*np.meshgrid(np.arange(4.0), np.arange(3.0)), np.zeros((3, 4))], -1)
    flat = swept(grid, np.random.default_rng(0), wrap_columns=False)
    assert flat.faces.shape == (12, 3)
    np.testing.assert_array_equal(face_normals(flat), [[0, 0, 1]] * 12)
