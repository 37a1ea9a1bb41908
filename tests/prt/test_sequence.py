"""Bakes of animations: each frame is the bake of its mesh, and a part is a part."""

import numpy as np
import pytest

from gash_jax.geometry.animation import Animation, Recorded
from gash_jax.geometry.mesh import MeshError, concatenate
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.sequence import bake_pose, moving_scene, posed_meshes
from gash_jax.shapes.deformations import blendshape_animation, random_poses
from gash_jax.shapes.primitives import bumpy_sphere

ONE = bumpy_sphere(4)
COUNT = len(ONE.vertices)
PAIR = concatenate([ONE, ONE._replace(vertices=ONE.vertices + np.array([0, 2.2, 0], np.float32))])
MOVING = blendshape_animation(PAIR, 0, 3, 4)


def test_a_frame_is_baked_as_its_mesh_is() -> None:
    scene = moving_scene(MOVING)
    (mesh,) = posed_meshes(scene.animation, 2, 3)
    np.testing.assert_array_equal(mesh.vertices, MOVING.frame(2))
    expected = bake_transfer(mesh, 2, 16, replicates=1, seed=7).coefficients
    np.testing.assert_array_equal(bake_pose(mesh, scene.rows, 2, 16, 7), expected)


def test_a_part_is_baked_alone_or_among_the_rest() -> None:
    alone, among = (moving_scene(MOVING, f"0:{COUNT}", rest) for rest in ("drop", "occlude"))
    whole = moving_scene(MOVING)
    found = []
    for scene in (alone, among, whole):
        (mesh,) = posed_meshes(scene.animation, 1, 2)
        found.append(bake_pose(mesh, scene.rows, 2, 64, 0))
    assert len(found[0]) == len(found[1]) == COUNT and len(found[2]) == 2 * COUNT
    np.testing.assert_array_equal(found[1], found[2][:COUNT])
    assert found[0][:, 0].mean() > 1.02 * found[1][:, 0].mean()  # the other sphere takes light away
    np.testing.assert_array_equal(among.receivers.mesh.faces, alone.animation.mesh.faces)


def test_a_vertex_that_lost_a_face_gets_the_normal_of_those_it_keeps() -> None:
    part = moving_scene(MOVING, "0:10").animation.mesh
    whole = moving_scene(MOVING).receivers.mesh
    used = np.zeros(10, bool)
    used[part.faces] = True
    assert not part.normals[~used].any() and used.any()
    assert np.abs(part.normals[used] - whole.normals[:10][used]).max() > 1e-3


def test_recorded_frames_have_parts_too() -> None:
    frames = np.stack([PAIR.vertices, 2 * PAIR.vertices])
    recorded = Animation(PAIR, np.arange(2.0)[:, None], ("frame",), Recorded(frames))
    part = moving_scene(recorded, f"{COUNT}:{2 * COUNT}").animation
    np.testing.assert_array_equal(part.frame(1), frames[1, COUNT:])
    np.testing.assert_array_equal(part.mesh.faces, ONE.faces)


@pytest.mark.parametrize("text", ["5", "5:5", "9:3", "0:99999", "a:b", "0:4:9", "-1:4", ":"])
def test_what_is_no_part_is_refused(text: str) -> None:
    with pytest.raises(MeshError, match="give the first and the one after the last"):
        moving_scene(MOVING, text)


def test_random_poses_are_seeded_and_those_held_out_differ() -> None:
    first, again = (random_poses(MOVING, 3, 20).parameters for _ in range(2))
    held_out = random_poses(MOVING, 3, 20, held_out=True).parameters
    np.testing.assert_array_equal(first, again)
    assert not np.isin(held_out[held_out > 0], first).any()
    active = (first > 0).sum(axis=1)
    assert active.min() >= 1 and first.max() <= 1 and first.min() >= 0
    with pytest.raises(ValueError, match="need blendshapes without bones"):
        random_poses(Animation(PAIR, np.zeros((1, 1)), ("frame",), Recorded(PAIR.vertices[None])), 0, 1)
