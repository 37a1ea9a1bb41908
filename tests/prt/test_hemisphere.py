"""Binary visibility in the fixed directions of the hemisphere."""

import numpy as np

from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.hemisphere import DIRECTIONS, above_horizon, hemisphere_directions, hemisphere_visibility
from gash_jax.shapes.primitives import icosphere, spherical_bowl


def test_directions_by_hand() -> None:
    """25 directions; for n = +y the rotor is 1, so they are the Fibonacci points with +z turned to +y."""
    up = hemisphere_directions(np.array([[0, 1, 0]], np.float32))[0]
    assert up.shape == (DIRECTIONS, 3) == (25, 3)
    np.testing.assert_allclose(np.sort(up[:, 1])[::-1], 1 - (np.arange(25) + 0.5) / 25, atol=1e-6)


def test_directions_lie_above_every_surface_and_turn_with_the_rotor() -> None:
    normals = np.random.default_rng(0).normal(size=(40, 3))
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
    directions = hemisphere_directions(normals)
    up = hemisphere_directions(np.array([[0, 1, 0]], np.float32))[0]
    np.testing.assert_allclose(np.einsum("vnc,vc->vn", directions, normals), np.tile(up[:, 1], (40, 1)), atol=2e-6)
    gram = np.einsum("vnc,vmc->vnm", directions, directions)
    np.testing.assert_allclose(gram, np.tile(up @ up.T, (40, 1, 1)), atol=4e-6)


def test_convex_sees_all_and_a_bowl_sees_its_opening() -> None:
    assert hemisphere_visibility(icosphere(2)).all()
    bowl = spherical_bowl(np.radians(60), 12)
    share = hemisphere_visibility(bowl).mean()
    assert 0.1 < share < 0.5
    different = hemisphere_visibility(bowl) != hemisphere_visibility(bowl, backend="jax")
    assert different.mean() < 3e-4  # grazing rays; test_visibility.py looks at each of them


def test_no_normal_sees_nothing() -> None:
    mesh = icosphere(1)
    normals = mesh.normals.copy()
    normals[3] = 0
    seen = hemisphere_visibility(Mesh(mesh.vertices, normals, mesh.faces))
    assert not seen[3].any() and seen[[0, 1, 2]].all()


def test_directions_of_the_world_cover_the_sphere_and_are_the_same_everywhere() -> None:
    normals = np.random.default_rng(1).normal(size=(3, 3)).astype(np.float32)
    directions = hemisphere_directions(normals, world=True)
    assert directions.shape == (3, 25, 3)
    np.testing.assert_array_equal(directions[0], directions[2])
    np.testing.assert_allclose(np.linalg.norm(directions[0], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(directions[0].mean(axis=0), 0, atol=0.02)
    # every direction of the sphere has one of them within 32 degrees: caps of a 25th of the sphere reach 23
    anywhere = np.random.default_rng(0).normal(size=(2000, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    assert (anywhere @ directions[0].T).max(axis=1).min() > np.cos(np.radians(32))


def test_below_the_horizon_nothing_is_visible() -> None:
    """Not even through an open sheet, below which nothing stands in the way."""
    sheet = Mesh(
        np.array([[0, 0, 0], [1, 0, 0], [0, 0, -1]], np.float32),
        np.tile(np.array([[0, 1, 0]], np.float32), (3, 1)),
        np.array([[0, 1, 2]], np.int32),
    )
    seen = hemisphere_visibility(sheet, world=True)
    up = hemisphere_directions(sheet.normals, world=True)[0][:, 1] > 0
    np.testing.assert_array_equal(seen, np.tile(up, (3, 1)))
    np.testing.assert_array_equal(above_horizon(sheet.normals, world=True), seen)
    assert 10 < up.sum() < 15 and above_horizon(sheet.normals).all()


def test_the_world_sees_of_a_convex_body_what_is_above_the_horizon() -> None:
    mesh = icosphere(2)
    above = above_horizon(mesh.normals, world=True)
    seen = hemisphere_visibility(mesh, world=True)
    grazing = np.abs(mesh.normals @ hemisphere_directions(mesh.normals, world=True)[0].T) < 0.2  # faces are flat
    np.testing.assert_array_equal(seen[~grazing], above[~grazing])
    normals = mesh.normals.copy()
    normals[3] = 0
    blind = hemisphere_visibility(Mesh(mesh.vertices, normals, mesh.faces), world=True)
    assert not blind[3].any() and not above_horizon(normals)[3].any() and blind[0].any()
