"""Every model of one object that deforms: what it fits, what it says of poses, its file."""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.algebra.sh_rotation import rotate_coefficients
from gash_jax.files.atomic import FileError
from gash_jax.files.settings import from_dict
from gash_jax.geometry.animation import Animation, Recorded
from gash_jax.geometry.carried_normals import carried_normals
from gash_jax.geometry.mesh import MeshError
from gash_jax.models.deform import local_coefficients, local_frames
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.deforming_model import DeformingModel, load_deforming_model, save_deforming_model
from gash_jax.models.families import model_config
from gash_jax.models.model import load_model, save_model
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.config import RunConfig, TrainConfig
from gash_jax.train.image_training import fit_deep_prt
from runtimes import gash_numpy
from tests.helpers.bumpy import random_rotation

MESH = bumpy_sphere(5)
MOVING = blendshape_animation(MESH, 0, 40, 4)
COUNT = len(MESH.vertices)
NORMALS = np.stack([mesh.normals for mesh in posed_meshes(MOVING)])
BARE = np.stack([np.asarray(unshadowed_transfer(normals, 3)) for normals in NORMALS])
PUSH = np.random.default_rng(1).normal(size=(4, COUNT, 9))
LINEAR = 0.2 + np.tensordot(MOVING.parameters, 0.05 * PUSH, axes=1)  # linear in the weights
CONFIGS = {
    "momo-prt": {"rank": 4},
    "deform": {"patches": 6},
    "deep-prt": {"size": 16, "channels": 2, "levels": 2, "fold": 2, "changes": True},
}


def config_of(name: str) -> Any:
    return from_dict(DEFORMING[name].config, {"name": name, "bands": 3, **CONFIGS[name]})


def fitted(name: str, coefficients: np.ndarray) -> DeformingModel:
    config, fit = config_of(name), DEFORMING[name].fit
    poses = TrainingPoses(MOVING, [coefficients.astype(np.float16)])
    if fit:
        return DeformingModel(config, fit(config, poses), MESH, {"name": "toy"})
    run = RunConfig("toy", config, train=TrainConfig(steps=2))
    with TemporaryDirectory() as folder:
        arrays = fit_deep_prt(run, poses, Path(folder), lambda part: None)
    return DeformingModel(config, arrays, MESH, {"name": "toy"})


@pytest.fixture(scope="module", params=DEFORMING)
def model(request: pytest.FixtureRequest) -> DeformingModel:
    return fitted(request.param, 0.8 * BARE)


def test_the_linear_model_is_exact_where_coefficients_are_linear() -> None:
    new = MOVING._replace(parameters=np.random.default_rng(2).uniform(0, 1, (3, 4)))
    model = fitted("momo-prt", LINEAR)
    for positions, row in zip(new.frames(), new.parameters, strict=True):
        truth = 0.2 + np.tensordot(row, 0.05 * PUSH, axes=1)
        np.testing.assert_allclose(model(positions), truth, atol=3e-3)  # coefficients were rounded to float16


def test_deform_has_the_closed_form_exactly_in_every_pose() -> None:
    model = fitted("deform", 0.8 * BARE)
    far = MOVING._replace(parameters=5 * MOVING.parameters).frame(7)
    expected = 0.8 * np.asarray(unshadowed_transfer(model.pose(far).normals, 3))
    np.testing.assert_allclose(model(far), expected, atol=2e-3)
    wrong = np.abs(np.asarray(fitted("momo-prt", 0.8 * BARE)(far)) - expected).max()
    assert wrong > 0.05  # which a linear model has not


def test_deform_moves_its_shadows_with_a_body_that_moves_as_a_whole() -> None:
    """Turned and moved in space a pose is no other pose."""
    model = fitted("deform", LINEAR)
    turn, pose = random_rotation(5), MOVING.frame(4).astype(np.float64)
    moved = (pose @ turn.T + [3.0, -1.0, 2.0]).astype(np.float32)
    expected = rotate_coefficients(np.asarray(model(MOVING.frame(4))), turn.astype(np.float32))
    np.testing.assert_allclose(model(moved), expected, atol=2e-3)
    assert np.abs(np.asarray(model(MOVING.frame(5))) - model(MOVING.frame(4))).max() > 0.02  # another pose is another


def test_it_is_a_function_that_jax_can_turn(model: DeformingModel) -> None:
    pose = model.pose(MOVING.frame(3))
    held = {name: jnp.asarray(array) for name, array in model.arrays.items()}
    predict = DEFORMING[model.config.name].predict
    found = predict(model.config, held, jnp.asarray(pose.vertices), jnp.asarray(pose.normals))
    np.testing.assert_allclose(model(MOVING.frame(3)), found, atol=1e-5)
    slope = jax.grad(lambda p: predict(model.config, held, p, jnp.asarray(pose.normals)).sum())
    assert np.isfinite(slope(jnp.asarray(pose.vertices))).all()


def test_collapsed_and_distant_poses_are_finite(model: DeformingModel) -> None:
    collapsed = MOVING.frame(1).copy()
    collapsed[MESH.faces[:40].ravel()] = collapsed[MESH.faces[0, 0]]
    for positions in (collapsed, np.zeros_like(collapsed), 1e6 * MOVING.frame(2)):
        assert np.isfinite(model(positions)).all()
    assert model.outside(1e6 * MOVING.frame(2)) and not model.outside(MOVING.frame(2))


def test_normals_made_beside_the_coefficients_are_those_of_the_pose(model: DeformingModel) -> None:
    """Where faces have collapsed, too, and where the pose is minute."""
    collapsed = MOVING.frame(4).copy()
    near = np.linalg.norm(MESH.vertices - MESH.vertices[40], axis=1) < 0.5
    collapsed[near] = collapsed[40]
    for positions in (MOVING.frame(4), collapsed, 1e-12 * MOVING.frame(4), MOVING.frame(4) + np.float32(100)):
        np.testing.assert_allclose(model(positions), model.coefficients(model.pose(positions)), atol=5e-5)


def test_positions_of_another_mesh_are_refused(model: DeformingModel) -> None:
    for positions in (MESH.vertices[1:], np.zeros((2, COUNT, 3)), np.full((COUNT, 3), "a")):
        for ask in (model, model.outside):
            with pytest.raises(MeshError, match="this model is of one mesh"):
                ask(positions)


def test_positions_that_are_not_finite_are_refused(model: DeformingModel) -> None:
    """Those that float32 cannot hold among them; large ones are fine."""
    broken, wide = MESH.vertices.astype(np.float64), np.sign(MESH.vertices) * np.float32(9e35)
    broken[3] = np.nan
    broken[5, 2] = 1e39
    for ask in (model, model.outside):
        with pytest.raises(MeshError, match=rf"2 of {COUNT} positions are not finite or .* \(first: 3\): repair"):
            ask(broken)
    assert model.outside(wide)
    assert np.isfinite(model(wide)).all()


def test_its_file_gives_it_back(model: DeformingModel, tmp_path: Path) -> None:
    save_deforming_model(tmp_path / "model.npz", model.config, model.arrays, MESH, name="toy")
    for again in (load_deforming_model(tmp_path), load_deforming_model(tmp_path / "model.npz")):
        assert again.config == model.config and again.metadata["name"] == "toy"
        np.testing.assert_allclose(again(MOVING.frame(5)), model(MOVING.frame(5)), atol=2e-3)
    transfer = model.predict(MOVING.frame(5))
    assert transfer.bands == 3 and transfer.metadata["parameters"]["model"]["name"] == model.config.name
    with pytest.raises(FileError, match="gash animate"):
        load_model(tmp_path / "model.npz")


def test_the_numpy_runtime_says_the_same(model: DeformingModel, tmp_path: Path) -> None:
    save_deforming_model(tmp_path / "model.npz", model.config, model.arrays, MESH)
    if model.config.name == "deep-prt":
        with pytest.raises(ValueError, match="use gash animate"):
            gash_numpy.load_deforming(str(tmp_path / "model.npz"))
        return
    again, read = load_deforming_model(tmp_path), gash_numpy.load_deforming(str(tmp_path / "model.npz"))
    pose = again.pose(MOVING.frame(9))
    found = gash_numpy.predict_pose(read, pose.vertices, pose.normals)
    np.testing.assert_allclose(found, again.coefficients(pose), atol=1e-5)
    save_model(tmp_path / "other.npz", model_config("mlp"), {"a": np.zeros(2)})
    for path in (tmp_path / "other.npz", tmp_path / "absent.npz"):
        with pytest.raises(ValueError, match="model"):
            gash_numpy.load_deforming(str(path))


def test_files_that_are_no_such_model_are_refused(model: DeformingModel, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    with pytest.raises(FileError, match="no model"):
        load_deforming_model(path)
    save_model(path, model_config("mlp"), {"a": np.zeros(2)})
    with pytest.raises(FileError, match="no model of an object that deforms"):
        load_deforming_model(path)
    one = "low" if model.config.name == "deep-prt" else "mean"
    short = {**model.arrays, one: model.arrays[one][:-1]}
    save_deforming_model(path, model.config, short, MESH)
    with pytest.raises(FileError, match="shape"):
        load_deforming_model(path)
    del short[one]
    save_deforming_model(path, model.config, short, MESH)
    with pytest.raises(FileError, match=f"no array '{one}'"):
        load_deforming_model(path)


@pytest.mark.parametrize("name", ["momo-prt", "deform"])
@pytest.mark.parametrize("frames", [1, 7])
def test_where_nothing_moves_it_is_the_mean(name: str, frames: int, tmp_path: Path) -> None:
    still = Animation(MESH, np.zeros((frames, 1)), ("frame",), Recorded(MESH.vertices[None]))
    noise = np.random.default_rng(0).uniform(0.9, 1.1, (frames, *BARE.shape[1:]))
    truth = (noise * BARE[0]).astype(np.float16)
    config, fit = config_of(name), DEFORMING[name].fit
    assert fit is not None
    save_deforming_model(tmp_path / "model.npz", config, fit(config, TrainingPoses(still, [truth])), MESH)
    model, read = load_deforming_model(tmp_path), gash_numpy.load_deforming(str(tmp_path / "model.npz"))
    expected = truth.astype(np.float64).mean(axis=0)
    np.testing.assert_allclose(model(MESH.vertices), expected, atol=1e-3)
    np.testing.assert_allclose(gash_numpy.predict_pose(read, MESH.vertices, MESH.normals), expected, atol=1e-3)
    assert not model.outside(MESH.vertices)


def test_local_coefficients_of_a_turned_body_are_those_of_the_body() -> None:
    turn, neighbour = random_rotation(0), carried_normals(MESH, MESH.faces).neighbour
    still = np.asarray(local_frames(jnp.asarray(MESH.vertices), jnp.asarray(MESH.normals), jnp.asarray(neighbour)))
    moved = local_frames(
        jnp.asarray(MESH.vertices @ turn.T, jnp.float32), jnp.asarray(MESH.normals @ turn.T, jnp.float32), neighbour
    )
    np.testing.assert_allclose(moved, turn @ still, atol=2e-5)
    np.testing.assert_allclose(np.linalg.det(still), 1, atol=1e-5)
    found = local_coefficients(TrainingPoses(MOVING, [BARE.astype(np.float16)]), neighbour)
    assert np.abs(found - found[0]).max() < 2e-3  # the closed form is the same in every pose
