import numpy as np
import pytest

from gash_jax.geometry.animation import Animation
from gash_jax.shapes import cloth as c


@pytest.fixture(scope="module")
def sheet() -> Animation:
    return c.cloth_animation(0, 80, 20)


def test_groups_share_no_vertex_and_hold_every_pair() -> None:
    count = 7
    row, column = np.divmod(np.arange(count**2), count)
    points = np.stack([row, 0 * row, column], axis=1).astype(float)
    groups = c.cloth_groups(points, count)
    pairs = set()
    for group in groups:
        both = np.concatenate([group.first, group.second])
        assert len(np.unique(both)) == len(both)
        np.testing.assert_allclose(group.rest, np.linalg.norm(points[group.first] - points[group.second], axis=1))
        pairs |= set(zip(group.first.tolist(), group.second.tolist(), strict=True))
    # rows and columns, two diagonals, and next neighbours along rows and columns
    assert len(pairs) == 2 * 7 * 6 + 2 * 6 * 6 + 2 * 7 * 5 == sum(len(group.first) for group in groups)


def test_two_vertices_by_hand() -> None:
    """Without compliance a stretched pair goes back to its length in one round, about its middle."""
    pair = [c.Group(np.array([0]), np.array([1]), np.array([1.0]), 0.0)]
    points = np.array([[0.0, 9, 0], [3, 9, 0]])
    moved, velocity = c.cloth_step(points, np.zeros((2, 3)), pair, 0.0)
    step = c.STEP / c.SUBSTEPS
    fall = c.GRAVITY * step**2
    np.testing.assert_allclose(moved, [[1, 9 - fall, 0], [2, 9 - fall, 0]], atol=1e-12)
    np.testing.assert_allclose(velocity, (moved - points) / step)


def test_a_soft_pair_gives_way_as_its_compliance_says() -> None:
    """A round of XPBD moves the pair by (long - rest) / (2 + a) each, a = compliance / step²; more rounds solve for
    the pull at which 2 pull + a pull equals the stretch, so the sum of all rounds is that of the first."""
    step = c.STEP / c.SUBSTEPS
    soft = [c.Group(np.array([0]), np.array([1]), np.array([1.0]), 2 * step**2)]
    moved, _ = c.cloth_step(np.array([[0.0, 9, 0], [3, 9, 0]]), np.zeros((2, 3)), soft, 0.0)
    np.testing.assert_allclose(moved[1, 0] - moved[0, 0], 3 - 2 * 2 / (2 + 2), atol=1e-12)


def test_cloth_keeps_its_lengths(sheet: Animation) -> None:
    """After it has hit the ball no edge is off by more than a fifth, and all of them by 3 % in the RMS."""
    flat = sheet.frame(0).astype(np.float64)
    stiff = c.cloth_groups(flat, 20)[:4]
    for number in range(len(sheet)):
        points = sheet.frame(number).astype(np.float64)
        long = [np.linalg.norm(points[g.first] - points[g.second], axis=1) / g.rest for g in stiff]
        strain = np.concatenate(long) - 1
        assert np.abs(strain).max() < 0.2 and np.sqrt(np.mean(strain**2)) < 0.03, number


def test_cloth_stays_out_of_ball_and_floor(sheet: Animation) -> None:
    touched = 0
    for number, points in enumerate(sheet.frames()):
        away = np.linalg.norm(points - c.ball_center(c.STEP * number), axis=1)
        assert away.min() > c.RADIUS + c.GAP - 1e-6 and points[:, 1].min() > c.FLOOR + c.GAP - 1e-6
        touched += int((away < c.RADIUS + 2 * c.GAP).sum())
    assert touched > 100


def test_it_falls_and_seeds_reproduce(sheet: Animation) -> None:
    assert sheet.frame(20)[:, 1].mean() < sheet.frame(0)[:, 1].mean() - 0.1
    again, other = c.cloth_animation(0, 12, 20), c.cloth_animation(1, 12, 20)
    np.testing.assert_array_equal(again.frame(11), sheet.frame(11))
    assert not np.array_equal(other.frame(11), again.frame(11))
    assert sheet.seconds is not None and sheet.seconds[60] == pytest.approx(1)
    assert (sheet.mesh.normals[:, 1] > 0.9).all()


def test_arguments_are_checked() -> None:
    with pytest.raises(ValueError, match="vertices_along is 2: use a whole number of 4 or more"):
        c.cloth_animation(0, 5, 2)
