"""Normals that follow a pose, against what they must be for the rest and for turned poses."""

import numpy as np
import pytest

from gash_jax.geometry.carried_normals import carried_normals, posed_mesh
from gash_jax.geometry.mesh import Mesh, angle_weighted_normals
from gash_jax.shapes.primitives import bumpy_sphere
from tests.helpers.bumpy import random_rotation

MESH = bumpy_sphere(6)
TILT = MESH.normals + 0.4 * np.sin(5 * MESH.vertices[:, [2, 0, 1]])
SMOOTH = MESH._replace(normals=(TILT / np.linalg.norm(TILT, axis=1, keepdims=True)).astype(np.float32))


@pytest.mark.parametrize("mesh", [MESH, SMOOTH])
def test_the_rest_keeps_its_normals_and_a_turned_pose_turns_them(mesh: Mesh) -> None:
    carried, turn = carried_normals(mesh, mesh.faces), random_rotation(3)
    np.testing.assert_allclose(posed_mesh(mesh.vertices, mesh.faces, carried).normals, mesh.normals, atol=2e-6)
    turned = posed_mesh((mesh.vertices @ turn.T).astype(np.float32), mesh.faces, carried)
    np.testing.assert_allclose(turned.normals, mesh.normals @ turn.T, atol=5e-6)


def test_normals_that_were_those_of_the_faces_stay_so() -> None:
    bent = (MESH.vertices * (1 + 0.3 * MESH.vertices[:, :1])).astype(np.float32)
    found = posed_mesh(bent, MESH.faces, carried_normals(MESH, MESH.faces)).normals
    np.testing.assert_array_equal(found, angle_weighted_normals(bent, MESH.faces).astype(np.float32))


def test_a_collapsed_pose_has_normals_of_zero_and_no_nan() -> None:
    flat = posed_mesh(np.zeros_like(SMOOTH.vertices), SMOOTH.faces, carried_normals(SMOOTH, SMOOTH.faces))
    np.testing.assert_array_equal(flat.normals, 0)
