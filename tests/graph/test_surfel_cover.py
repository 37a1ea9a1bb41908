"""How much of the view nearby faces cover: against the form factor of a polygon in float64, and by hand."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, normalized
from gash_jax.graph.surfel_cover import (
    CLOSE,
    TOUCHING,
    ClosePairs,
    close_pairs,
    joined_pairs,
    surfel_cover,
    without_own,
)
from gash_jax.graph.surfel_graph import normalised, plan_surfels, surfel_graph
from gash_jax.graph.surfel_walk import Beside
from gash_jax.graph.surfels import SurfelTree
from gash_jax.shapes.primitives import icosphere
from tests.helpers.bumpy import random_rotation

UP = np.array([[0, 0, 1]], np.float32)


def _tree(count: int) -> SurfelTree:
    """Every face is a leaf, uncut."""
    return SurfelTree(np.arange(count, dtype=np.int32), np.zeros(count, np.int32), np.full(count, -1), (count,))


def _cover(triangles: np.ndarray, normal: np.ndarray = UP, weight: float = 1.0) -> np.ndarray:
    """Of a vertex at the origin, by triangles (n, 3, 3), all fully counted."""
    count = len(triangles)
    positions = np.concatenate([np.zeros((1, 3)), triangles.reshape(-1, 3)]).astype(np.float32)
    faces = 1 + np.arange(3 * count).reshape(count, 3)
    pairs = ClosePairs(np.zeros(count, np.int64), np.arange(count), np.full(count, weight, np.float32))
    return surfel_cover(pairs, _tree(count), faces, positions, np.repeat(normal, len(positions), axis=0))[0]


def _form_factor(corners: np.ndarray, normal: np.ndarray) -> float:
    """Lambert's formula in float64 of a triangle that is wholly above the horizon."""
    r = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    total = 0.0
    for a, b in zip(r, np.roll(r, -1, axis=0), strict=True):
        cross = np.cross(a, b)
        total += np.arccos(np.clip(a @ b, -1, 1)) * (cross @ normal) / np.linalg.norm(cross)
    return abs(total) / (2 * np.pi)


def test_a_quarter_plane_by_hand() -> None:
    """What reaches from right above the vertex to infinity in one quadrant keeps a quarter of the light away."""
    far = 1e4
    found = _cover(np.array([[[0, 0, 1e-2], [far, 0, 1e-2], [0, far, 1e-2]]]))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-3)
    assert 0 < found[0] < found[2]
    # the cosine of f to the normal makes f . n, over pi, the length
    np.testing.assert_allclose(np.linalg.norm(found), 0.25, rtol=2e-3)


def test_a_sheet_a_hair_above_covers_all() -> None:
    """However far its middle is; from below and from either side of the sheet."""
    for gap in (1e-1, 1e-2, 1e-3, 3e-4):
        sheet = np.array([[[-1, -1, gap], [3, -1, gap], [-1, 3, gap]]])
        # between the inscribed and the circumscribed disk, of which one of radius r has r² / (r² + gap²)
        low, high = (r * r / (r * r + gap * gap) / (1 + (TOUCHING / gap) ** 2) for r in (1.0, np.sqrt(10)))
        assert low - 1e-4 < _cover(sheet)[2] < high + 1e-4
        np.testing.assert_allclose(_cover(sheet)[:2], 0, atol=0.2 * gap)
        np.testing.assert_allclose(_cover(sheet[:, ::-1]), _cover(sheet), atol=1e-6)
    # where the vertex lies in it, and where it lies below, it covers nothing
    for gap in (0.0, -1e-2):
        sheet = np.array([[[-1, -1, gap], [3, -1, gap], [-1, 3, gap]]])
        np.testing.assert_allclose(_cover(sheet), 0, atol=1e-6)


def test_form_factors_of_triangles_above_the_horizon() -> None:
    rng = np.random.default_rng(3)
    triangles = rng.uniform(-1, 1, size=(50, 3, 3)) + [0, 0, 1.05]
    for triangle in triangles:
        np.testing.assert_allclose(
            np.linalg.norm(_cover(triangle[None])), _form_factor(triangle, UP[0]), rtol=1e-3, atol=1e-6
        )


def _seen(triangle: np.ndarray, count: int = 400) -> tuple[float, np.ndarray]:
    """Share of an even sky above +z that a triangle hides, and the sum of the directions to it: even strata of rays."""
    u, turn = np.meshgrid((np.arange(count) + 0.5) / count, 2 * np.pi * (np.arange(count) + 0.5) / count)
    z, across = u.ravel(), np.sqrt(1 - u.ravel() ** 2)
    rays = np.stack([across * np.cos(turn.ravel()), across * np.sin(turn.ravel()), z], axis=1)
    weights = np.linalg.solve(triangle.T.astype(float), rays.T)
    hit = np.all(weights > 0, axis=0)
    return float(np.sum(z[hit]) / np.sum(z)), np.sum(rays[hit], axis=0)


def test_what_crosses_the_horizon_counts_by_what_stands_above_it() -> None:
    """Against rays: with one or two corners below, from either side; a panel that hangs beside a vertex hides half."""
    rng, lengths = np.random.default_rng(7), []
    for _ in range(30):
        triangle = rng.uniform(-1, 1, size=(3, 3)) + [0, 0, rng.uniform(-0.4, 0.4)]
        share, direction = _seen(triangle)
        found = _cover(triangle[None])
        lengths.append(np.linalg.norm(found))
        np.testing.assert_allclose(lengths[-1], share, atol=3e-3)
        if share > 0.02:
            assert found @ direction > 0.999 * lengths[-1] * np.linalg.norm(direction)
        np.testing.assert_allclose(_cover(triangle[None, ::-1]), found, atol=1e-6)
    assert np.sum(np.array(lengths) > 0.01) > 10
    panel = np.array([[[1e-3, -50, 50], [1e-3, 50, 50], [1e-3, 0, -200]]])
    np.testing.assert_allclose(np.linalg.norm(_cover(panel)), 0.5, atol=0.02)
    # as it sinks below the horizon, what it covers goes to 0 without a jump
    sinking = np.array([[0.3, -0.2, 0.0], [0.3, 0.2, 0.0], [0.4, 0.0, -0.5]])
    found = [np.linalg.norm(_cover(sinking[None] + [0, 0, z])) for z in np.linspace(0.3, -0.1, 200)]
    assert np.abs(np.diff(found)).max() < 0.02 * max(found) and found[-1] == 0


def test_it_turns_and_adds_up() -> None:
    rng = np.random.default_rng(4)
    triangles = rng.uniform(-1, 1, size=(20, 3, 3)) + [0, 0, 0.5]
    whole, rotation = _cover(triangles), random_rotation(5)
    turned = _cover(triangles @ rotation.T, (UP @ rotation.T).astype(np.float32))
    np.testing.assert_allclose(turned, rotation @ whole, atol=2e-5)
    np.testing.assert_allclose(_cover(2.5 * triangles), whole, atol=1e-5)  # a ratio of lengths
    np.testing.assert_allclose(sum(_cover(t[None]) for t in triangles), whole, atol=1e-5)
    np.testing.assert_allclose(_cover(triangles, weight=0.25), 0.25 * whole, atol=1e-6)


def test_what_is_close() -> None:
    importance = np.array([1.2, 1.0, 1.5, 3.0], np.float32) * CLOSE
    beside = Beside(np.arange(4), 20 + np.arange(4), np.array([1, 1, 0.3, 0.1], np.float32), importance)
    found = close_pairs(7, beside)
    np.testing.assert_array_equal(found.vertex, [7, 8, 9, 10])
    np.testing.assert_array_equal(found.leaf, [20, 21, 22, 23])
    np.testing.assert_allclose(found.weight[1:], [0, 0.5, 0.4], atol=1e-5)
    joined = joined_pairs([found, found])
    np.testing.assert_array_equal(joined.vertex, [7, 8, 9, 10, 7, 8, 9, 10])


def test_a_vertex_is_not_covered_by_its_own_faces() -> None:
    faces = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    pairs = ClosePairs(np.array([0, 0, 1]), np.array([0, 1, 0]), np.ones(3, np.float32))
    kept = without_own(pairs, np.array([2, 3]), _tree(2), faces)
    np.testing.assert_array_equal(kept.vertex, [2, 3])
    np.testing.assert_array_equal(kept.leaf, [1, 0])


def _two_sheets(gap: float) -> Mesh:
    """A grid of 4 x 4 squares, and a single square over all of it."""
    x, y = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5), indexing="ij")
    grid = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    i = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    faces = np.concatenate([np.stack([i, i + 5, i + 6], 1), np.stack([i, i + 6, i + 1], 1)])
    roof = np.array([[-1.5, -1.5, gap], [1.5, -1.5, gap], [1.5, 1.5, gap], [-1.5, 1.5, gap]])
    faces = np.concatenate([faces, 25 + np.array([[0, 1, 2], [0, 2, 3]])]).astype(np.int32)
    vertices = np.concatenate([grid, roof]).astype(np.float32)
    return Mesh(vertices, np.tile(UP, (29, 1)), faces)


def test_graphs_say_how_much_is_covered() -> None:
    for gap, least in ((0.3, 0.4), (1e-2, 0.5), (1e-3, 0.5)):
        graph = surfel_graph(_two_sheets(gap))
        cover = np.concatenate([part["cover"] for part in graph.parts])[graph.slot]
        assert np.all(cover[:25, 2] > least)
        np.testing.assert_array_equal(cover[25:], 0)
    # of a convex body nothing stands above a tangent plane
    np.testing.assert_array_equal([part["cover"].any() for part in surfel_graph(icosphere(3)).parts], False)


@pytest.mark.parametrize(("gap", "slant"), [(0.05, 0.0), (0.0, 0.0), (0.05, 1.2), (0.05, -2.0)])
def test_jax_gives_the_same_with_finite_gradients(gap: float, slant: float) -> None:
    """With slanting normals many faces cross the horizon."""
    mesh = _two_sheets(gap)
    mesh = mesh._replace(normals=normalized(mesh.normals + np.array([slant, 0, 0], np.float32)))
    positions = normalised(mesh)[0]
    plan, _ = plan_surfels(mesh, positions)

    def covered(p: jax.Array) -> jax.Array:
        return surfel_cover(plan.close, plan.tree, plan.faces, p, jnp.asarray(mesh.normals), jnp)

    plain = surfel_cover(plan.close, plan.tree, plan.faces, positions, mesh.normals)
    assert plain.any() == (gap > 0)
    np.testing.assert_allclose(jax.jit(covered)(positions), plain, atol=1e-5)
    moved = jnp.stack([positions, 1.01 * positions])
    np.testing.assert_allclose(jax.vmap(covered)(moved)[0], plain, atol=1e-5)
    gradient = jax.grad(lambda p: jnp.sum(covered(p) ** 2))(jnp.asarray(positions))
    assert np.isfinite(gradient).all()
