"""Receivers and occluders apart: points beside a mesh, shadows of what is not baked."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.formats.meshes import save_mesh
from gash_jax.geometry.health import prepare_mesh
from gash_jax.geometry.mesh import Mesh, MeshError, concatenate
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.error_target import bake_to_error
from gash_jax.prt.scene import as_points, load_points, make_scene
from gash_jax.shapes.primitives import bumpy_sphere, icosphere, patch
from tests.helpers.bumpy import random_rotation

MESH = bumpy_sphere(5)
LID = patch(np.array([-3.0, 1.6, -3.0]), np.array([6.0, 0.0, 0.0]), np.array([0.0, 0.0, 6.0]))  # faces down
LIDDED = concatenate([MESH, LID])


def _same(found: Any, expected: Any) -> None:
    np.testing.assert_array_equal(found.coefficients, expected.coefficients)
    np.testing.assert_array_equal(found.standard_error, expected.standard_error)


def test_vertices_given_as_points_get_the_bake_of_their_mesh() -> None:
    """Ray by ray: to the last bit, rows and vertices without normal included; and with points no faces."""
    blind = MESH._replace(normals=np.where(np.arange(len(MESH.vertices))[:, None] % 7 == 0, 0, MESH.normals))
    points: dict[str, Any] = {"points": blind.vertices, "normals": blind.normals}
    whole, probes = bake_transfer(blind, rays=32), bake_transfer(blind, rays=32, **points)
    _same(probes, whole)
    assert probes.faces.shape == (0, 3) and not probes.coefficients[::7].any()
    np.testing.assert_array_equal(probes.vertices, blind.vertices)
    _same(bake_transfer(blind, rays=32, rows=slice(9, 50), **points), bake_transfer(blind, rays=32, rows=slice(9, 50)))
    frames = np.array(orthonormal_frame(blind.normals))[:, :, [1, 0, 2]] * [1, -1, 1]
    _same(bake_transfer(blind, rays=32, frames=frames, **points), bake_transfer(blind, rays=32, frames=frames))


def test_points_on_slivers_are_lifted_as_the_vertices_there() -> None:
    vertices = np.random.default_rng(0).normal(size=(30, 3)) * [1, 1e-4, 1e-4]
    mesh, _ = prepare_mesh(vertices @ random_rotation(0).T, np.arange(30).reshape(10, 3))
    scene, alone = make_scene(mesh, as_points(mesh.vertices, mesh.normals)), make_scene(mesh)
    assert np.ptp(np.linalg.norm(alone.geometry.origins - alone.geometry.vertices, axis=1)) > 1e-5
    np.testing.assert_array_equal(scene.geometry.origins[scene.receivers], alone.geometry.origins)


def test_a_probe_in_the_open_sees_everything_and_one_inside_nothing() -> None:
    normals = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], np.float32)
    found = bake_transfer(MESH, rays=64, points=[[0, 9, 0], [0, 0, 9], [0, 0, 0]], normals=normals).coefficients
    np.testing.assert_allclose(found[:2], np.asarray(unshadowed_transfer(normals[:2], 3)), atol=1e-6)
    assert not found[2].any()


def test_occluders_cast_shadow_and_get_no_coefficients() -> None:
    """As the same surfaces in one mesh: the same rays, as far as they are numbered alike."""
    joined = bake_transfer(LIDDED, rays=64, seed=2)
    apart = bake_transfer(MESH, rays=64, seed=2, occluders=[LID])
    count = len(MESH.vertices)
    assert apart.coefficients.shape == (count, 9) and apart.faces.shape == MESH.faces.shape
    np.testing.assert_allclose(apart.coefficients, joined.coefficients[:count], atol=2e-6)
    assert np.abs(apart.coefficients - bake_transfer(MESH, rays=64, seed=2).coefficients).max() > 0.1
    assert apart.metadata["parameters"]["occluders"] == 1


def test_bounces_come_from_occluders_as_from_the_mesh() -> None:
    """Rays start at all surfaces, numbered alike here and there: equal to the last bit."""
    albedo = np.linspace(0.2, 0.9, len(LIDDED.vertices))
    joined = bake_transfer(LIDDED, rays=32, bounces=2, albedo=albedo)
    apart = bake_transfer(MESH, rays=32, bounces=2, albedo=albedo, occluders=[LID])
    np.testing.assert_array_equal(apart.coefficients, joined.coefficients[: len(MESH.vertices)])
    dark = albedo * (np.arange(len(albedo)) < len(MESH.vertices))
    without = bake_transfer(MESH, rays=32, bounces=2, albedo=dark, occluders=[LID])
    assert np.all(without.coefficients[:, 0] <= apart.coefficients[:, 0])
    assert np.any(without.coefficients[:, 0] < apart.coefficients[:, 0] - 0.01)


def test_points_receive_light_that_bounces_and_send_none() -> None:
    """Two crowds of points at the vertices: one does not notice the other, and both see what the vertices see."""
    points: dict[str, Any] = {"points": LIDDED.vertices, "normals": LIDDED.normals}
    options: dict[str, Any] = {"rays": 256, "bounces": 2, "albedo": 0.8}
    own, probes = bake_transfer(LIDDED, **options), bake_transfer(LIDDED, **options, **points)
    assert own.standard_error is not None and probes.standard_error is not None
    error, claimed = probes.coefficients - own.coefficients, np.hypot(own.standard_error, probes.standard_error)
    assert 0.7 < np.sqrt(np.mean(error**2) / np.mean(claimed**2)) < 1.2
    frames = np.array(orthonormal_frame(LIDDED.normals))
    _same(bake_transfer(LIDDED, **options, **points, frames=frames), probes)


def test_a_bake_to_an_error_of_points_beside_occluders() -> None:
    points: dict[str, Any] = {"points": MESH.vertices, "normals": MESH.normals}
    found = bake_to_error(MESH, 0.1, occluders=[LID], **points)
    reference = bake_transfer(MESH, rays=1024, occluders=[LID], **points)
    difference = np.linalg.norm(found.coefficients - reference.coefficients) / np.linalg.norm(reference.coefficients)
    assert difference < 0.13 and found.faces.shape == (0, 3)


@pytest.mark.parametrize(
    ("points", "normals", "reason"),
    [
        ([[0, 0, 0]], None, "go together"),
        (None, [[0, 1, 0]], "go together"),
        ([0, 0, 0], [0, 1, 0], r"of shape \(p, 3\), not int64 \(3,\)"),
        (np.zeros((0, 3)), np.zeros((0, 3)), r"of shape \(p, 3\), not float64 \(0, 3\)"),
        ([[0, 0, 0]], [[0, 1, 0], [0, 1, 0]], "give one per point"),
        ([[0, 0, 0]], [[0, 2, 0]], "1 of 1 normals are not of length 1"),
        ([[0, 0, 0]], [[0, np.nan, 0]], "1 of 1 normals are not of length 1"),
        ([[0, np.inf, 0]], [[0, 1, 0]], "1 of 1 points are not finite"),
        ([["a", "b", "c"]], [[0, 1, 0]], "must be real numbers"),
    ],
)
def test_points_that_are_none_are_refused(points: Any, normals: Any, reason: str) -> None:
    with pytest.raises(MeshError, match=reason) as caught:
        bake_transfer(MESH, rays=16, points=points, normals=normals)
    assert "\n" not in str(caught.value)


def test_occluders_are_a_list() -> None:
    for one in (MESH, "room.ply"):
        with pytest.raises(MeshError, match="give a list of meshes"):
            bake_transfer(MESH, rays=16, occluders=one)  # type: ignore[arg-type]


def _splats(count: int, seed: int) -> tuple[bytes, np.ndarray, np.ndarray]:
    """A PLY of splats on a ball, its normals 0 as such files have them: bytes, positions, outward normals."""
    rng = np.random.default_rng(seed)
    out = rng.normal(size=(count, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    quaternion, scales = np.zeros((count, 4)), rng.uniform(-2, -1, (count, 3))
    thin = rng.integers(0, 3, count)
    scales[np.arange(count), thin] = -5
    axis = np.eye(3)[thin] * rng.choice([-1, 1], count)[:, None]
    # the shortest turn from the axis to the normal, of any length
    quaternion[:, 0], quaternion[:, 1:] = 1 + np.sum(axis * out, axis=1), np.cross(axis, out)
    quaternion *= rng.uniform(0.5, 2, (count, 1))
    names = [
        "x",
        "y",
        "z",
        "nx",
        "ny",
        "nz",
        "f_dc_0",
        *(f"scale_{i}" for i in range(3)),
        *(f"rot_{i}" for i in range(4)),
    ]
    rows = np.concatenate([1.1 * out, np.zeros((count, 4)), scales, quaternion], axis=1).astype("<f4")
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {count}"]
    header += [f"property float {name}" for name in names]
    return "\n".join([*header, "end_header", ""]).encode() + rows.tobytes(), 1.1 * out, out


def test_splats_face_away_from_the_mesh_that_they_lie_on(tmp_path: Path) -> None:
    data, positions, outward = _splats(200, 0)
    (tmp_path / "splats.ply").write_bytes(data)
    points, normals = load_points(tmp_path / "splats.ply", icosphere(3))
    np.testing.assert_allclose(points, positions, atol=1e-6)
    np.testing.assert_allclose(normals, outward, atol=1e-5)
    inside = icosphere(3)
    _, inward = load_points(tmp_path / "splats.ply", inside._replace(normals=-inside.normals))
    np.testing.assert_array_equal(inward, -normals)
    up = load_points(tmp_path / "splats.ply", icosphere(3), up="z")
    np.testing.assert_allclose(up[1], outward[:, [0, 2, 1]] * [1, 1, -1], atol=1e-5)


def test_points_with_normals_of_their_own(tmp_path: Path) -> None:
    save_mesh(tmp_path / "mesh.ply", MESH)
    points, normals = load_points(tmp_path / "mesh.ply", Mesh(MESH.vertices, -MESH.normals, MESH.faces))
    np.testing.assert_array_equal(points, MESH.vertices)
    np.testing.assert_allclose(normals, MESH.normals, atol=1e-7)
    bare = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"
    (tmp_path / "bare.ply").write_bytes(bare + b"end_header\n0 0 0\n")
    named = bare + b"".join(b"property float n%c\n" % axis for axis in b"xyz")
    (tmp_path / "nan.ply").write_bytes(named + b"end_header\n0 0 0 nan 0 1\n")
    (tmp_path / "bare.obj").write_text("v 0 0 0\n")
    cases = {"bare.ply": "have no normals", "nan.ply": "1 of 1 normals are not finite", "bare.obj": "read from .ply"}
    for name, reason in {**cases, "none.ply": "no such file"}.items():
        with pytest.raises(MeshError, match=f"{name}.*{reason}|{reason}.*{name}"):
            load_points(tmp_path / name, MESH)
