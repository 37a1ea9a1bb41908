"""Pictures of objects that deform: the strip, and the movie of a model beside its reference."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence
from PIL.WebPImagePlugin import WebPImageFile

from experiments.deforming.movie import envelope, movie, path_of_poses, write_movie
from experiments.deforming.pictures import SIZE, strip
from gash_jax.algebra.closed_forms import unshadowed_transfer
from gash_jax.apps.pictures.montage import GAP
from gash_jax.files.atomic import FileError
from gash_jax.geometry.animation import Animation
from gash_jax.models.deform import DeformConfig, fit_deform
from gash_jax.models.deforming_model import DeformingModel
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.prt.sequence import moving_scene, posed_meshes
from gash_jax.shapes.deformations import blendshape_animation, random_poses
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.truth import Truth, write_frames

SMALL = 48  # pixels


def few_frames(folder: Path, moving: Animation) -> tuple[Truth, DeformingModel]:
    """Frames whose coefficients are the closed form, and a model that was fitted to them."""
    files = []
    for number, mesh in enumerate(posed_meshes(moving)):
        path = folder / f"{number}.npz"
        found = np.asarray(unshadowed_transfer(mesh.normals, 4), np.float16)[None]
        write_frames(path, {"coefficients": found}, 0.0, 0.0)
        files.append(path)
    truth = Truth(moving_scene(moving), 4, 1, tuple(files), 0.0, 0.0)
    config = DeformConfig("deform", 4, patches=2)
    return truth, DeformingModel(config, fit_deform(config, TrainingPoses(moving, truth.shards())), moving.mesh, {})


def test_the_strip_has_a_row_for_each_way_and_a_column_for_each_frame(tmp_path: Path) -> None:
    truth, model = few_frames(tmp_path, blendshape_animation(bumpy_sphere(4), 0, 3, 2))
    picture = strip(model, truth)
    assert picture.width > 3 * SIZE and picture.height > 3 * SIZE


def halves(frame: Image.Image) -> tuple[np.ndarray, np.ndarray]:
    """The pictures of a frame of the movie without their captions, SMALL pixels a side."""
    pixels = np.asarray(frame.convert("RGB"), float)
    rows = slice(-GAP - SMALL, -GAP)
    return pixels[rows, GAP : GAP + SMALL], pixels[rows, 2 * GAP + SMALL : 2 * (GAP + SMALL)]


def test_the_movie_loops_and_shows_what_a_spoilt_model_does(tmp_path: Path) -> None:
    truth, model = few_frames(tmp_path, path_of_poses(blendshape_animation(bumpy_sphere(4), 0, 1, 2), 3, 2))
    spoilt = DeformingModel(model.config, {**model.arrays, "mean": 0.5 * model.arrays["mean"]}, model.mesh, {})
    apart = []
    for number, said in enumerate((model, spoilt)):
        write_movie(tmp_path / f"{number}.webp", movie(said, truth, SMALL))
        with Image.open(tmp_path / f"{number}.webp") as picture:
            assert isinstance(picture, WebPImageFile)
            assert (picture.n_frames, picture.info["loop"]) == (3, 0) and picture.width == 2 * SMALL + 3 * GAP
            frames = [halves(frame) for frame in ImageSequence.Iterator(picture)]
        apart.append([np.abs(one - other).mean() for one, other in frames])
        assert all(np.abs(a[0] - b[0]).mean() > 2 for a, b in pairwise(frames))  # the light has turned
    assert max(apart[0]) < 2 < 10 < min(apart[1])
    with pytest.raises(FileError, match="written as .webp"):
        write_movie(tmp_path / "face.mp4", [])


def test_the_path_of_poses_goes_through_held_out_ones_and_closes() -> None:
    moving = blendshape_animation(bumpy_sphere(4), 0, 1, 9)
    path = path_of_poses(moving, 40, 4)
    assert (path.parameters[::10] == random_poses(moving, 0, 4, held_out=True).parameters).all()
    steps = np.abs(np.diff(path.parameters, axis=0, append=path.parameters[:1])).max(axis=1)
    assert steps.max() < 0.16  # 1.5 / 10 is the steepest of 3 s² - 2 s³; the last step leads to the first frame
    assert path.parameters.min() >= 0 and path.parameters.max() <= 1


def test_the_camera_of_the_movie_holds_every_frame() -> None:
    moving = blendshape_animation(bumpy_sphere(4), 0, 4, 3)
    held, frames = envelope(moving), np.stack(list(moving.frames()))
    count = len(moving.mesh.vertices)
    assert (held.vertices[:count] == frames.min(axis=0)).all() and (held.vertices[count:] == frames.max(axis=0)).all()
    assert held.faces.max() == 2 * count - 1
