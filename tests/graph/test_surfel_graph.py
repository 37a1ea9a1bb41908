"""The graph of parts by width: shapes, slots, corners by hand, faces in order, and meshes with hardly anything."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, angle_weighted_normals
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.graph.surfel_graph import (
    NEAR,
    SurfelGraph,
    corner_table,
    normalised,
    outward_faces,
    part_arrays,
    plan_surfels,
    surfel_graph,
    with_surfels,
)
from gash_jax.graph.surfel_lists import WIDTHS
from gash_jax.graph.surfels import surfel_records
from tests.helpers.split import split_mesh

TETRAHEDRON = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)


def _tetrahedron(faces: np.ndarray = TETRAHEDRON) -> Mesh:
    vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32)
    return Mesh(vertices, (vertices / np.sqrt(3)).astype(np.float32), faces)


def _finite(graph: object) -> bool:
    return all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(graph))


def test_shapes_and_types(bumpy: Mesh) -> None:
    graph = surfel_graph(bumpy)
    assert len(graph.parts) == len(WIDTHS)
    assert sum(len(part["normal"]) for part in graph.parts) == 300
    for part, width in zip(graph.parts, WIDTHS, strict=True):
        n = len(part["normal"])
        expected = {"position": (n, 3), "normal": (n, 3), "near": (n, NEAR * 6), "cover": (n, 3)}
        assert {name: a.shape for name, a in part.items()} == {**expected, "table": (n, width), "weight": (n, width)}
        assert {name: a.shape for name, a in with_surfels(part, graph.records).items()} == {
            **expected,
            **{"weight": (n, width), "surfel": (n, width, 20)},
        }
    assert (graph.slot.shape, graph.center.shape, graph.scale.shape) == ((300,), (3,), ())
    leaves = jax.tree.leaves(graph)
    assert all(isinstance(leaf, np.ndarray) and leaf.dtype in (np.float32, np.int32) for leaf in leaves)
    assert _finite(graph)


def test_parts_carry_the_lists_of_their_vertices(bumpy: Mesh) -> None:
    plan, records = plan_surfels(bumpy, normalised(bumpy)[0])
    graph = surfel_graph(bumpy)
    np.testing.assert_array_equal(graph.records, records)
    for part, (vertices, table, weight) in zip(graph.parts, plan.lists, strict=True):
        np.testing.assert_array_equal(part["table"], table)
        np.testing.assert_array_equal(part["weight"], weight)
        np.testing.assert_array_equal(part["normal"], bumpy.normals[vertices])
        seen = with_surfels(part, graph.records)["surfel"]
        np.testing.assert_array_equal(seen, records[table])
        # what fills a list is empty
        assert not seen[weight == 0].any() and np.all(seen[weight > 0][:, 6] > 0)


def _by_vertex(graph: SurfelGraph, name: str) -> np.ndarray:
    return np.concatenate([part[name] for part in graph.parts])[graph.slot]


def test_slots_lead_from_vertices_to_their_rows(bumpy: Mesh) -> None:
    graph = surfel_graph(bumpy)
    np.testing.assert_array_equal(np.sort(graph.slot), np.arange(300))
    # lists are of several widths, so the order is not that of the mesh
    assert not np.array_equal(graph.slot, np.arange(300))
    back = _by_vertex(graph, "position") * graph.scale + graph.center
    np.testing.assert_allclose(back, bumpy.vertices, atol=1e-6)
    np.testing.assert_array_equal(_by_vertex(graph, "normal"), bumpy.normals)
    np.testing.assert_allclose(graph.scale, NormalisedMesh(bumpy).radius, rtol=1e-6)


def test_corners_of_a_tetrahedron_by_hand() -> None:
    expected = [[1, 3, 2, 1, 3], [2, 0, 3, 2, 0], [0, 3, 1, 0, 3], [1, 0, 2, 1, 0]]
    np.testing.assert_array_equal(corner_table(TETRAHEDRON, 4, 5), expected)
    np.testing.assert_array_equal(corner_table(TETRAHEDRON, 4, 2), np.array(expected)[:, :2])


def test_near_are_offsets_and_normals_of_corners() -> None:
    mesh = _tetrahedron()
    graph = surfel_graph(mesh)
    corners = corner_table(outward_faces(mesh, np.arange(4))[0], 4)
    near = _by_vertex(graph, "near").reshape(4, NEAR, 6)
    unit = graph.scale
    np.testing.assert_allclose(near[..., :3] * unit, mesh.vertices[corners] - mesh.vertices[:, None], atol=1e-6)
    np.testing.assert_array_equal(near[..., 3:], mesh.normals[corners])


def test_faces_look_where_normals_do_and_come_once() -> None:
    right = [sorted(np.roll(face, shift).tolist() for shift in range(3)) for face in TETRAHEDRON]
    broken = np.concatenate([TETRAHEDRON, TETRAHEDRON[[1]][:, ::-1], TETRAHEDRON[[0]][:, [1, 2, 0]]])
    broken[2] = broken[2, ::-1]
    faces, areas = outward_faces(_tetrahedron(broken), np.arange(4))
    np.testing.assert_allclose(areas, 2 * np.sqrt(3), rtol=1e-6)
    assert [sorted(np.roll(face, shift).tolist() for shift in range(3)) for face in faces] == right
    assert faces.dtype == np.int32


def test_vertices_at_one_place_with_one_normal_are_one(bumpy: Mesh) -> None:
    """A seam of a texture changes nothing."""
    split, of = split_mesh(bumpy)
    whole, graph = surfel_graph(bumpy), surfel_graph(split)
    assert len(of) > 320
    jax.tree.map(np.testing.assert_array_equal, graph.parts, whole.parts)
    np.testing.assert_array_equal(graph.records, whole.records)
    np.testing.assert_array_equal(graph.slot, whole.slot[of])
    # two sides of a hard edge are two vertices: here all copies look elsewhere
    hard = split.normals.copy()
    hard[len(bumpy.vertices) :] *= -1
    two = surfel_graph(split._replace(normals=hard))
    assert len(np.unique(two.slot)) == len(of) == sum(len(part["normal"]) for part in two.parts)
    np.testing.assert_array_equal(_by_vertex(two, "normal"), hard)


def test_loose_vertices_and_zero_normals() -> None:
    mesh = _tetrahedron()
    vertices = np.concatenate([mesh.vertices, [[1e6, 0, 0]]]).astype(np.float32)
    normals = np.concatenate([mesh.normals, np.zeros((1, 3))]).astype(np.float32)
    normals[1] = 0
    mesh = Mesh(vertices, normals, TETRAHEDRON)
    graph = surfel_graph(mesh)
    assert _finite(graph)
    positions = _by_vertex(graph, "position")
    # within the box of the rest, and its own only corner
    np.testing.assert_allclose(np.abs(positions[:4]).max(), positions[4, 0], rtol=1e-6)
    near = _by_vertex(graph, "near")
    np.testing.assert_array_equal(near[4], 0)
    alone = surfel_graph(_tetrahedron())
    np.testing.assert_allclose(positions[:4], _by_vertex(alone, "position"), atol=1e-6)


@pytest.mark.parametrize("fold", [0.0, 1.0])
def test_two_triangles_are_enough(fold: float) -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, fold]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    graph = surfel_graph(Mesh(vertices, angle_weighted_normals(vertices, faces).astype(np.float32), faces))
    assert _finite(graph) and sum(len(part["normal"]) for part in graph.parts) == 4
    for part in graph.parts:
        assert np.all((graph.records[part["table"], 6] > 0) == (part["weight"] > 0))


def test_a_mesh_without_area_has_a_graph() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32)
    graph = surfel_graph(Mesh(vertices, np.zeros_like(vertices), np.array([[0, 1, 2]], np.int32)))
    assert _finite(graph) and len(graph.parts[0]["normal"]) == 3
    np.testing.assert_array_equal(with_surfels(graph.parts[0], graph.records)["surfel"], 0)
    np.testing.assert_array_equal(graph.parts[0]["weight"], 0)


def test_a_plan_serves_moved_vertices_under_jit(bumpy: Mesh) -> None:
    positions = normalised(bumpy)[0]
    plan, records = plan_surfels(bumpy, positions)

    @jax.jit
    def traced(p: jax.Array, n: jax.Array) -> tuple:
        found = surfel_records(plan.tree, p, plan.faces, jnp)
        return tuple(with_surfels(part, found, jnp) for part in part_arrays(plan, p, n, jnp))

    moved = (positions * np.array([1.1, 0.9, 1], np.float32)).astype(np.float32)
    for own, known in ((positions, records), (moved, surfel_records(plan.tree, moved, plan.faces))):
        plain = tuple(with_surfels(part, known) for part in part_arrays(plan, own, bumpy.normals))
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), traced(own, bumpy.normals), plain)
