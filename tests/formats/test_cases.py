"""The inputs that once went wrong, one of each kind: each with the value worked out apart from this project."""

from collections.abc import Callable

import numpy as np
import pytest

from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.health import HealthReport
from gash_jax.geometry.mesh import Mesh, MeshError, face_areas, vector_areas
from gash_jax.prt.bake import bake_transfer
from tests.geometry.mesh_files import CUBE
from tests.helpers.shared_data import shared_case

UNOCCLUDED = np.sqrt(4 * np.pi)  # times t_0: the share of the light that arrives


def _read(name: str) -> tuple[Mesh, HealthReport]:
    return read_mesh(shared_case(name))


def _area(mesh: Mesh) -> float:
    return float(face_areas(mesh.vertices, mesh.faces).sum())


def _volume(mesh: Mesh) -> float:
    vectors = vector_areas(mesh.vertices, mesh.faces)
    return float(np.einsum("fi,fi->", vectors, mesh.vertices[mesh.faces].mean(axis=1, dtype=np.float64)) / 3)


def _is_cube(mesh: Mesh, times: int = 1) -> None:
    assert len(mesh.faces) == 12 * times
    assert _area(mesh) == pytest.approx(6 * times) and _volume(mesh) == pytest.approx(times)


def test_concave_caps() -> None:
    """The transfer is that of the same prism in triangles; the floor of the notch sees 0.96 of the sky."""
    mesh, report = _read("concave_u0.obj")
    assert len(mesh.faces) == 28 and _area(mesh) == pytest.approx(30)
    assert "concave or straight corners" in report.lines()[0]
    found, expected = (
        bake_transfer(_read(name)[0], rays=256).coefficients for name in ("concave_u0.obj", "reference_u_triangles.obj")
    )
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(UNOCCLUDED * found[[4, 5, 12, 13], 0], 0.96, atol=0.02)


def test_a_wall_with_a_window() -> None:
    """The floor, 0.01 above that of the room, is lit through the window alone."""
    mesh, _ = _read("room_keyhole.obj")
    floor = np.isclose(mesh.vertices[:, 1], 0.01)
    on_floor = floor[mesh.faces].all(axis=1)
    assert floor.sum() == 25 and len(mesh.faces) == 50
    assert _area(mesh) == pytest.approx(86, abs=0.3)
    light = UNOCCLUDED * bake_transfer(mesh, rays=1024).coefficients[floor, 0]
    assert light.min() > 0.01 and light.max() < 0.2
    reference = UNOCCLUDED * bake_transfer(_read("reference_room_quads.obj")[0], rays=1024).coefficients[floor, 0]
    np.testing.assert_allclose(light, reference, atol=1e-6)
    assert on_floor.sum() == 32


def test_an_arrowhead_and_a_corner_amid_an_edge() -> None:
    dart, _ = _read("dart_reflex1.obj")
    assert _area(dart) == pytest.approx(2)
    np.testing.assert_allclose(dart.normals, np.tile([0, 1, 0], (4, 1)), atol=1e-7)
    straight, report = _read("collinear_first.obj")
    assert report.counts["degenerate_faces"] == report.counts["vertices_without_normal"] == 0
    np.testing.assert_allclose(UNOCCLUDED * bake_transfer(straight, rays=64).coefficients[:, 0], 1.0, atol=1e-5)


@pytest.mark.parametrize(
    "name", ["bom.obj", "slash_one.obj", "glued.off", "cr.ply", "nulpad.glb", "comment_backslash.obj", "trailing.stl"]
)
def test_the_cube(name: str) -> None:
    mesh, report = _read(name)
    _is_cube(mesh)
    checks: dict[str, Callable[[], bool]] = {
        "comment_backslash.obj": lambda: report.counts["isolated_vertices"] == 1 and len(mesh.vertices) == 9,
        "trailing.stl": lambda: "after the last facet" in report.lines()[0],
    }
    assert checks.get(name, lambda: report.lines() == [] and np.array_equal(mesh.vertices, CUBE))()


def test_three_cubes_by_instances_and_one_morphed() -> None:
    mesh, _ = _read("instancing_used.glb")
    _is_cube(mesh, times=3)
    tall, report = _read("morph_weight1.glb")
    assert np.ptp(tall.vertices[:, 1]) == 2 and _volume(tall) == pytest.approx(2)
    assert "morph targets" in report.lines()[0]


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("short_vertex_row.ply", "line 11 of the PLY file"),
        ("split_rows.ply", "line 18 of the PLY file"),
        ("draco_used_only.glb", "compressed with KHR_draco_mesh_compression"),
        ("unknown_required.glb", "requires the glTF extension ACME_secret_geometry"),
    ],
)
def test_what_is_refused(name: str, words: str) -> None:
    with pytest.raises(MeshError, match=words) as error:
        _read(name)
    assert "\n" not in str(error.value)
