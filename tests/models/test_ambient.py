"""Ambient occlusion: the formula by loop, convex bodies, grooves, invariances, vertices without normal or neighbour."""

import numpy as np
import pytest

from gash_jax.geometry.mesh import Mesh, angle_weighted_normals, referenced
from gash_jax.geometry.normalised import NormalisedMesh
from gash_jax.models.ambient import RADIUS, ambient_occlusion, ambient_refinement
from gash_jax.shapes.primitives import icosphere
from gash_jax.shapes.procedural import make_shape
from tests.helpers.bumpy import bumpy_mesh, random_rotation


def _by_loop(mesh: Mesh, neighbours: int) -> np.ndarray:
    points, reach = mesh.vertices.astype(float), RADIUS * NormalisedMesh(mesh).radius
    valid, out = np.flatnonzero(referenced(mesh)), np.zeros(len(mesh.vertices))
    for i, point in enumerate(points):
        distances = np.linalg.norm(points[valid] - point, axis=1)
        above = total = 0.0
        for j in np.argsort(distances, kind="stable")[: neighbours + 1]:
            d = distances[j]
            if 0 < d < reach:
                weight = 1 - d / reach
                above += weight * max(0.0, float(mesh.normals[i] @ (points[valid[j]] - point)) / d)
                total += weight
        out[i] = above / total if total else 0.0
    return out


@pytest.mark.parametrize("neighbours", [1, 12, 64])
def test_it_is_the_documented_sum(neighbours: int) -> None:
    mesh = bumpy_mesh(150)
    found = ambient_occlusion(mesh, neighbours)
    np.testing.assert_allclose(found, _by_loop(mesh, neighbours), atol=1e-12)
    assert found.max() > 0.02 and found.max() < 1


def test_two_vertices_by_hand() -> None:
    """One neighbour at 30 degrees above the tangent plane of the other: sin 30 for one, nothing above the second."""
    vertices = np.array([[0, 0, 0], [np.sqrt(3) / 2, 0.5, 0], [0.4, 0.2, 1e-3]], np.float32)
    faces = np.array([[0, 1, 2]], np.int32)
    normals = np.array([[0, 1, 0], [0, 1, 0], [0, 0, 0]], np.float32)
    mesh = Mesh(vertices, normals, faces)
    reach = RADIUS * NormalisedMesh(mesh).radius
    assert reach < 1  # so the first two do not reach one another
    assert ambient_occlusion(mesh)[2] == 0  # no normal, no tangent plane
    pair = Mesh(np.array([[0, 0, 0], [0.01, 0.01 / np.sqrt(3), 0], [3, 0, 0], [0, 0, 3]], np.float32), *mesh[1:])
    pair = pair._replace(
        normals=np.tile(np.array([[0, 1, 0]], np.float32), (4, 1)), faces=np.array([[0, 1, 2], [0, 2, 3]])
    )
    np.testing.assert_allclose(ambient_occlusion(pair)[:3], [0.5, 0, 0], atol=1e-6)


def test_a_convex_mesh_keeps_its_coefficients() -> None:
    sphere = icosphere(3)
    assert ambient_occlusion(sphere).max() < 1e-7
    coefficients = np.ones((len(sphere.vertices), 9), np.float32)
    np.testing.assert_allclose(ambient_refinement(sphere, coefficients), 1, atol=1e-6)


def test_refinement_darkens_with_strength_and_never_below_zero() -> None:
    mesh = make_shape(5, 0, (400, 600))[1]
    coefficients = np.full((len(mesh.vertices), 4), -2.0, np.float32)
    results = [ambient_refinement(mesh, coefficients, strength) for strength in (0.0, 0.5, 1.0, 1e3)]
    np.testing.assert_array_equal(results[0], coefficients)
    assert all(np.all(np.abs(b) <= np.abs(a)) for a, b in zip(results, results[1:], strict=False))
    occluded = ambient_occlusion(mesh) > 0.01
    assert occluded.any() and np.all(results[3][occluded] == 0) and results[3].dtype == np.float32


def test_it_moves_turns_and_scales_with_the_mesh() -> None:
    mesh, rotation = bumpy_mesh(120), random_rotation(4)
    vertices = (7e3 * mesh.vertices.astype(float) @ rotation.T + [5, -3, 9]).astype(np.float32)
    moved = Mesh(vertices, (mesh.normals @ rotation.T).astype(np.float32), mesh.faces)
    np.testing.assert_allclose(ambient_occlusion(moved), ambient_occlusion(mesh), atol=1e-4)


def test_isolated_and_coincident_vertices_are_harmless() -> None:
    mesh = bumpy_mesh(40)
    vertices = np.concatenate([mesh.vertices, mesh.vertices[:1], [[50, 0, 0]]]).astype(np.float32)
    faces = np.concatenate([mesh.faces, [[40, 1, 2]]]).astype(np.int32)
    grown = Mesh(vertices, angle_weighted_normals(vertices, faces).astype(np.float32), faces)
    found = ambient_occlusion(grown)
    assert np.isfinite(found).all() and found[41] == 0
    np.testing.assert_allclose(found, _by_loop(grown, 64), atol=1e-12)


def test_no_neighbours_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        ambient_occlusion(bumpy_mesh(10), 0)
