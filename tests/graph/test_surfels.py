"""The surfel tree: moments by hand and from the leaves, every leaf once, the curve's order, motions of the mesh."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, face_areas, transform, vector_areas
from gash_jax.graph import surfels
from gash_jax.graph.surfel_graph import normalised
from gash_jax.graph.surfel_pieces import PIECE_COUNT, PIECE_START, PIECES
from gash_jax.graph.surfels import (
    FAN,
    TOP,
    SurfelTree,
    build_tree,
    curve_codes,
    surface_axes,
    surfel_records,
)
from gash_jax.shapes.primitives import icosphere, uv_sphere
from tests.helpers.bumpy import bumpy_mesh, random_rotation

LEAF = SurfelTree(np.zeros(1, np.int32), np.zeros(1, np.int32), np.full(1, -1, np.int32), (1,))


def _axes(positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return surface_axes(positions, faces, face_areas(positions, faces))


def _tree(positions: np.ndarray, faces: np.ndarray) -> SurfelTree:
    return build_tree(positions, faces, face_areas(positions, faces), _axes(positions, faces))


@cache
def _bumpy() -> tuple[np.ndarray, np.ndarray, SurfelTree, np.ndarray]:
    mesh = bumpy_mesh(300)
    positions, faces = normalised(mesh)[0], mesh.faces
    tree = _tree(positions, faces)
    return positions, faces, tree, surfel_records(tree, positions, faces)


def _starts(tree: SurfelTree) -> np.ndarray:
    return np.cumsum([0, *tree.level_sizes])


def _leaves(tree: SurfelTree, node: int) -> np.ndarray:
    """Numbers of the leaves below a node."""
    nodes = np.array([node])
    while np.any(tree.first_child[nodes] >= 0):
        first = tree.first_child[nodes]
        nodes = (first[first >= 0][:, None] + np.arange(FAN)).ravel()
    return nodes - _starts(tree)[-2]


def _matrices(six: np.ndarray) -> np.ndarray:
    xx, yy, zz, xy, xz, yz = np.moveaxis(six, -1, 0)
    return np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(-1, 3, 3)


def test_a_right_triangle_by_hand() -> None:
    positions = np.array([[1, 1, 5], [3, 1, 5], [1, 4, 5]], np.float32)
    record = surfel_records(LEAF, positions, np.array([[0, 1, 2]], np.int32))[0]
    # legs a = 2 and b = 3: variances a²/18 and b²/18, covariance -ab/36
    xx, yy, xy = 4 / 18, 9 / 18, -6 / 36
    expected = [5 / 3, 2, 5, 0, 0, 3, 3, np.sqrt(xx + yy), 0, 0, xx * yy - xy * xy, 0, 0, 0, xx, yy, 0, xy, 0, 0]
    np.testing.assert_allclose(record, expected, atol=1e-6)


def test_the_top_level_has_the_area_of_the_mesh() -> None:
    positions, faces, tree, records = _bumpy()
    top = records[: tree.level_sizes[0]].astype(np.float64)
    assert TOP // FAN < tree.level_sizes[0] <= TOP
    np.testing.assert_allclose(top[:, 6].sum(), face_areas(positions, faces).sum(), rtol=1e-5)
    # of an open part: the vectors of a closed mesh sum to 0
    np.testing.assert_allclose(top[:, 3:6].sum(0), 0, atol=1e-5)
    part = faces[:250]
    tree = _tree(positions, part)
    top = surfel_records(tree, positions, part)[: tree.level_sizes[0]].astype(np.float64)
    np.testing.assert_allclose(top[:, 3:6].sum(0), vector_areas(positions, part).sum(0), atol=1e-5)
    assert np.linalg.norm(top[:, 3:6].sum(0)) > 0.1


def test_moments_of_parents_are_those_of_their_leaves() -> None:
    positions, faces, tree, records = _bumpy()
    corners = np.einsum("lab,lbi->lai", PIECES[tree.piece].astype(np.float64), positions[faces[tree.face]])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2 * (tree.face >= 0)
    middle = corners.mean(1)
    square = (np.einsum("lai,laj->lij", corners, corners) + 9 * middle[:, :, None] * middle[:, None]) / 12
    top, starts = tree.level_sizes[0], _starts(tree)
    for node in [*range(0, top, 7), starts[1] + 5, starts[2] - 2, starts[2] + 100]:
        leaves = _leaves(tree, node)
        total = area[leaves].sum()
        if not total:
            assert records[node, 6] == 0
            continue
        share = area[leaves] / total
        center = share @ middle[leaves]
        spread = np.einsum("l,lij->ij", share, square[leaves]) - np.outer(center, center)
        np.testing.assert_allclose(records[node, 6], total, rtol=1e-5)
        np.testing.assert_allclose(records[node, :3], center, atol=1e-6)
        np.testing.assert_allclose(_matrices(records[node, 14:])[0], spread, atol=1e-6)
        np.testing.assert_allclose(records[node, 7], np.sqrt(np.trace(spread)), rtol=1e-4)
        adjugate = np.linalg.det(spread) * np.linalg.inv(spread)
        np.testing.assert_allclose(_matrices(records[node, 8:14])[0], adjugate, atol=1e-6)


def test_projected_area_of_a_flat_ellipse() -> None:
    a, b, count = 2.0, 0.5, FAN**3
    angle = 2 * np.pi * np.arange(count) / count
    rim = np.stack([a * np.cos(angle), b * np.sin(angle), 0 * angle], axis=1)
    positions = np.concatenate([[[0, 0, 0]], rim]).astype(np.float32)
    i = np.arange(count)
    faces = np.stack([0 * i, 1 + i, 1 + (i + 1) % count], axis=1).astype(np.int32)
    child = np.concatenate([1 + FAN * np.arange(1 + FAN + FAN**2), np.full(count, -1)]).astype(np.int32)
    tree = SurfelTree(i.astype(np.int32), np.zeros(count, np.int32), child, (1, FAN, FAN**2, count))
    record = surfel_records(tree, positions, faces)[0]
    adjugate = _matrices(record[8:14])[0]
    for u in ([0, 0, 1], [0.6, 0, 0.8], [0, -0.8, 0.6], [1, 0, 0]):
        projected = 4 * np.pi * np.sqrt(max(np.array(u) @ adjugate @ u, 0))
        np.testing.assert_allclose(projected, np.pi * a * b * u[2], rtol=4e-3, atol=1e-3)


@pytest.mark.parametrize("count", [4, 40, 300])
def test_every_leaf_is_once_in_the_tree(count: int) -> None:
    mesh = bumpy_mesh(count)
    positions = normalised(mesh)[0]
    tree = _tree(positions, mesh.faces)
    starts, inner = _starts(tree), np.flatnonzero(tree.first_child >= 0)
    assert len(tree.first_child) == starts[-1] and len(tree.face) == len(tree.piece) == tree.level_sizes[-1]
    level = np.searchsorted(starts, inner, side="right") - 1
    assert np.all(tree.first_child[inner] >= starts[level + 1])
    assert np.all(tree.first_child[inner] + FAN <= starts[level + 2])
    found = np.concatenate([_leaves(tree, node) for node in range(tree.level_sizes[0]) if tree.first_child[node] >= 0])
    np.testing.assert_array_equal(np.sort(found), np.arange(tree.level_sizes[-1]))
    real = tree.face >= 0
    pairs = np.unique(np.stack([tree.face, tree.piece])[:, real], axis=1)
    assert pairs.shape[1] == real.sum()
    # all parts of one way of cutting, and that of every face
    way = np.searchsorted(PIECE_START, pairs[1], side="right") - 1
    for face in range(len(mesh.faces)):
        cut = way[pairs[0] == face]
        assert len(cut) == PIECE_COUNT[cut[0]] and np.all(cut == cut[0])


def test_jax_gives_the_same_records() -> None:
    positions, faces, tree, records = _bumpy()
    assert records.dtype == np.float32 and records.shape == (len(tree.first_child) + 1, 20)
    traced = jax.jit(lambda p: surfel_records(tree, p, faces, jnp))(positions)
    assert traced.dtype == jnp.float32
    np.testing.assert_allclose(traced, records, atol=1e-5)


def test_records_without_a_surfel_are_empty() -> None:
    """The last, and what fills up a family, with NumPy and JAX alike."""
    positions, faces, tree, records = _bumpy()
    leaves = np.append(tree.face >= 0, False)
    for found in (records, np.asarray(surfel_records(tree, positions, faces, jnp))):
        own = found[-len(leaves) :]
        np.testing.assert_array_equal(own[~leaves], 0)
        assert np.all(own[leaves, 7] > 0) and 1 < np.count_nonzero(~leaves) < FAN + 1


def test_records_turn_and_grow_with_the_mesh(rotation: np.ndarray) -> None:
    positions, faces, tree, records = _bumpy()
    scale, shift = 2.5, np.array([0.3, -0.2, 0.1])
    moved = surfel_records(tree, (scale * positions @ rotation.T + shift).astype(np.float32), faces)[:-1]
    records = records[:-1][: tree.level_sizes[0]]
    moved = moved[: tree.level_sizes[0]]
    real = records[:, 6] > 0
    records, moved = records[real], moved[real]
    np.testing.assert_allclose(moved[:, :3], scale * records[:, :3] @ rotation.T + shift, atol=1e-5)
    np.testing.assert_allclose(moved[:, 3:6], scale**2 * records[:, 3:6] @ rotation.T, atol=1e-5)
    np.testing.assert_allclose(moved[:, 6:8], records[:, 6:8] * [scale**2, scale], rtol=1e-4)
    adjugate, spread = (_matrices(records[:, a:b]) for a, b in ((8, 14), (14, 20)))
    turned = scale**4 * rotation @ adjugate @ rotation.T
    np.testing.assert_allclose(_matrices(moved[:, 8:14]), turned, atol=1e-5)
    np.testing.assert_allclose(_matrices(moved[:, 14:]), scale**2 * rotation @ spread @ rotation.T, atol=1e-5)


def test_axes_turn_with_the_mesh(bumpy: Mesh) -> None:
    axes = _axes(bumpy.vertices, bumpy.faces)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-6)
    for seed in range(4):
        turn = random_rotation(seed)
        moved = transform(bumpy, turn, np.array([1.0, 2.0, -1.0]), 3.0)
        np.testing.assert_allclose(_axes(moved.vertices, moved.faces), turn @ axes, atol=1e-4)


def _spiked(body: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The body and, far out, a face of hardly any area."""
    spike = np.array([[3, 0.4, 0.2], [3, 0.40001, 0.2], [3, 0.4, 0.20001]], np.float32)
    faces = np.concatenate([body.faces, np.arange(3, dtype=np.int32)[None] + len(body.vertices)])
    return np.concatenate([body.vertices, spike]), faces


def _spheroid(half_length: float) -> Mesh:
    """With its axis along y, and eight meridians: two moments are equal."""
    ball = uv_sphere(6, 8)
    return ball._replace(vertices=ball.vertices * np.array([1, half_length, 1], np.float32))


EVEN = {"long": _spheroid(2.0), "flat": _spheroid(0.5), "round": icosphere(2)}


@pytest.mark.parametrize("body", EVEN.values(), ids=EVEN)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_axes_of_a_body_with_equal_moments_turn_with_it(body: Mesh, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    positions, faces = _spiked(body)
    rotation = random_rotation(seed)
    turned = (positions @ rotation.T).astype(np.float32)

    def together() -> np.ndarray:
        return np.abs(_axes(turned, faces).T @ rotation @ _axes(positions, faces))

    # the body is even across the other axes, so their signs are open
    np.testing.assert_allclose(together(), np.eye(3), atol=1e-4)
    axes = _axes(turned, faces)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    # the axes of equal moments alone would turn as they like
    monkeypatch.setattr(surfels, "EQUAL", 0.0)
    assert np.abs(together() - np.eye(3)).max() > 0.01


def test_an_even_body_looks_where_it_reaches_farther() -> None:
    positions, faces = _spiked(_spheroid(2.0))
    along = (positions @ _axes(positions, faces))[-1]
    # the long axis comes last, and across it the middle one points to the spike
    np.testing.assert_allclose(along[:2], [0, np.hypot(3, 0.2)], atol=1e-4)
    np.testing.assert_allclose(abs(along[2]), 0.4, atol=1e-4)


@pytest.mark.parametrize("count", [1, 2])
def test_axes_of_one_face_and_of_two_turn_with_them(count: int) -> None:
    """The middles of two faces lie on a line, and what is across it is rounding: corners say where the faces look."""
    positions = np.array([[0, 0, 0], [3, 0.3, 0], [2.5, 1.7, 0.2], [-0.4, 1, 0.9]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)[:count]
    rotation = random_rotation(4)
    turned = (positions.astype(np.float64) @ rotation.T).astype(np.float32)
    np.testing.assert_allclose(_axes(turned, faces), rotation @ _axes(positions, faces), atol=1e-4)


def test_codes_by_hand() -> None:
    positions = np.array([[0, -1, -1], [-1, 0, -1], [-1, -1, 1], [-1, -1, -0.998]], np.float32)
    normals = np.array([[1, 0, 0], [-1, 1, 1], [0, 0, 0], [0, 0, 1]], np.float32)
    # half the range is the first bit of its axis (x before y before z); the octant follows the first 9 bits
    expected = [(1 << 32) + (4 << 21), (1 << 31) + (3 << 21), 0, (1 << 21) + 1]
    expected[2] = sum(1 << (3 * bit if bit < 7 else 3 * bit + 3) for bit in range(10))
    np.testing.assert_array_equal(curve_codes(positions, normals, 9), expected)


def test_two_sides_of_a_thin_plate_part_on_the_curve() -> None:
    low, near, far = [-0.9, -0.9, -0.9], [-0.89, -0.9, -0.9], [0.9, -0.9, -0.9]
    positions = np.array([low, near, low, near, far], np.float32)
    normals = np.array([[0, 0, 1], [0, 0, 1], [0, 0, -1], [0, 0, -1], [0, 0, -1]], np.float32)
    assert np.argsort(curve_codes(positions, normals, 9)).tolist() == [2, 3, 0, 1, 4]
    # the octant last: place alone decides
    assert np.argsort(curve_codes(positions, normals, 30)).tolist() == [2, 0, 3, 1, 4]
