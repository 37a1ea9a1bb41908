import numpy as np
import pytest

from gash_jax.geometry.bilinear import lookup
from gash_jax.geometry.mesh import Mesh
from gash_jax.geometry.seams import INSIDE, TOLERANCE, apart_rows, equal_on_seams, seam_jumps, seam_rows
from gash_jax.geometry.texels import find_texels
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.textured import SQUARE, SQUARE_UV, split_square


def _values(uv: np.ndarray, mesh: Mesh, size: int) -> tuple[np.ndarray, np.ndarray]:
    """A smooth function of positions at the texels that were found, and which of these lie on a face."""
    found = find_texels(uv, size)
    points = np.einsum("ti,tij->tj", found.barycentric, mesh.vertices[mesh.faces[found.face]])
    values, inside = np.zeros((size**2, 2)), np.zeros(size**2, bool)
    values[found.texel] = np.stack([np.sin(5 * points[:, 0]), points[:, 0] * points[:, 1] + 1], axis=1)
    inside[found.texel] = found.inside
    return values, inside


@pytest.mark.parametrize("size", [8, 33, 128])
def test_both_sides_of_a_seam_become_equal(size: int) -> None:
    uv = split_square()
    rows = seam_rows(SQUARE, uv, size)
    assert len(np.unique(rows.chart_of)) == 2
    values, inside = _values(uv, SQUARE, size)
    equal = equal_on_seams(values, rows, inside)
    before, after = np.abs(seam_jumps(values, rows)).max(), np.abs(seam_jumps(equal, rows)).max()
    assert before > 1e3 * after and after <= TOLERANCE * np.abs(values).max()
    # what the rows say is what lookups on both sides find, at the ends and in between
    ends = np.linspace(0, 1, 2001)[:, None]
    sides = [uv[0, 0] * (1 - ends) + uv[0, 2] * ends, uv[1, 0] * (1 - ends) + uv[1, 1] * ends]
    jump = np.subtract(*(lookup(equal.reshape(size, size, -1), side) for side in sides))
    assert np.abs(jump[[0, -1]]).max() <= 2 * TOLERANCE * np.abs(values).max()
    old = np.subtract(*(lookup(values.reshape(size, size, -1), side) for side in sides))
    # between the points some is left, the less the finer the texture
    assert np.sqrt(np.mean(jump**2)) < (0.55 if size == 8 else 0.4) * np.sqrt(np.mean(old**2))
    moved = np.abs(equal - values).max(axis=1)
    assert moved[inside].max() < 1.5 * before  # about as far as the seam was off


def test_the_texels_move_as_little_as_dense_algebra_says() -> None:
    """A texture so coarse that several points on seams say the same; against a pseudo-inverse."""
    ball, size = bumpy_sphere(3), 36
    side = int(np.ceil(np.sqrt(len(ball.faces))))
    row, column = np.divmod(np.arange(len(ball.faces)), side)
    corners = np.stack([column, row], 1)[:, None] + [[0.15, 0.15], [0.85, 0.15], [0.15, 0.85]]
    rows = seam_rows(ball, corners / side, size)
    rng = np.random.default_rng(5)
    values, inside = rng.normal(size=(size**2, 2)), rng.random(size**2) < 0.5
    sides = np.zeros((len(rows.texels), size**2))
    np.add.at(sides, (np.arange(len(sides))[:, None], rows.texels), rows.weights)
    pull = np.where(inside, INSIDE, 1.0)[:, None] * sides.T
    assert np.linalg.matrix_rank(sides) < len(sides)
    wanted = values - pull @ np.linalg.pinv(sides @ pull, rcond=1e-10) @ sides @ values
    equal = equal_on_seams(values, rows, inside)
    np.testing.assert_allclose(equal, wanted, atol=1e-4)
    assert np.abs(seam_jumps(equal, rows)).max() <= TOLERANCE * np.abs(values).max()


def test_what_is_equal_already_stays() -> None:
    rows = seam_rows(SQUARE, split_square(), 32)
    values = np.full((32 * 32, 3), 2.5)
    np.testing.assert_array_equal(equal_on_seams(values, rows, np.ones(32 * 32, bool)), values)


def test_where_there_is_no_seam() -> None:
    rows = seam_rows(SQUARE, SQUARE_UV, 16)
    assert len(rows.texels) == 0 and len(np.unique(rows.chart_of)) == 1
    values = np.random.default_rng(0).random((256, 1))
    assert equal_on_seams(values, rows, np.ones(256, bool)) is values


def test_points_on_seams_lie_at_most_a_texel_apart() -> None:
    uv, size = split_square(), 50
    rows = seam_rows(SQUARE, uv, size)
    length = np.linalg.norm(uv[0, 2] - uv[0, 0]) * size
    assert len(rows.texels) == np.ceil(length) + 1
    np.testing.assert_allclose(rows.weights.sum(axis=1), 0, atol=1e-12)


def test_seams_of_repeated_vertices_are_found_but_not_hard_edges() -> None:
    # as glTF has them: each face its own vertices
    own = Mesh(
        SQUARE.vertices[SQUARE.faces.ravel()],
        SQUARE.normals[SQUARE.faces.ravel()],
        np.arange(6).reshape(2, 3).astype(np.int32),
    )
    assert len(seam_rows(own, split_square(), 32).texels) == len(seam_rows(SQUARE, split_square(), 32).texels)
    tilted = own.normals.copy()
    tilted[3:] = [0, 0.6, 0.8]
    assert len(seam_rows(own._replace(normals=tilted), split_square(), 32).texels) == 0


def test_three_faces_at_an_edge_agree() -> None:
    vertices = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]], np.int32)
    mesh = Mesh(vertices, np.tile(np.array([0, 0, 1], np.float32), (5, 1)), faces)
    triangle = np.array([[0.05, 0.05], [0.05, 0.4], [0.4, 0.05]])
    uv = np.stack([triangle, triangle[[1, 0, 2]] + [0.5, 0], triangle + [0, 0.5]]).astype(np.float32)
    rows = seam_rows(mesh, uv, 40)
    values = np.random.default_rng(1).random((1600, 1))
    image = equal_on_seams(values, rows, np.ones(1600, bool)).reshape(40, 40, 1)
    ends = np.stack([uv[0, :2], uv[1, [1, 0]], uv[2, :2]])
    found = lookup(image, ends.reshape(-1, 2)).reshape(3, 2)
    np.testing.assert_allclose(found, np.tile(found[:1], (3, 1)), atol=1e-5)


def test_charts_that_lie_too_close_are_left_out() -> None:
    uv = split_square(0.0)
    uv[1] += uv[0, 2] - uv[1, 1] + [0.02, 0.02]
    size = 16
    rows, found = seam_rows(SQUARE, uv, size), find_texels(uv, size)
    chart = np.full(size**2, -1)
    chart[found.texel] = rows.chart_of[found.face]
    assert len(apart_rows(rows, chart).texels) < len(rows.texels) / 2
    wide, found = seam_rows(SQUARE, split_square(), size), find_texels(split_square(), size)
    chart = np.full(size**2, -1)
    chart[found.texel] = wide.chart_of[found.face]
    assert len(apart_rows(wide, chart).texels) == len(wide.texels)
