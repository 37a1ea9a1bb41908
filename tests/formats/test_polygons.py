"""Polygons of every kind, from every first corner: the outline is covered once, by triangles that share whole edges."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gash_jax.formats.polygons import triangulate
from gash_jax.geometry.mesh import angle_weighted_normals, vector_areas

U = [[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]]
DART = [[0, 0], [1, 1], [2, 0], [1, 3]]
STAIR = [[0, 0], [3, 0], [3, 1], [2, 1], [2, 2], [1, 2], [1, 3], [0, 3]]
COMB = [[0, 0], [7, 0], [7, 3], [6, 3], [6, 1], [5, 1], [5, 3], [4, 3], [4, 1], [3, 1], [3, 3], [2, 3], [2, 1], [0, 1]]
STRAIGHT = [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]]  # a square, corners amid its edges
KEYHOLE = [[0, 0], [4, 0], [4, 3], [0, 3], [0, 0], [1, 1], [1, 2], [3, 2], [3, 1], [1, 1]]
# two windows, the second by a bridge from the far corner
TWO_WINDOWS = [*KEYHOLE, [0, 0], [4, 0], [4, 3], [3.5, 2.5], [3.5, 2.2], [3.2, 2.2], [3.5, 2.5], [4, 3], [0, 3]]
PINCHED = [[0, 0], [2, -1], [2, 1], [0, 0], [-2, 1], [-3, 0], [-2, -1]]  # two triangles that touch in a point
CONCAVE = {"u": U, "dart": DART, "stair": STAIR, "comb": COMB, "straight": STRAIGHT, "keyhole": KEYHOLE}


def _cut(points: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    return triangulate(np.arange(len(points)), np.array([len(points)]), points)


def _in_space(points, height: float = 0.0) -> np.ndarray:
    flat = np.asarray(points, dtype=np.float64)
    return np.concatenate([flat, np.full((len(flat), 1), height)], axis=1)


def _check_cover(points: np.ndarray, thinnest: float = 1e-4) -> None:
    """Against the shoelace area; every edge of the outline once, every other edge by two triangles, opposite ways."""
    faces, _ = _cut(points)
    count = len(points)
    exact = points.astype(np.float64)
    outline = np.cross(exact - exact[0], np.roll(exact, -1, axis=0) - exact[0]).sum(axis=0) / 2
    area = np.linalg.norm(outline)
    facing = vector_areas(exact, faces) @ outline / area
    np.testing.assert_allclose(np.abs(facing).sum(), area, rtol=1e-5)
    assert facing.min() > -1e-6 * area and len(faces) == count - 2
    edges = Counter((face[i - 1], face[i]) for face in faces.tolist() for i in range(3))
    assert set(edges.values()) == {1}
    assert {(a, b) for a, b in edges if (b, a) not in edges} == {(i, (i + 1) % count) for i in range(count)}
    # every corner has a triangle worth the name, so that it gets the normal of the polygon
    side = np.linalg.norm(exact[faces] - exact[np.roll(faces, 1, axis=1)], axis=2).max(axis=1)
    best = np.zeros(count)
    np.maximum.at(best, faces, (facing / side**2)[:, None])
    assert best.min() > thinnest
    normals = angle_weighted_normals(exact, faces)
    np.testing.assert_allclose(normals, np.broadcast_to(outline / area, normals.shape), atol=1e-3)


@pytest.mark.parametrize("name", CONCAVE)
def test_any_first_corner_either_way_round_in_any_plane(name: str) -> None:
    points = _in_space(CONCAVE[name])
    for start in range(len(points)):
        turned = np.roll(points, start, axis=0)
        for seed, polygon in enumerate((turned, turned[::-1])):
            _check_cover(polygon)
            tilted = Rotation.random(rng=np.random.default_rng(10 * start + seed)).apply(polygon)
            _check_cover(tilted)
            _check_cover((100 * tilted + [7, -20, 3]).astype(np.float32))


def test_by_hand() -> None:
    """The arrowhead of the shared cases: area 2, both triangles from its notch to its tip."""
    faces, notes = _cut(np.array([[0, 0, 0], [1, 0, -1], [2, 0, 0], [1, 0, -3.0]]))
    assert sorted(map(sorted, faces.tolist())) == [[0, 1, 3], [1, 2, 3]]
    assert notes == ("1 polygon with concave or straight corners: cut inside the outline, not as a fan",)


def _radial(rng: np.random.Generator, count: int) -> np.ndarray:
    angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    while np.diff(np.append(angles, angles[0] + 2 * np.pi)).max() > 3:
        angles = np.sort(rng.uniform(0, 2 * np.pi, count))
    return rng.uniform(0.3, 1, count)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)


@pytest.mark.parametrize("seed", range(60))
def test_random_outlines_with_straight_corners(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = _radial(rng, int(rng.integers(5, 25)))
    for _ in range(rng.integers(0, 8)):
        place = int(rng.integers(len(points)))
        between = points[place] + (points[(place + 1) % len(points)] - points[place]) * rng.integers(1, 8) / 8
        points = np.insert(points, place + 1, between, axis=0)
    tilted = Rotation.random(rng=np.random.default_rng(seed)).apply(_in_space(points))
    for polygon in (_in_space(points), tilted, (tilted + rng.normal(size=3)).astype(np.float32)):
        _check_cover(np.roll(polygon, seed, axis=0), thinnest=1e-7)


@pytest.mark.parametrize("points", [TWO_WINDOWS, PINCHED], ids=["two windows", "pinched"])
def test_outlines_that_touch_themselves(points: list) -> None:
    whole = _in_space(points)
    x, y, _ = whole.T
    area = abs(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2
    for start in range(len(points)):
        polygon = np.roll(whole, start, axis=0)
        faces, _ = _cut(polygon)
        signed = vector_areas(polygon, faces)[:, 2]
        assert np.abs(signed).sum() == pytest.approx(area) and (signed > -1e-12).all()


@pytest.mark.parametrize("count", [4, 5, 12, 1000])
def test_convex_polygons_keep_their_fan(count: int) -> None:
    angles = 2 * np.pi * np.arange(count) / count
    round_ = _in_space(np.stack([3 * np.cos(angles), np.sin(angles)], axis=1))
    i = np.arange(1, count - 1)
    for seed in range(3):
        faces, notes = _cut((Rotation.random(rng=np.random.default_rng(seed)).apply(round_) + seed).astype(np.float32))
        np.testing.assert_array_equal(faces, np.stack([0 * i, i, i + 1], axis=1))
        assert notes == ()


@pytest.mark.parametrize(
    "points",
    [
        [[0, 0, 0], [1, 0, 0.04], [1, 1, 0], [0, 1, 0.04]],  # a little bent
        [[0, 0, 0], [1, 0, 0], [1, 1e-6, 0], [0, 1e-6, 0]],  # thin
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 0]],  # the pole of a globe
        [[0, 0, 0], [0, 0, 0], [1, 0, 0], [1, 1, 0]],
        [[0, 0, 0], [1, 1, 1], [2, 2, 2], [3, 3, 3]],  # no area at all
        [[0, 0, 0], [1, 0, 0], [1, 1, np.nan], [0, 1, 0]],
        [[0, 0, 0], [1, 0, 0], [0, 1, 1e300], [1, 1, 0]],
    ],
)
def test_odd_quads_keep_their_fan(points: list) -> None:
    faces, notes = _cut(np.array(points, dtype=np.float64))
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3]] and notes == ()


def test_what_has_no_inside_keeps_its_fan_and_is_noted() -> None:
    star = 4 * np.pi * np.arange(5) / 5
    bow = _in_space([[0, 0], [2, 1], [2, 0], [0, 1.5]])
    even = _in_space([[0, 0], [1, 1], [1, 0], [0, 1]])
    for points in (bow, even, _in_space(np.stack([np.cos(star), np.sin(star)], axis=1))):
        faces, notes = _cut(points)
        i = np.arange(1, len(points) - 1)
        np.testing.assert_array_equal(faces, np.stack([0 * i, i, i + 1], axis=1))
        assert notes == ("1 polygon without an inside, crossing itself or twisted: cut as a fan from the first corner",)


def test_bent_polygons_are_noted() -> None:
    saddle = np.array([[0, 0, 0], [1, 0, 0.5], [1, 1, 0], [0, 1, 0.5]])
    faces, notes = _cut(saddle)
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    assert notes == ("1 polygon bent by more than a tenth of the size: cut in one of several ways",)


def test_many_polygons_in_order() -> None:
    """Triangles stay in the order of their polygons; only the concave one leaves its fan."""
    square, dart = _in_space([[0, 0], [1, 0], [1, 1], [0, 1]]), _in_space(DART)
    points = np.concatenate([square, dart])
    corners = np.array([0, 1, 2, *range(4, 8), 0, 3, *range(4), 4, 5, 6])
    faces, notes = triangulate(corners, np.array([3, 4, 2, 4, 3]), points)
    assert faces[[0, 3, 4, 5]].tolist() == [[0, 1, 2], [0, 1, 2], [0, 2, 3], [4, 5, 6]]
    assert sorted(map(sorted, faces[1:3].tolist())) == [[4, 5, 7], [5, 6, 7]]
    assert [note.split()[0] for note in notes] == ["1", "1"] and "fewer than three" in notes[0]
    nothing, none = triangulate(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), points)
    assert nothing.shape == (0, 3) and none == ()


def test_vertices_that_do_not_exist_are_left_to_the_later_checks() -> None:
    faces, notes = triangulate(np.array([0, 1, 9, -2]), np.array([4]), _in_space(DART))
    assert faces.tolist() == [[0, 1, 9], [0, 9, -2]] and notes == ()
