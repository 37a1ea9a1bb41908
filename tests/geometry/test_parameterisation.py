import numpy as np
import pytest

from gash_jax.geometry import parameterisation as p
from gash_jax.geometry.disks import Disk, as_disk
from gash_jax.geometry.mesh import Mesh, MeshError, transform
from gash_jax.geometry.stretch import signed_areas, total_stretch
from gash_jax.shapes.primitives import bumpy_sphere, plane, torus
from tests.helpers.bumpy import bumpy_mesh, random_rotation
from tests.helpers.shared_data import shared_file

METHODS = ("harmonic", "stretch")


def _wavy(columns: int = 9) -> Mesh:
    """A square sheet with hills, irregular so that no two vertices are alike."""
    sheet, rng = plane(1.0, columns), np.random.default_rng(0)
    points = sheet.vertices + rng.uniform(-0.02, 0.02, sheet.vertices.shape).astype(np.float32)
    points[:, 1] += 0.5 * np.exp(-30 * ((points[:, 0] - 0.1) ** 2 + points[:, 2] ** 2))
    return sheet._replace(vertices=points.astype(np.float32))


def _finger() -> Mesh:
    """A sheet with a long finger: the harmonic map crowds it into a point."""
    sheet = plane(1.0, 16)
    height = 3 * np.clip(1 - 3.2 * np.hypot(sheet.vertices[:, 0], sheet.vertices[:, 2]), 0, None) ** 0.5
    return sheet._replace(vertices=sheet.vertices + np.outer(height, [0, 1, 0]).astype(np.float32))


def _interior(found: p.SquareMap) -> np.ndarray:
    return np.setdiff1d(np.arange(len(found.uv)), found.disk.loop)


@pytest.mark.parametrize("method", METHODS)
def test_a_square_grid_maps_to_itself(method: p.Method) -> None:
    mesh = plane(2.0, 6)
    found = p.parameterise(mesh, method)
    inside = found.disk.lift.T @ found.uv
    along = mesh.vertices[:, [2, 0]] / 2 + 0.5  # counter-clockwise seen from above
    turns = [along, np.stack([1 - along[:, 1], along[:, 0]], 1), 1 - along, np.stack([along[:, 1], 1 - along[:, 0]], 1)]
    assert min(np.abs(inside - turned).max() for turned in turns) < 1e-6
    assert total_stretch(found.uv, found.disk.points, found.disk.faces) == pytest.approx(1, abs=1e-6)


def test_a_pyramid_by_hand() -> None:
    """Base corners at the corners of the square; the apex is the weighted mean of them."""
    corners = np.array([[1.0, 0, 1], [1, 0, -1], [-1, 0, -1], [-1, 0, 1], [0.5, 1, 0]], np.float32)
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]], np.int32)
    found = p.parameterise(Mesh(corners, np.zeros_like(corners), faces), "harmonic")
    spokes = corners[:4].astype(np.float64) - corners[4]
    weights = np.zeros(4)
    for i in range(4):
        for j in ((i + 1) % 4, (i - 1) % 4):  # the angle at j, opposite the spoke i
            u, w = -spokes[j], spokes[i] - spokes[j]
            weights[i] += u @ w / np.linalg.norm(np.cross(u, w)) / 2
    expected = weights @ found.uv[:4] / weights.sum()
    assert found.weights == "cotangent" and found.split_edges == 0
    np.testing.assert_allclose(found.uv[4], expected, atol=1e-12)
    assert sorted(map(tuple, found.uv[:4])) == [(0, 0), (0, 1), (1, 0), (1, 1)]


def test_mean_value_weights_by_hand() -> None:
    """A right isosceles triangle: tan(45 / 2) at its acute corners, tan(45) at the right one."""
    corners = np.array([[0.0, 0, 0], [0, 0, 2], [2, 0, 0]], np.float32)
    disk = as_disk(Mesh(corners, np.zeros_like(corners), np.array([[0, 1, 2]], np.int32)))
    found, acute = p.edge_weights(disk, "mean value").toarray(), np.sqrt(2) - 1
    expected = [[0, 0.5, 0.5], [acute / 2, 0, acute / 8**0.5], [acute / 2, acute / 8**0.5, 0]]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_uniform_weights_give_the_mean_of_the_neighbours() -> None:
    disk = as_disk(_wavy())
    border = p.border_positions(disk)
    weights = p.edge_weights(disk, "uniform")
    uv = p.solve_interior(weights, disk.loop, border)
    for vertex in np.setdiff1d(np.arange(len(uv)), disk.loop)[::7]:
        around = np.setdiff1d(disk.faces[(disk.faces == vertex).any(axis=1)], [vertex])
        np.testing.assert_allclose(uv[vertex], uv[around].mean(axis=0), atol=1e-12)


def test_the_border_goes_by_length() -> None:
    disk = as_disk(_wavy())
    border = p.border_positions(disk)
    at = {tuple(corner): int(np.flatnonzero((border == corner).all(axis=1))[0]) for corner in np.eye(2).astype(int)}
    first = int(np.flatnonzero((border == 0).all(axis=1))[0])
    ring, uv = np.roll(disk.points[disk.loop], -first, axis=0), np.roll(border, -first, axis=0)
    end = (at[(1, 0)] - first) % len(ring)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(ring[: end + 1], axis=0), axis=1))])
    np.testing.assert_allclose(uv[: end + 1, 0], along / along[-1], atol=1e-12)
    assert (uv[: end + 1, 1] == 0).all() and abs(end - len(ring) / 4) <= 1


@pytest.mark.parametrize("long", range(5))
def test_corners_stay_apart_where_vertices_crowd(long: int) -> None:
    """A pentagon with four corners close together: the nearest vertices to the quarters of its loop coincide."""
    angle = np.concatenate([np.linspace(0, 0.1, 4), [np.pi]])
    ring = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=1)[np.roll(np.arange(5), long)]
    points = np.append(ring, [[0.4, 0.1, 0]], axis=0).astype(np.float32)
    faces = np.array([[i, (i + 1) % 5, 5] for i in range(5)], np.int32)
    disk = as_disk(Mesh(points, np.zeros_like(points), faces))
    border = p.border_positions(disk)
    turned = np.roll(border, -int(np.flatnonzero((border == 0).all(axis=1))[0]), axis=0)
    corners = turned[np.isin(turned, [0, 1]).all(axis=1)]
    np.testing.assert_array_equal(corners, [[0, 0], [1, 0], [1, 1], [0, 1]])
    assert len(np.unique(border, axis=0)) == 5


def test_a_seam_that_cannot_be_mapped_is_not_made(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh, plain = _finger(), p._less_stretched

    def fails(disk: Disk, seams: int) -> tuple[p.SquareMap, float]:
        if seams:
            raise MeshError("faces of the mesh vanish")
        return plain(disk, seams)

    monkeypatch.setattr(p, "_less_stretched", fails)
    assert p.parameterise(mesh).seams == 0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "mesh",
    [_wavy(), _finger(), bumpy_sphere(9), bumpy_mesh(300), torus(segments=16, rings=9)],
    ids=["wavy", "finger", "bumpy", "star", "torus"],
)
def test_no_face_is_flipped_and_the_square_is_full(mesh: Mesh, method: p.Method) -> None:
    found = p.parameterise(mesh, method)
    areas = signed_areas(found.uv, found.disk.faces)
    assert areas.min() > 0
    assert areas.sum() == pytest.approx(1, abs=1e-12)
    assert found.uv.min() == 0 and found.uv.max() == 1
    sources = np.sort(np.unique(found.disk.face_of))
    np.testing.assert_array_equal(sources, np.arange(len(mesh.faces)))


def test_cotangents_that_flip_faces_are_replaced() -> None:
    sheet = plane(1.0, 6)
    squeezed = sheet._replace(vertices=sheet.vertices.copy())
    inner = np.flatnonzero(np.abs(sheet.vertices[:, [0, 2]]).max(axis=1) < 0.4)
    squeezed.vertices[inner, 1] += np.random.default_rng(3).uniform(-2, 2, len(inner)).astype(np.float32)
    disk = as_disk(squeezed)
    border = p.border_positions(disk)
    flipped = p.solve_interior(p.edge_weights(disk, "cotangent"), disk.loop, border)
    assert signed_areas(flipped, disk.faces).min() < 0
    found = p.parameterise(squeezed, "harmonic")
    assert found.weights == "mean value" and signed_areas(found.uv, found.disk.faces).min() > 0


def _eared() -> Mesh:
    """A grid with two faces added in the middle of one side: ears, the second on the first."""
    grid = plane(1.0, 8)
    row = np.flatnonzero(np.isclose(grid.vertices[:, 0], 0.5))
    a, b = row[np.argsort(grid.vertices[row, 2])][3:5]
    points = np.concatenate([grid.vertices, [[0.55, 0, 0.0], [0.57, 0, 0.03]]]).astype(np.float32)
    up = np.array([[a, b, 81], [b, 82, 81]])
    if np.cross(points[b] - points[a], points[81] - points[a])[1] < 0:
        up = up[:, [0, 2, 1]]
    return Mesh(points, np.zeros_like(points), np.concatenate([grid.faces, up]).astype(np.int32))


@pytest.mark.parametrize("method", METHODS)
def test_faces_on_one_side_of_the_square_are_rescued_and_counted(method: p.Method) -> None:
    mesh = _eared()
    disk = as_disk(mesh)
    bare = p.solve_interior(p.edge_weights(disk, "uniform"), disk.loop, p.border_positions(disk))
    assert np.isclose(signed_areas(bare, disk.faces), 0, atol=1e-15).sum() == 2
    found = p.parameterise(mesh, method)
    assert found.flat_faces == 2 and found.split_edges == 2
    assert signed_areas(found.uv, found.disk.faces).min() > 1e-9
    assert np.bincount(found.disk.face_of)[-2:].tolist() == [3, 2]  # cut at two middles, and at one
    np.testing.assert_allclose(found.disk.lift @ mesh.vertices, found.disk.points, atol=1e-6)


def test_faces_are_cut_at_any_of_their_middles() -> None:
    corners = np.array([[0.0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]])
    for pattern in range(8):
        middle = np.where([pattern & 1, pattern & 2, pattern & 4], [3, 4, 5], -1)[None]
        faces, parent = p._cut_faces(np.array([[0, 1, 2]]), middle)
        areas = signed_areas(corners, faces)
        assert len(faces) == 1 + pattern.bit_count() and areas.min() > 0 and areas.sum() == pytest.approx(0.5)
        assert set(parent) == {0} and set(faces.ravel()) == {0, 1, 2, *middle[middle >= 0]}


@pytest.mark.parametrize("method", METHODS)
def test_rigid_motion_and_scale_change_nothing(method: p.Method) -> None:
    mesh = _wavy()
    moved = transform(mesh, random_rotation(1), np.array([5.0, -2, 1]), 8.0)
    found, again = p.parameterise(mesh, method), p.parameterise(moved, method)
    np.testing.assert_allclose(again.uv, found.uv, atol=2e-5)  # float32 positions five sizes from the origin


@pytest.mark.parametrize("mesh", [_wavy(), bumpy_mesh(200)], ids=["open", "closed"])
def test_permuted_vertices_permute_the_map(mesh: Mesh) -> None:
    order = np.random.default_rng(0).permutation(len(mesh.vertices))
    place = np.argsort(order).astype(np.int32)
    found = p.parameterise(mesh, "stretch")
    again = p.parameterise(mesh._replace(vertices=mesh.vertices[order], faces=place[mesh.faces]), "stretch")
    # of the same face the same corners: seams part the vertices of a closed mesh
    np.testing.assert_array_equal(again.disk.face_of, found.disk.face_of)
    np.testing.assert_allclose(again.uv[again.disk.faces], found.uv[found.disk.faces], atol=1e-8)


def test_less_stretch_is_less() -> None:
    plain, better = (p.parameterise(_finger(), method) for method in METHODS)
    stretch = [total_stretch(found.uv, found.disk.points, found.disk.faces) for found in (plain, better)]
    assert stretch[1] < 0.5 * stretch[0] and stretch[1] >= 1 and better.steps > 0
    smallest = [signed_areas(found.uv, found.disk.faces).min() for found in (plain, better)]
    assert smallest[1] > 5 * smallest[0]


def test_a_seam_is_made_where_it_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = _finger()
    found = p.parameterise(mesh)
    monkeypatch.setattr(p, "MOST_SEAMS", 0)
    without = p.parameterise(mesh)
    assert found.seams > 0 == without.seams and len(found.disk.loop) > len(without.disk.loop)
    stretch = [total_stretch(m.uv, m.disk.points, m.disk.faces) for m in (found, without)]
    assert stretch[0] < stretch[1]


def test_the_harmonic_map_is_that_of_libigl() -> None:
    igl = pytest.importorskip("igl", reason="needs libigl, the oracle of the harmonic map")
    mesh = _wavy()
    disk = as_disk(mesh)
    border = p.border_positions(disk)
    own = p.solve_interior(p.edge_weights(disk, "cotangent"), disk.loop, border)
    other = igl.harmonic(disk.points, disk.faces.astype(np.int64), disk.loop.astype(np.int64), border, 1)
    np.testing.assert_allclose(own, other, atol=1e-12)


def test_the_harmonic_map_is_that_of_a_dense_solver() -> None:
    disk = as_disk(_wavy(5))
    count, border = len(disk.points), p.border_positions(disk)
    matrix = np.zeros((count, count))
    for face in disk.faces:
        for turn in range(3):
            i, j, k = np.roll(face, -turn)
            u, w = disk.points[j] - disk.points[i], disk.points[k] - disk.points[i]
            half = u @ w / np.linalg.norm(np.cross(u, w)) / 2
            for a, b in ((j, k), (k, j)):
                matrix[a, a], matrix[a, b] = matrix[a, a] + half, matrix[a, b] - half
    target = np.zeros((count, 2))
    matrix[disk.loop] = np.eye(count)[disk.loop]
    target[disk.loop] = border
    own = p.solve_interior(p.edge_weights(disk, "cotangent"), disk.loop, border)
    np.testing.assert_allclose(own, np.linalg.solve(matrix, target), atol=1e-12)


def test_what_cannot_be_mapped_is_refused() -> None:
    corner = np.eye(3, dtype=np.float32)
    with pytest.raises(MeshError, match="the boundary of the mesh has 3 edges: a square needs 4"):
        p.parameterise(Mesh(corner, corner, np.array([[0, 1, 2]], np.int32)))


@pytest.mark.parametrize("name", ["ict_face_skin.ply", "spot.ply"])
def test_real_meshes_map_without_flips(name: str) -> None:
    from gash_jax.formats.meshes import load_mesh

    found = p.parameterise(load_mesh(shared_file(f"meshes/{name}")), "harmonic")
    areas = signed_areas(found.uv, found.disk.faces)
    assert areas.min() > 0 and areas.sum() == pytest.approx(1)
    assert found.disk.filled_loops == (3 if name.startswith("ict") else 0)
