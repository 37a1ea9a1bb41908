"""A mesh that is turned by a rotor, moved and scaled, with its rays carried along in explicit frames.

The rays are then the same rays up to rounding: hardly one changes its answer, and where none changes the
coefficients follow the rotation of spherical harmonics.
"""

import numpy as np
import pytest

from gash_jax.algebra.directions import orthonormal_frame
from gash_jax.algebra.motors import rotor_from_normal, rotor_to_matrix
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.geometry.mesh import Mesh, transform
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.rays import trace_geometry
from gash_jax.prt.sampling import sample_rays
from gash_jax.prt.visibility import visibility
from gash_jax.shapes.primitives import bumpy_sphere, spherical_bowl
from gash_jax.shapes.procedural import make_shape

RAYS, SEED = 256, 3
MESHES = {
    "bumpy sphere": lambda: bumpy_sphere(16),
    "bowl": lambda: spherical_bowl(np.radians(50), 16),
    "generated": lambda: make_shape(5, 4, (1000, 1500))[1],
}
IDENTITY = np.eye(3, dtype=np.float32)


def _rotation(seed: int) -> np.ndarray:
    """The rotation of a rotor that takes e_y to a random direction."""
    direction = np.random.default_rng(seed).normal(size=3).astype(np.float32)
    return np.asarray(rotor_to_matrix(rotor_from_normal(direction / np.linalg.norm(direction))))


MOTIONS = {
    "rotor": (_rotation(1), np.zeros(3), 1.0),
    "another rotor": (_rotation(2), np.zeros(3), 1.0),
    "half turn": (np.diag([-1.0, 1.0, -1.0]).astype(np.float32), np.zeros(3), 1.0),
    "translation": (IDENTITY, np.array([3.0, -2.0, 5.0]), 1.0),
    "scale 1e-6": (IDENTITY, np.zeros(3), 1e-6),
    "scale 1e6": (IDENTITY, np.zeros(3), 1e6),
    "all": (_rotation(3), np.array([-4.0, 1.0, 2.0]), 37.0),
}


def _moved(mesh: Mesh, motion: str) -> tuple[Mesh, np.ndarray, np.ndarray, np.ndarray]:
    """The moved mesh, both meshes' frames, and the rotation; the moved frames are the others turned."""
    rotation, shift, scale = MOTIONS[motion]
    frames = np.asarray(orthonormal_frame(mesh.normals))
    return transform(mesh, rotation, shift, scale), frames, (rotation @ frames).astype(np.float32), rotation


def _free_rays(mesh: Mesh, frames: np.ndarray) -> np.ndarray:
    """The answers of the rays of one bake, (vertices, rays)."""
    geometry = trace_geometry(mesh)
    shifts = np.random.default_rng(SEED).random((len(mesh.vertices), 1, 2), np.float32)
    rays = sample_rays(geometry.origins, frames, shifts, RAYS)
    free = visibility(geometry.vertices, geometry.faces)(np.asarray(rays[0]), np.asarray(rays[1]))
    return free.reshape(len(mesh.vertices), RAYS)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("name", MESHES)
def test_transfer_follows_the_mesh(name: str, motion: str) -> None:
    mesh = MESHES[name]()
    moved, frames, turned, rotation = _moved(mesh, motion)
    changed = _free_rays(mesh, frames) != _free_rays(moved, turned)
    assert changed.mean() <= 1e-4
    here = bake_transfer(mesh, 3, RAYS, replicates=1, seed=SEED, frames=frames).coefficients
    there = bake_transfer(moved, 3, RAYS, replicates=1, seed=SEED, frames=turned).coefficients
    same = ~changed.any(1)
    expected = np.asarray(rotate_coefficients(here, rotation[None]))
    np.testing.assert_allclose(there[same], expected[same], atol=1e-5)


def test_without_frames_the_rays_are_others() -> None:
    """The check can fail: frames chosen by the turned normals alone differ by a twist, and so do the estimates."""
    mesh = bumpy_sphere(16)
    moved, frames, _, rotation = _moved(mesh, "rotor")
    here = bake_transfer(mesh, 3, RAYS, replicates=1, seed=SEED, frames=frames).coefficients
    there = bake_transfer(moved, 3, RAYS, replicates=1, seed=SEED).coefficients
    assert np.abs(there - np.asarray(rotate_coefficients(here, rotation[None]))).max() > 1e-3


def test_frames_of_the_wrong_shape() -> None:
    mesh = bumpy_sphere(4)
    with pytest.raises(ValueError, match="one frame per vertex"):
        bake_transfer(mesh, frames=np.zeros((5, 3, 3), np.float32))
