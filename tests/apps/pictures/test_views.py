"""Ray-cast views: what is where, exposure, sRGB."""

import numpy as np
import pytest

from gash_jax.apps.pictures.views import VIEWS, cast_view, exposure_for, shade_view, to_srgb
from gash_jax.shapes.primitives import box, icosphere


def test_a_ball_fills_the_frame_as_a_disk() -> None:
    image, coverage = shade_view(cast_view(icosphere(4), "front", 64), np.ones((2562, 3), np.float32))
    assert coverage.mean() == pytest.approx(np.pi / 4 / 1.06**2, abs=0.02)
    np.testing.assert_allclose(image[coverage == 1], 1.0, atol=1e-5)
    assert not image[coverage == 0].any() and coverage[0, 0] == 0


def test_values_are_interpolated_between_vertices() -> None:
    """Painting each vertex with its own position shows, in every view, the position that the pixel sees."""
    mesh = icosphere(3)
    for view in VIEWS:
        image, coverage = shade_view(cast_view(mesh, view, 32), mesh.vertices)
        np.testing.assert_allclose(np.linalg.norm(image[coverage == 1], axis=-1), 1.0, atol=0.02)


def test_up_is_up_and_front_is_towards_z() -> None:
    image, coverage = shade_view(cast_view(box(), "front", 64), box().vertices)
    seen = coverage == 1
    rows = np.nonzero(seen)[0]
    heights = image[seen][:, 1]
    assert np.corrcoef(rows, heights)[0, 1] < -0.8
    assert image[seen][:, 2].mean() > 0.2


def test_exposure_and_srgb_by_hand() -> None:
    image, coverage = np.full((4, 4, 3), 0.45), np.ones((4, 4))
    assert exposure_for([(image, coverage)]) == pytest.approx(2.0)
    assert to_srgb(image, coverage, 2.0)[0, 0, 0] == 243  # 0.9 linear is 0.9547 in sRGB
    assert to_srgb(-image, coverage, 2.0).max() == 0 and to_srgb(9 * image, coverage, 2.0).min() == 255


def test_the_ground_is_a_gradient_whatever_the_exposure() -> None:
    image, coverage = np.full((4, 4, 3), 0.45), np.zeros((4, 4))
    ground = to_srgb(0 * image, coverage, 5.0)
    assert (ground == to_srgb(0 * image, coverage, 0.1)).all()
    assert ground[:, 0, 0].tolist() == [89, 124, 149, 170]  # 0.1 to 0.4 linear in sRGB


def test_front_looks_at_what_faces_z() -> None:
    """A nose towards +z is in the middle of the front view, and hidden from the back."""
    ball = icosphere(3)
    nose = (ball.vertices[:, 2:] > 0.9).astype(np.float32)
    front, back = (shade_view(cast_view(ball, view, 65), nose)[0][..., 0] for view in ("front", "back"))
    column = np.average(np.arange(65), weights=front.sum(0))
    assert abs(column - 32) < 0.5 and not back.any()


def test_poses_around_one_mesh_do_not_move_the_camera() -> None:
    """A ball half as large, to the right, covers what it covers of the frame of the large one."""
    large = icosphere(4)
    small = large._replace(vertices=np.float32(0.5) * large.vertices + np.array([0.5, 0, 0], np.float32))
    (_, one), (_, same), (_, half) = (
        shade_view(cast_view(mesh, (0.0, 0.0), 64, around), np.ones((2562, 3), np.float32))
        for mesh, around in ((large, None), (large, large), (small, large))
    )
    assert (one == same).all()
    assert half.sum() / one.sum() == pytest.approx(0.25, rel=0.05)  # perspective: the middle is as far away
    assert half[:, :32].sum() < 0.01 * half.sum() and half[:, 32:].sum() > 0.99 * half.sum()
