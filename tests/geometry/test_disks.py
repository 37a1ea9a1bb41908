import numpy as np
import pytest

from gash_jax.geometry.disks import as_disk, boundary_loops, with_seam
from gash_jax.geometry.mesh import Mesh, MeshError, concatenate, lengths, subdivide_midpoint
from gash_jax.geometry.topology import build_edges, repeated_directions
from gash_jax.shapes.lattices import lattice_surface
from gash_jax.shapes.primitives import icosphere, plane, torus, uv_sphere
from tests.helpers.closed_forms import flat_shaded

STRIP = np.array([[0, 1, 2], [2, 1, 3]])


def mesh_of(vertices: np.ndarray, faces: np.ndarray) -> Mesh:
    return Mesh(vertices.astype(np.float32), np.zeros((len(vertices), 3), np.float32), faces.astype(np.int32))


def holed(columns: int, *holes: int) -> Mesh:
    """A square without some of its faces."""
    mesh = plane(1.0, columns)
    return mesh._replace(faces=np.delete(mesh.faces, holes, axis=0))


def frame(windows: int) -> Mesh:
    """A closed solid with as many handles as windows."""
    filled = np.ones((2 * windows + 1, 3, 1), bool)
    filled[1::2, 1] = False
    spans = [np.arange(size + 1.0) for size in filled.shape]
    surface = lattice_surface(filled, spans, np.random.default_rng(0))
    return subdivide_midpoint(mesh_of(surface.vertices, surface.faces))


def test_loops_by_hand() -> None:
    (loop,) = boundary_loops(STRIP)
    np.testing.assert_array_equal(loop, [0, 1, 3, 2])  # faces are counter-clockwise, so they lie to its left
    outer, inner = boundary_loops(holed(3, 8).faces)
    assert len(outer) == 12 and outer[0] == 0
    np.testing.assert_array_equal(inner, [5, 10, 6])  # the missing face is 5, 6, 10
    assert boundary_loops(icosphere(1).faces) == []


@pytest.mark.parametrize(
    "mesh",
    [plane(1.0, 3), holed(7, 32, 62), icosphere(2), torus(segments=14, rings=9), frame(2), flat_shaded(icosphere(2))],
    ids=["square", "holes", "sphere", "torus", "two handles", "corners apart"],
)
def test_a_disk_has_one_loop_no_handle_and_every_face(mesh: Mesh) -> None:
    disk = as_disk(mesh)
    edges = build_edges(disk.faces, len(disk.points))
    assert not repeated_directions(edges).any() and edges.faces_at.max() == 2
    euler = len(disk.points) - len(edges.start) + len(disk.faces)
    assert euler == 1 and len(boundary_loops(disk.faces)) == 1
    np.testing.assert_array_equal(np.sort(disk.loop), np.sort(boundary_loops(disk.faces)[0]))
    np.testing.assert_allclose(disk.lift @ mesh.vertices, disk.points, atol=1e-6)
    own = disk.face_of >= 0
    np.testing.assert_array_equal(disk.face_of[own], np.arange(len(mesh.faces)))
    np.testing.assert_allclose(disk.points[disk.faces[own]], mesh.vertices[mesh.faces], atol=1e-6)


def test_all_but_the_longest_loop_are_filled_by_cones() -> None:
    mesh = holed(7, 32, 33, 62)
    disk = as_disk(mesh)
    assert disk.filled_loops == 2 and (disk.face_of < 0).sum() == 4 + 3
    assert len(disk.loop) == 28 and disk.made.sum() == 2
    for tip in np.flatnonzero(disk.made):
        rim = np.setdiff1d(disk.faces[(disk.faces == tip).any(axis=1)], [tip])
        np.testing.assert_allclose(disk.points[tip], mesh.vertices[rim].mean(axis=0), atol=1e-6)
    hole = int(boundary_loops(mesh.faces)[2][0])
    assert len(as_disk(mesh, boundary=hole).loop) == 3


def test_a_closed_body_is_cut_from_end_to_end() -> None:
    ball = uv_sphere(8, 12)
    long = ball._replace(vertices=ball.vertices * np.array([1, 3, 1], np.float32))
    disk = as_disk(long)
    assert disk.cut_edges == 8 and len(disk.loop) == 16  # along a meridian, from pole to pole
    at = disk.points[disk.loop]
    assert np.isclose(at[:, 1], 3).sum() == 1 and np.isclose(at[:, 1], -3).sum() == 1


def test_a_seam_goes_to_the_boundary_the_shortest_way() -> None:
    disk = as_disk(plane(1.0, 6))
    inside = int(lengths(disk.points - [0.0, 0, 1 / 6]).argmin())
    opened = with_seam(disk, inside)
    assert opened.cut_edges == 2 and len(opened.loop) == 24 + 4
    assert len(opened.points) == len(disk.points) + 2 and (opened.points == disk.points[inside]).all(axis=1).sum() == 1


def test_faces_that_joining_makes_thin_are_left_out() -> None:
    mesh = plane(1.0, 3)
    again = mesh._replace(vertices=np.concatenate([mesh.vertices, mesh.vertices[5:6]]))
    thin = again._replace(
        normals=np.zeros_like(again.vertices), faces=np.concatenate([mesh.faces, np.array([[5, 16, 6]], np.int32)])
    )
    disk = as_disk(thin)
    assert len(disk.faces) == len(mesh.faces) and len(disk.points) == 16
    np.testing.assert_allclose(disk.lift.sum(axis=1), 1)


def test_a_vertex_where_fans_touch_becomes_one_for_each() -> None:
    ball = icosphere(2)
    low, high = int(ball.vertices[:, 1].argmin()), int(ball.vertices[:, 1].argmax())
    pinched = ball._replace(vertices=ball.vertices.copy())
    pinched.vertices[[low, high]] = 0
    disk = as_disk(pinched)
    assert len(disk.faces) == len(ball.faces) and len(boundary_loops(disk.faces)) == 1
    copies = np.flatnonzero((disk.points == 0).all(axis=1))
    assert len(copies) >= 2
    np.testing.assert_allclose(disk.lift[copies].toarray()[:, [low, high]], 0.5)


TETRA = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, -1, 0]])


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        (concatenate([plane(1.0, 2), icosphere(1)]), "has 2 parts"),
        (mesh_of(TETRA, np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]])), "1 edges with more than two faces"),
        (mesh_of(TETRA, np.array([[0, 1, 2], [0, 1, 3]])), "1 edges whose two faces are wound against each other"),
        (mesh_of(TETRA, np.array([[0, 1, 2], [0, 3, 4]])), "has 2 parts"),  # which touch in a vertex
        (mesh_of(TETRA[[0, 0, 1]], np.array([[0, 1, 2]])), "no surface to map"),
    ],
)
def test_what_has_no_map_is_refused(mesh: Mesh, message: str) -> None:
    with pytest.raises(MeshError, match=message) as raised:
        as_disk(mesh)
    assert "\n" not in str(raised.value)


def test_the_vertex_of_a_boundary_is_checked() -> None:
    with pytest.raises(MeshError, match="vertex 5 lies on no boundary loop"):
        as_disk(plane(1.0, 3), boundary=5)
    with pytest.raises(ValueError, match="boundary is 16: use a whole number from 0 to 15"):
        as_disk(plane(1.0, 3), boundary=16)
