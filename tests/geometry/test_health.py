import json
import re

import numpy as np
import pytest

from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.health import HealthReport, prepare_mesh
from gash_jax.geometry.mesh import Mesh, MeshError, angle_weighted_normals, concatenate, transform, vector_areas
from gash_jax.shapes.primitives import box, bumpy_sphere, icosphere, plane, spherical_bowl
from tests.helpers.bumpy import random_rotation
from tests.helpers.shared_data import SHARED, shared_file

BALL = icosphere(2)
ROW = re.compile(r"^\| (\w+)\.ply \| \w+ \| (\d+) \| (\d+) \| (.*) \|$")
COLUMNS = {  # as the table of the data folder words its counts
    "boundary_edges": r"open \((\d+) boundary edges\)",
    "non_manifold_edges": r"(\d+) non-manifold edges",
    "non_manifold_vertices": r"(\d+) non-manifold vertices",
    "degenerate_faces": r"(\d+) degenerate faces",
    "duplicate_faces": r"(\d+) duplicate faces",
    "inconsistent_winding": r"(\d+) inconsistent winding",
    "isolated_vertices": r"(\d+) isolated vertices",
}


def _table() -> list[tuple[str, ...]]:
    readme = SHARED / "data" / "README.md"
    lines = readme.read_text().splitlines() if readme.exists() else []
    return [match.groups() for match in map(ROW.match, lines) if match]


def _facing(mesh: Mesh) -> float:
    """Volume by the vertex normals instead of the winding: positive if they point outward on the whole."""
    centre = mesh.vertices[mesh.faces].mean(axis=(0, 1), dtype=np.float64)
    area = np.linalg.norm(vector_areas(mesh.vertices, mesh.faces), axis=1)
    middle = mesh.vertices[mesh.faces].mean(axis=1, dtype=np.float64) - centre
    return float(np.einsum("f,fi,fi->", area, middle, mesh.normals[mesh.faces].mean(axis=1, dtype=np.float64)))


@pytest.mark.parametrize(("name", "vertices", "faces", "odd"), _table() or [("spot", "2930", "5856", "clean")])
def test_real_meshes_are_counted_as_their_table_says(name: str, vertices: str, faces: str, odd: str) -> None:
    mesh, report = read_mesh(shared_file(f"meshes/{name}.ply"))
    assert (report.vertices, report.faces) == (len(mesh.vertices), len(mesh.faces)) == (int(vertices), int(faces))
    for count, pattern in COLUMNS.items():
        match = re.search(pattern, odd)
        assert report.counts[count] == (int(match[1]) if match else 0), count
    parts = re.search(r"(\d+) parts", odd)
    assert report.parts == (int(parts[1]) if parts else 1)
    assert report.watertight == ("open (" not in odd and "not watertight" not in odd)
    assert report.planar == ("planar" in odd)
    if "clean" in odd:
        assert report.lines() == []
    if name not in ("soup", "truck"):  # loose triangles and a polygon soup have no outside
        assert report.counts["inward_surfaces"] == (
            0 if name not in ("horse", "chair") else report.counts["inward_surfaces"]
        )
        assert _facing(mesh) > 0 or report.planar
    assert np.all(np.abs(np.linalg.norm(mesh.normals[np.unique(mesh.faces)], axis=1) - 1) < 1e-6)


def test_horse_is_turned_and_says_so() -> None:
    mesh, report = read_mesh(shared_file("meshes/horse.ply"))
    computed = angle_weighted_normals(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(mesh.normals, -computed, atol=1e-6)
    assert report.lines() == ["1 surface whose normals point inward: flipped for the bake; faces left as they are"]


def test_bunny_has_five_holes() -> None:
    assert read_mesh(shared_file("meshes/stanford_bunny.ply"))[1].counts["boundary_loops"] == 5


@pytest.mark.parametrize("name", ["spot", "brain_pial_both", "stanford_bunny", "quadknot", "ogre"])
def test_real_meshes_inside_out_get_the_same_normals(name: str) -> None:
    mesh, _ = read_mesh(shared_file(f"meshes/{name}.ply"))
    turned, report = prepare_mesh(mesh.vertices, mesh.faces[:, ::-1])
    np.testing.assert_allclose(turned.normals, mesh.normals, atol=1e-6)
    np.testing.assert_array_equal(turned.faces, mesh.faces[:, ::-1])
    assert report.counts["inward_surfaces"] > 0


def test_perfect_health() -> None:
    mesh, report = prepare_mesh(BALL.vertices, BALL.faces)
    assert report.lines() == [] and report.watertight and not report.planar and report.parts == 1
    assert report.normals == "computed" and not any(report.counts.values())
    assert mesh.vertices.dtype == mesh.normals.dtype == np.float32 and mesh.faces.dtype == np.int32
    np.testing.assert_array_equal(mesh.vertices, BALL.vertices)
    np.testing.assert_array_equal(mesh.faces, BALL.faces)


def _broken() -> tuple[np.ndarray, np.ndarray]:
    """A ball with one of everything."""
    points = np.concatenate([BALL.vertices, [[5, 5, 5], [6, 6, 6], [0, 3, 0]]]).astype(np.float32)
    apex = len(BALL.vertices) + 2
    a, b, c = BALL.faces[0].tolist()
    extra = [[b, a, c], [b, c, a], [7, 7, 9], [a, b, apex]]
    faces = np.concatenate([BALL.faces, extra])
    faces[10] = faces[10, ::-1]
    return points, faces


def test_everything_is_counted_and_nothing_repaired() -> None:
    points, faces = _broken()
    mesh, report = prepare_mesh(points, faces)
    np.testing.assert_array_equal(mesh.vertices, points)
    np.testing.assert_array_equal(mesh.faces, faces)
    count = len(BALL.faces)
    expected = {"degenerate_faces": 1, "duplicate_faces": 2, "isolated_vertices": 2, "boundary_edges": 2}
    assert {name: report.counts[name] for name in expected} == expected
    assert report.first["duplicate_faces"] == [count, count + 1]
    assert report.first["degenerate_faces"] == [count + 2]
    assert report.first["isolated_vertices"] == [len(BALL.vertices), len(BALL.vertices) + 1]
    assert report.counts["non_manifold_edges"] >= 3 and report.counts["inconsistent_winding"] > 3
    assert report.counts["rewound_faces"] == 1 and report.counts["boundary_loops"] == 1
    assert not report.watertight
    assert len(report.lines()) == sum(report.counts[name] > 0 for name in report.counts) - 1  # no line for loops
    unaffected = np.setdiff1d(np.arange(len(BALL.vertices)), BALL.faces[0])
    expected_normals = angle_weighted_normals(BALL.vertices, BALL.faces)
    np.testing.assert_allclose(mesh.normals[unaffected], expected_normals[unaffected], atol=1e-6)
    np.testing.assert_array_equal(mesh.normals[-3:-1], np.zeros((2, 3)))


def test_report_as_data() -> None:
    report = prepare_mesh(*_broken())[1]
    assert isinstance(report, HealthReport)
    data = json.loads(json.dumps(report.to_dict()))
    assert data["duplicate_faces"] == 2 and data["one_sided_surfaces"] == 0 and data["vertices"] == report.vertices
    assert data["first"]["duplicate_faces"] == report.first["duplicate_faces"]
    assert data["notes"] == report.lines()


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("seed", [0, 1])
def test_size_and_orientation_do_not_matter(scale: float, seed: int) -> None:
    rotation = random_rotation(seed)
    mesh, report = prepare_mesh(*transform(bumpy_sphere(6), rotation, np.ones(3) * scale, scale)[::2])
    expected = prepare_mesh(*bumpy_sphere(6)[::2])[0].normals @ rotation.T
    np.testing.assert_allclose(mesh.normals, expected, atol=2e-4 if scale != 1 else 2e-6)
    assert report.lines() == []


def test_far_from_the_origin_in_double_precision() -> None:
    """The normals are exact, the float32 positions cannot be: this is said."""
    far = BALL.vertices.astype(np.float64) + [1e6, -1e6, 1e6]
    mesh, report = prepare_mesh(far, BALL.faces[:, ::-1])
    np.testing.assert_allclose(mesh.normals, prepare_mesh(BALL.vertices, BALL.faces)[0].normals, atol=1e-6)
    assert report.counts["inward_surfaces"] == 1
    assert any("far from the origin" in line for line in report.lines())
    assert not any("far" in line for line in prepare_mesh(far - [1e6 - 10, -1e6, 1e6], BALL.faces)[1].lines())


def test_an_isolated_vertex_far_away_changes_nothing() -> None:
    points = np.concatenate([BALL.vertices, [[1e30, 0, 0]]]).astype(np.float32)
    mesh, report = prepare_mesh(points, BALL.faces)
    np.testing.assert_array_equal(mesh.normals[:-1], prepare_mesh(BALL.vertices, BALL.faces)[0].normals)
    assert report.counts["degenerate_faces"] == 0 and len(report.lines()) == 1


@pytest.mark.parametrize("seed", [0, 1])
def test_flat_meshes_in_any_direction(seed: int) -> None:
    flat = transform(plane(2.0, 4), random_rotation(seed), np.array([3.0, 2, 1]))
    assert prepare_mesh(flat.vertices, flat.faces)[1].planar
    bent = flat.vertices + np.float32(1e-4) * flat.normals * (np.arange(25) % 2)[:, None]
    assert not prepare_mesh(bent, flat.faces)[1].planar


def test_file_normals_are_reported() -> None:
    assert prepare_mesh(BALL.vertices, BALL.faces, BALL.normals)[1].lines() == []
    mesh, report = prepare_mesh(BALL.vertices, BALL.faces, -BALL.normals)
    assert report.normals == "file" and report.counts["flipped_file_normals"] == len(BALL.vertices)
    np.testing.assert_allclose(mesh.normals, BALL.normals, atol=1e-6)
    outward = prepare_mesh(BALL.vertices, BALL.faces[:, ::-1], BALL.normals)[1]
    assert [line for line in outward.lines() if "faces point inward" in line] == outward.lines() != []
    holes = BALL.normals.copy()
    holes[7] = 0
    assert prepare_mesh(BALL.vertices, BALL.faces, holes)[1].first == {"replaced_file_normals": [7]}


def test_open_and_seamed_surfaces_are_named() -> None:
    bowl = spherical_bowl(1.0, 8)
    assert prepare_mesh(bowl.vertices, bowl.faces)[1].counts["doubtful_surfaces"] == 1
    assert prepare_mesh(bowl.vertices, bowl.faces, bowl.normals)[1].counts["doubtful_surfaces"] == 0
    six = prepare_mesh(*box()[::2])[1]
    assert six.counts["seamed_surfaces"] == 1 and six.parts == 6 == six.counts["boundary_loops"]
    two = concatenate([BALL, transform(BALL, translation=np.array([5.0, 0, 0]))])
    assert prepare_mesh(two.vertices, two.faces)[1].counts["separate_parts"] == 2


ONE = np.array([[0, 1, 2]])
POINTS = np.eye(3)


@pytest.mark.parametrize(
    ("vertices", "faces", "normals", "message"),
    [
        (np.zeros((0, 3)), ONE, None, "no vertices"),
        (POINTS, np.zeros((0, 3), int), None, "no faces"),
        (np.array([[0, 0, np.nan], [1, 0, 0], [0, 1, 0]]), ONE, None, r"1 of 3 vertices are not finite \(first: 0\)"),
        (np.array([[0, 0, 1], [np.inf, 0, 0], [0, 1, 0]]), ONE, None, "not finite"),
        (np.array([[0, 0, 1], [1e39, 0, 0], [0, 1, 0]]), ONE, None, "not finite"),
        (POINTS, np.array([[0, 1, 2], [0, 1, 3]]), None, r"1 of 2 faces .*first: face 1 \[0, 1, 3\]"),
        (POINTS, np.array([[0, 1, -1]]), None, "does not exist"),
        (np.eye(4), ONE, None, r"shape \(v, 3\)"),
        (np.ones(9), ONE, None, r"shape \(v, 3\)"),
        (np.array([["a", "b", "c"]]), ONE, None, "real numbers"),
        (POINTS + 0j, ONE, None, "real numbers"),
        (POINTS, np.array([[0, 1, 2, 3]]), None, r"shape \(f, 3\)"),
        (POINTS, np.array([[0.0, 1, 2]]), None, "integers"),
        (POINTS, ONE, np.zeros((2, 3)), "one per vertex"),
        (np.ones((3, 3)), ONE, None, "no size"),
    ],
)
def test_what_cannot_be_used(vertices, faces, normals, message: str) -> None:
    with pytest.raises(MeshError, match=message) as caught:
        prepare_mesh(vertices, faces, normals)
    assert isinstance(caught.value, ValueError) and "\n" not in str(caught.value)


def test_a_mesh_of_slivers_only_is_reported() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])
    mesh, report = prepare_mesh(points, np.array([[0, 1, 2], [1, 2, 3], [0, 0, 1]]))
    assert report.counts["degenerate_faces"] == 3 and report.counts["vertices_without_normal"] == 4
    np.testing.assert_array_equal(mesh.normals, np.zeros((4, 3)))
