"""The graph of blocks: shapes, slots, corners by hand, faces put in order, and meshes with hardly anything in them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, angle_weighted_normals
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.graph.surfel_graph import (
    NEAR,
    SurfelGraph,
    block_arrays,
    corner_table,
    normalised,
    outward_faces,
    plan_surfels,
    surfel_graph,
)
from gash_jax.graph.surfel_selection import BLOCK
from gash_jax.graph.surfels import surfel_records
from tests.helpers.bumpy import bumpy_mesh
from tests.helpers.split import split_mesh

TETRAHEDRON = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]], np.int32)


def _tetrahedron(faces: np.ndarray = TETRAHEDRON) -> Mesh:
    vertices = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32)
    return Mesh(vertices, (vertices / np.sqrt(3)).astype(np.float32), faces)


def _finite(graph: object) -> bool:
    return all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(graph))


def test_shapes_and_types(bumpy: Mesh) -> None:
    graph = surfel_graph(bumpy, 24)
    blocks = -(-300 // BLOCK)
    shapes = {name: leaf.shape for name, leaf in graph.blocks.items()}
    expected = {"position": (blocks, BLOCK, 3), "normal": (blocks, BLOCK, 3), "near": (blocks, BLOCK, NEAR * 6)}
    assert shapes == {**expected, "surfel": (blocks, 24, 20)}
    assert (graph.slot.shape, graph.center.shape, graph.scale.shape) == ((300,), (3,), ())
    leaves = jax.tree.leaves(graph)
    assert all(isinstance(leaf, np.ndarray) and leaf.dtype in (np.float32, np.int32) for leaf in leaves)
    assert _finite(graph)


def test_blocks_carry_the_records_of_their_surfels(bumpy: Mesh) -> None:
    plan, records = plan_surfels(bumpy, normalised(bumpy)[0], 24)
    np.testing.assert_array_equal(surfel_graph(bumpy, 24).blocks["surfel"], records[plan.table])


def _by_vertex(graph: SurfelGraph, name: str) -> np.ndarray:
    return graph.blocks[name].reshape(-1, graph.blocks[name].shape[-1])[graph.slot]


def test_slots_lead_from_vertices_to_their_nodes(bumpy: Mesh) -> None:
    graph = surfel_graph(bumpy, 8)
    assert len(np.unique(graph.slot)) == 300
    back = _by_vertex(graph, "position") * graph.scale + graph.center
    np.testing.assert_allclose(back, bumpy.vertices, atol=1e-6)
    np.testing.assert_array_equal(_by_vertex(graph, "normal"), bumpy.normals)
    np.testing.assert_allclose(graph.scale, NormalisedMesh(bumpy).radius, rtol=1e-6)


def test_the_last_block_repeats_its_last_vertex() -> None:
    graph = surfel_graph(bumpy_mesh(BLOCK + 3), 8)
    assert graph.blocks["position"].shape == (2, BLOCK, 3)
    for name in ("position", "normal", "near"):
        leaf = graph.blocks[name].reshape(2 * BLOCK, -1)
        np.testing.assert_array_equal(leaf[BLOCK + 3 :], np.tile(leaf[BLOCK + 2], (BLOCK - 3, 1)))
    # of the repeated vertex the first node counts
    assert graph.slot.max() == BLOCK + 2


def test_corners_of_a_tetrahedron_by_hand() -> None:
    expected = [[1, 3, 2, 1, 3], [2, 0, 3, 2, 0], [0, 3, 1, 0, 3], [1, 0, 2, 1, 0]]
    np.testing.assert_array_equal(corner_table(TETRAHEDRON, 4, 5), expected)
    np.testing.assert_array_equal(corner_table(TETRAHEDRON, 4, 2), np.array(expected)[:, :2])


def test_near_are_offsets_and_normals_of_corners() -> None:
    mesh = _tetrahedron()
    graph = surfel_graph(mesh, 8)
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


def test_a_seam_of_a_texture_changes_nothing(bumpy: Mesh) -> None:
    split, of = split_mesh(bumpy)
    whole, graph = surfel_graph(bumpy, 8), surfel_graph(split, 8)
    jax.tree.map(np.testing.assert_array_equal, graph.blocks, whole.blocks)
    np.testing.assert_array_equal(graph.slot, whole.slot[of])
    # two sides of a hard edge are two vertices: here all copies look elsewhere
    hard = split.normals.copy()
    hard[len(bumpy.vertices) :] *= -1
    assert len(np.unique(surfel_graph(split._replace(normals=hard), 8).slot)) == len(of)


def test_loose_vertices_and_zero_normals() -> None:
    mesh = _tetrahedron()
    vertices = np.concatenate([mesh.vertices, [[1e6, 0, 0]]]).astype(np.float32)
    normals = np.concatenate([mesh.normals, np.zeros((1, 3))]).astype(np.float32)
    normals[1] = 0
    mesh = Mesh(vertices, normals, TETRAHEDRON)
    graph = surfel_graph(mesh, 16)
    assert _finite(graph)
    positions = _by_vertex(graph, "position")
    # within the box of the rest, and its own only corner
    np.testing.assert_allclose(np.abs(positions[:4]).max(), positions[4, 0], rtol=1e-6)
    near = _by_vertex(graph, "near")
    np.testing.assert_array_equal(near[4], 0)
    alone = surfel_graph(_tetrahedron(), 16)
    np.testing.assert_allclose(positions[:4], _by_vertex(alone, "position"), atol=1e-6)


@pytest.mark.parametrize(("fold", "count"), [(0.0, 8), (1.0, 16)])
def test_two_triangles_are_enough(fold: float, count: int) -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, fold]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
    graph = surfel_graph(Mesh(vertices, angle_weighted_normals(vertices, faces).astype(np.float32), faces), count)
    assert _finite(graph) and graph.blocks["position"].shape == (1, BLOCK, 3)
    assert np.all(graph.blocks["surfel"][..., 6] > 0)


def test_a_mesh_without_area_has_a_graph() -> None:
    vertices = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]], np.float32)
    graph = surfel_graph(Mesh(vertices, np.zeros_like(vertices), np.array([[0, 1, 2]], np.int32)), 4)
    assert _finite(graph)
    np.testing.assert_array_equal(graph.blocks["surfel"], 0)


def test_a_plan_serves_moved_vertices_under_jit(bumpy: Mesh) -> None:
    positions = normalised(bumpy)[0]
    plan, records = plan_surfels(bumpy, positions, 8)
    plain = block_arrays(plan, records, positions, bumpy.normals)

    @jax.jit
    def traced(p: jax.Array, n: jax.Array) -> dict:
        return block_arrays(plan, surfel_records(plan.tree, p, plan.faces, jnp), p, n, jnp)

    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-5), traced(positions, bumpy.normals), plain)
