"""Poses read off positions: the weights of blendshapes, principal components of other motions."""

import jax.numpy as jnp
import numpy as np

from gash_jax.geometry.animation import Animation, Recorded
from gash_jax.geometry.mesh import Mesh
from gash_jax.models.pose_reader import fit_reader, poses_outside, read_pose, reader_arrays, reader_of, spread_vertices
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere

MESH = bumpy_sphere(6)
SHAPES = blendshape_animation(MESH, 0, 12, 5)
FRAMES = np.stack(list(SHAPES.frames()))
RECORDED = Animation(MESH, np.arange(12.0)[:, None], ("frame",), Recorded(FRAMES))


def test_the_pose_of_blendshapes_is_their_weights() -> None:
    reader, poses = fit_reader(SHAPES)
    np.testing.assert_allclose(poses, SHAPES.parameters, atol=1e-4)
    for backend in (np.asarray, jnp.asarray):
        found = read_pose(reader, backend(SHAPES.frame(3)))
        np.testing.assert_allclose(found, SHAPES.parameters[3], atol=1e-4)


def test_that_of_recorded_frames_gives_their_positions_back() -> None:
    reader, poses = fit_reader(RECORDED)
    assert poses.shape[1] == 5  # as many as there are shapes
    np.testing.assert_allclose(np.mean(poses**2, axis=0), 1, rtol=1e-4)
    np.testing.assert_allclose(poses @ poses.T, (poses @ poses.T).T, atol=1e-9)
    apart = FRAMES[:, reader.sample.astype(int)] - reader.still
    lift = np.linalg.pinv(reader.matrix)
    np.testing.assert_allclose((poses @ lift).reshape(apart.shape), apart, atol=1e-4)


def test_a_pose_far_outside_is_held_and_said() -> None:
    reader, poses = fit_reader(SHAPES)
    far = SHAPES._replace(parameters=10 * SHAPES.parameters + 1).frame(5)
    assert poses_outside(reader, far) > 0 and not any(poses_outside(reader, frame) for frame in FRAMES)
    held = read_pose(reader, far)
    assert (held <= reader.high).all() and (held >= reader.low).all()
    assert reader.high.max() < 1.2 * poses.max()


def test_no_pose_of_the_training_is_outside_by_rounding() -> None:
    """A shape that never moves and one that never changes leave no range but that of rounding."""
    parameters = SHAPES.parameters.copy()
    parameters[:, 3:] = [0, 0.5]
    for moving in (SHAPES._replace(parameters=parameters), RECORDED):
        reader, _ = fit_reader(moving)
        assert not any(poses_outside(reader, frame) for frame in moving.frames())
    reader, _ = fit_reader(SHAPES._replace(parameters=parameters))
    parameters[5, 3] = 1e-3
    assert poses_outside(reader, SHAPES._replace(parameters=parameters).frame(5)) > 0


def test_where_nothing_moves_the_pose_is_one_zero() -> None:
    still = RECORDED._replace(parameters=np.zeros((7, 1)))
    reader, poses = fit_reader(still)
    assert poses.shape == (7, 1) and not poses.any() and not reader.matrix.any()
    np.testing.assert_array_equal(reader.still, FRAMES[0][reader.sample.astype(int)])


def test_vertices_in_no_face_do_not_count() -> None:
    loose = np.random.default_rng(0).normal(size=(len(FRAMES), 3, 3)) * 1e3
    vertices = np.concatenate([MESH.vertices, np.full((3, 3), 1e30)]).astype(np.float32)
    mesh = Mesh(vertices, np.pad(MESH.normals, ((0, 3), (0, 0))), MESH.faces)
    frames = np.concatenate([FRAMES, loose], axis=1).astype(np.float32)
    reader, poses = fit_reader(RECORDED._replace(mesh=mesh, motion=Recorded(frames)))
    expected, clean = fit_reader(RECORDED)
    np.testing.assert_array_equal(reader.sample, expected.sample)
    np.testing.assert_array_equal(poses, clean)
    reader, _ = fit_reader(RECORDED._replace(mesh=mesh._replace(faces=MESH.faces[:0]), motion=Recorded(frames)))
    assert reader.sample.max() >= len(MESH.vertices)  # without any face all count


def test_it_goes_through_the_arrays_of_a_model() -> None:
    reader, _ = fit_reader(SHAPES)
    for one, other in zip(reader, reader_of(reader_arrays(reader)), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_sample_is_spread() -> None:
    line = np.stack([np.linspace(0, 1, 101), np.zeros(101), np.zeros(101)], axis=1)
    assert sorted(spread_vertices(line, 5).tolist()) == [0, 25, 50, 75, 100]
    assert len(set(spread_vertices(line, 1000).tolist())) == 101
