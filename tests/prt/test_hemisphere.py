"""Binary visibility in the fixed directions of the hemisphere."""

import numpy as np

from gash_jax.geometry.mesh import Mesh
from gash_jax.prt.hemisphere import DIRECTIONS, hemisphere_directions, hemisphere_visibility
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
