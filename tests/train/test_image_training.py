"""Training of the U-Net: its images, that it learns, that it goes on where it stopped, what it refuses."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.geometry.geometry_image import geometry_image
from gash_jax.geometry.image_fit import image_fit
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.models.deep_prt import (
    MEAN,
    MEAN_POSE,
    change_arrays,
    image_arrays,
    image_of,
    network_arrays,
    pose_image,
    predict_deep_prt,
)
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.nn.unet import UNetConfig
from gash_jax.prt.sequence import posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train import image_training
from gash_jax.train.config import OptimConfig, RunConfig, TrainConfig
from gash_jax.train.image_training import PHASE, Images, frames_as_images, initial_state, train_images
from gash_jax.train.logs import read_lines
from gash_jax.train.phase_run import DivergenceError

MESH = bumpy_sphere(4)
MOVING = blendshape_animation(MESH, 0, 12, 3)
NORMALS = [mesh.normals for mesh in posed_meshes(MOVING)]
TRUTH = np.stack([np.asarray(unshadowed_transfer(normals, 2), np.float16) for normals in NORMALS])
POSES = TrainingPoses(MOVING, [TRUTH[:8], TRUTH[8:]])
IMAGE = geometry_image(parameterise(MESH), 32)
ARRAYS = image_arrays(IMAGE, MESH)


def run_of(steps: int, **train: Any) -> RunConfig:
    config = UNetConfig("deep-prt", bands=2, size=32, channels=3, levels=2)
    return RunConfig("toy", config, optim=OptimConfig(2e-2, 0.0), train=TrainConfig(steps=steps, **train))


@pytest.fixture(scope="module")
def images() -> Images:
    return frames_as_images(ARRAYS, IMAGE, POSES)


def test_images_hold_the_frames(images: Images) -> None:
    assert images.inputs.shape == (12, 32, 32, 6) and images.targets.shape == (12, 32, 32, 4)
    assert images.targets.min() > 0 and images.targets.max() < 1
    back = IMAGE.from_image(images.low + (images.high - images.low) * images.targets[9].astype(np.float32))
    fitted = IMAGE.from_image(image_fit(IMAGE)(TRUTH[9].astype(np.float32)))
    np.testing.assert_allclose(back, fitted, atol=2e-3)
    error = np.sqrt(np.mean((back - TRUTH[9]) ** 2) / np.mean(TRUTH[9].astype(float) ** 2))
    assert error < 0.03
    mesh = list(posed_meshes(MOVING))[9]
    size = np.linalg.norm(np.ptp(MESH.vertices, axis=0)) / 2
    middle = (MESH.vertices.min(0) + MESH.vertices.max(0)) / 2
    np.testing.assert_allclose(images.inputs[9][..., 3:], IMAGE.to_image(mesh.normals), atol=1e-3)
    by_hand = IMAGE.to_image(((mesh.vertices - middle) / size).astype(np.float32))
    np.testing.assert_allclose(images.inputs[9][..., :3], by_hand, atol=2e-3)
    np.testing.assert_array_equal(image_of(ARRAYS).texels, IMAGE.texels)
    np.testing.assert_array_equal(pose_image(ARRAYS, mesh.vertices, mesh.normals).shape, (32, 32, 6))


def test_with_changes_images_hold_differences() -> None:
    """To the mean pose, in units of how much poses differ, beside the pose; and to the mean coefficients."""
    meshes = list(posed_meshes(MOVING))
    arrays = {**ARRAYS, **change_arrays(ARRAYS, meshes, TRUTH)}
    np.testing.assert_allclose(arrays[MEAN], TRUTH.astype(float).mean(axis=0), atol=1e-6)
    found = frames_as_images(arrays, IMAGE, POSES)
    plain = pose_image(ARRAYS, meshes[3].vertices, meshes[3].normals)
    np.testing.assert_allclose(found.inputs[3][..., :6], plain, atol=2e-3)
    poses = np.stack([mesh.vertices for mesh in meshes]).astype(float)
    size = np.linalg.norm(np.ptp(MESH.vertices, axis=0)) / 2
    apart = (poses - poses.mean(axis=0)) / size
    by_hand = IMAGE.to_image((apart[3] / np.sqrt((apart**2).mean())).astype(np.float32))
    np.testing.assert_allclose(found.inputs[3][..., 6:9], by_hand, atol=5e-3)
    np.testing.assert_allclose((arrays[MEAN_POSE] * size)[:, :3].std(axis=0), poses.mean(axis=0).std(axis=0), rtol=1e-4)
    back = IMAGE.from_image(found.low + (found.high - found.low) * found.targets[9].astype(np.float32)) + arrays[MEAN]
    fitted = IMAGE.from_image(image_fit(IMAGE)(TRUTH[9].astype(np.float32)))
    error, without = (np.abs(part - TRUTH[9].astype(float)).mean() for part in (back, fitted))
    assert error < without  # what never changes is not blurred by the image


def test_a_fresh_network_says_the_mean_of_its_targets() -> None:
    arrays = {**ARRAYS, **change_arrays(ARRAYS, posed_meshes(MOVING), TRUTH)}
    images = frames_as_images(arrays, IMAGE, POSES)
    run = run_of(1)
    run = replace(run, model=replace(run.model, fold=2, changes=True))
    state = initial_state(run, images)
    fresh = network_arrays({"params": state.params, "batch_stats": state.means})
    whole: dict[str, Any] = {**arrays, "low": images.low, "high": images.high, **fresh}
    mesh = next(iter(posed_meshes(MOVING)))
    found = predict_deep_prt(run.model, whole, jnp.asarray(mesh.vertices), jnp.asarray(mesh.normals))  # type: ignore[arg-type]
    share = images.targets.mean(axis=(0, 1, 2), dtype=np.float64)
    offset = images.low + (images.high - images.low) * share
    np.testing.assert_allclose(found, arrays[MEAN] + offset, atol=1e-4)


def test_it_learns(images: Images, tmp_path: Path) -> None:
    parts: list[float] = []
    train_images(run_of(150), images, tmp_path, parts.append)
    losses = [line["loss"] for line in read_lines(tmp_path) if line["phase"] == PHASE]
    assert losses[-1] < 0.6 * losses[0]
    assert parts == sorted(parts) and parts[-1] == 1


def test_an_interrupted_run_ends_as_one_that_was_not(
    images: Images, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = run_of(6, checkpoint_every=2)
    for name in ("whole", "parts"):
        (tmp_path / name).mkdir()
    whole = train_images(run, images, tmp_path / "whole", lambda part: None)
    step = image_training.image_step

    def interrupted(*arguments: Any, **options: Any) -> Any:
        calls.append(1)
        if len(calls) == 4:
            raise KeyboardInterrupt
        return step(*arguments, **options)

    calls: list[int] = []
    monkeypatch.setattr(image_training, "image_step", interrupted)
    with pytest.raises(KeyboardInterrupt):
        train_images(run, images, tmp_path / "parts", lambda part: None)
    monkeypatch.undo()
    again = train_images(run, images, tmp_path / "parts", lambda part: None)
    assert int(again.step) == 6
    for one, other in ((again.params, whole.params), (again.means, whole.means)):
        for name, leaf in one["down_0_0"].items():
            for key, array in leaf.items():
                np.testing.assert_array_equal(array, other["down_0_0"][name][key])


def test_every_frame_is_seen_once_an_epoch() -> None:
    frames = [image_training._frames_of_step(0, step, 12, 4) for step in range(6)]
    for epoch in (frames[:3], frames[3:]):
        assert sorted(np.concatenate(epoch)) == list(range(12))
    assert np.any(frames[0] != frames[3])


def test_a_loss_that_is_no_number_is_said(images: Images, tmp_path: Path) -> None:
    broken = images._replace(targets=np.full_like(images.targets, np.nan))
    with pytest.raises(DivergenceError, match="lower optim.learning_rate"):
        train_images(run_of(20), broken, tmp_path, lambda part: None)
