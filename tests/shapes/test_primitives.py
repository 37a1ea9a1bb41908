import numpy as np
import pytest

from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, face_areas, face_normals, vector_areas
from gash_jax.shapes import primitives as p

SMOOTH = {  # and the area and volume of the exact surface
    "icosphere": (p.icosphere(4), 4 * np.pi, 4 * np.pi / 3),
    "uv_sphere": (p.uv_sphere(40, 80), 4 * np.pi, 4 * np.pi / 3),
    "torus": (p.torus(1.0, 0.4, 90, 60), 4 * np.pi**2 * 0.4, 2 * np.pi**2 * 0.16),
    "box": (p.box((1.0, 2.0, 3.0), 3), 22.0, 6.0),
}
OTHER = {
    "bumpy_sphere": p.bumpy_sphere(20),
    "bowl": p.spherical_bowl(1.0, 12),
    "plane": p.plane(2.0, 5),
    "groove": p.v_groove(1.2, 100.0, 4),
    "plates": p.two_plates(0.5, 2.0, 4),
    "sphere above plane": p.sphere_above_plane(1.0, 3.0, 4),
    "wall": p.wall(1.0, 2.0, 4),
}
ALL = {name: entry[0] for name, entry in SMOOTH.items()} | OTHER


def _volume(mesh: Mesh) -> float:
    return float(np.einsum("fi,fi->", vector_areas(mesh.vertices, mesh.faces), mesh.vertices[mesh.faces].mean(1)) / 3)


@pytest.mark.parametrize("name", ALL)
def test_faces_agree_with_unit_normals(name: str) -> None:
    mesh = ALL[name]
    assert mesh.vertices.dtype == mesh.normals.dtype == np.float32 and mesh.faces.dtype == np.int32
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)
    cosines = np.einsum("fi,fci->fc", face_normals(mesh.vertices, mesh.faces), mesh.normals[mesh.faces])
    assert cosines.min() > {"bumpy_sphere": 0.8, "bowl": 0.98}.get(name, 0.99)
    assert prepare_mesh(mesh.vertices, mesh.faces)[1].counts["isolated_vertices"] == 0


@pytest.mark.parametrize("name", SMOOTH)
def test_area_and_volume(name: str) -> None:
    mesh, area, volume = SMOOTH[name]
    assert face_areas(mesh.vertices, mesh.faces).sum() == pytest.approx(area, rel=5e-3)
    assert _volume(mesh) == pytest.approx(volume, rel=1e-2)


@pytest.mark.parametrize("name", ["icosphere", "uv_sphere", "torus", "bumpy_sphere"])
def test_closed_ones_are_in_perfect_health(name: str) -> None:
    assert prepare_mesh(ALL[name].vertices, ALL[name].faces)[1].lines() == []


def test_spheres_have_exact_normals_and_known_counts() -> None:
    for level in range(4):
        mesh = p.icosphere(level)
        assert (len(mesh.vertices), len(mesh.faces)) == (10 * 4**level + 2, 20 * 4**level)
    for resolution in (1, 2, 5, 12):
        assert len(p.bumpy_sphere(resolution).vertices) == 10 * resolution**2 + 2
    mesh = p.uv_sphere(6, 9)
    assert len(mesh.vertices) == 5 * 9 + 2
    np.testing.assert_array_equal(mesh.vertices[[0, -1]], [[0, 1, 0], [0, -1, 0]])
    for ball in (p.icosphere(2), mesh):
        np.testing.assert_array_equal(ball.normals, ball.vertices)
        np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(p.icosphere(0).vertices.mean(axis=0), 0, atol=1e-7)


def test_grid_by_hand() -> None:
    u, w, faces = p.grid(2, 1)
    np.testing.assert_array_equal(u, [0, 0.5, 1, 0, 0.5, 1])
    np.testing.assert_array_equal(w, [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(faces, [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]])


def test_plane_and_box_normals_are_those_of_their_faces() -> None:
    np.testing.assert_array_equal(p.plane(2.0, 3).normals, [[0, 1, 0]] * 16)
    np.testing.assert_array_equal(np.abs(p.plane(2.0, 3).vertices).max(axis=0), [1, 0, 1])
    box = p.box((1.0, 2.0, 4.0))
    assert len(box.vertices) == 24
    np.testing.assert_array_equal(box.normals, np.repeat(np.concatenate([[r, -r] for r in np.eye(3)]), 4, axis=0))
    np.testing.assert_allclose(np.einsum("vi,vi->v", box.vertices, box.normals), np.repeat([0.5, 1, 2], 8))


def test_bowl_is_the_inside_of_a_sphere_open_upward() -> None:
    bowl = p.spherical_bowl(np.radians(60), 10)
    np.testing.assert_array_equal(bowl.normals, -bowl.vertices)
    np.testing.assert_allclose(np.linalg.norm(bowl.vertices, axis=1), 1, atol=1e-6)
    assert bowl.vertices[:, 1].max() == pytest.approx(0.5, abs=1e-6)
    report = prepare_mesh(bowl.vertices, bowl.faces)[1]
    assert report.counts["boundary_edges"] == 40 and report.counts["boundary_loops"] == 1


def _polygon_form_factor(points: np.ndarray, normals: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Lambert's formula: |sum acos(u_i.u_{i+1}) n.(u_i x u_{i+1})/|u_i x u_{i+1}|| / 2 pi."""
    rays = polygon[None].astype(np.float64) - points[:, None]
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    after = np.roll(rays, -1, axis=1)
    cross = np.cross(rays, after)
    sine = np.linalg.norm(cross, axis=2)
    angle = np.arctan2(sine, np.einsum("pci,pci->pc", rays, after))
    return np.abs(np.einsum("pc,pci,pi->p", angle / sine, cross, normals)) / (2 * np.pi)


def _probes(scene: Mesh, resolution: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Probe vertices and normals of a scene whose occluder is one quad, and that quad in order."""
    count = (resolution + 1) ** 2
    quad = scene.vertices[count:]
    assert len(quad) == 4
    return scene.vertices[:count].astype(np.float64), scene.normals[:count].astype(np.float64), quad[[0, 1, 3, 2]]


@pytest.mark.parametrize("degrees", [30, 70, 90, 135])
def test_groove_is_nearly_endless(degrees: float) -> None:
    """The quad's exact form factor against 1 - sin²(w/2), within the stated bound and close to it."""
    opening, length = np.radians(degrees), 400.0
    points, normals, quad = _probes(p.v_groove(opening, length, 4), 4)
    np.testing.assert_array_equal(normals, [[0, 0, 1]] * 25)
    np.testing.assert_array_equal(points[:, 2], 0)
    excess = 1 - _polygon_form_factor(points, normals, quad) - np.sin(opening / 2) ** 2
    bound = (np.sin(opening) ** 2 / 2 + 0.07) * points[:, 0] / length
    assert np.all(excess > 0) and np.all(excess < bound) and excess.max() > 0.5 * bound.max()


def test_wall_is_wide_enough() -> None:
    height, distance = 1.5, 2.0
    points, normals, quad = _probes(p.wall(height, distance, 4), 4)
    d = distance + points[:, 0]
    exact = 1 - (1 - 1 / np.sqrt(1 + (height / d) ** 2)) / 2
    np.testing.assert_allclose(1 - _polygon_form_factor(points, normals, quad), exact, atol=1e-6)
    assert points[:, 0].min() == 0 and points[:, 0].max() == distance


def test_plates_face_each_other() -> None:
    points, normals, quad = _probes(p.two_plates(0.5, 2.0, 4), 4)
    middle = 12
    np.testing.assert_array_equal(points[middle], [0, 0, 0])
    a = 1 / 0.5  # rectangle at its corner, four of them
    corner = 2 * a / np.sqrt(1 + a * a) * np.arctan(a / np.sqrt(1 + a * a)) / (2 * np.pi)
    assert _polygon_form_factor(points, normals, quad)[middle] == pytest.approx(4 * corner, rel=1e-6)
    np.testing.assert_array_equal(p.two_plates(0.5, 2.0, 4).normals[25:], [[0, -1, 0]] * 4)


def test_sphere_above_plane_has_the_area_and_place_of_the_sphere() -> None:
    scene = p.sphere_above_plane(2.0, 5.0, 3)
    ball = Mesh(scene.vertices[16:] - np.array([0, 5, 0], np.float32), scene.normals[16:], scene.faces[18:] - 16)
    assert face_areas(ball.vertices, ball.faces).sum() == pytest.approx(16 * np.pi, rel=1e-6)
    np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), 2.0, rtol=2e-3)
    assert np.linalg.norm(ball.vertices, axis=1).min() > 2.0
    np.testing.assert_array_equal(np.abs(scene.vertices[:16]).max(axis=0), [1, 0, 1])


def test_bumps_are_those_of_the_formula() -> None:
    mesh = p.bumpy_sphere(8, 0.3, 5.0)
    radius = np.linalg.norm(mesh.vertices, axis=1)
    directions = mesh.vertices / radius[:, None]
    np.testing.assert_allclose(radius, 1 + 0.3 * np.sin(5 * directions).mean(axis=1), atol=1e-6)
    assert p.bumpy_sphere(8).vertices.std() > 0
