"""An animated picture of an object that deforms, beside a model of it: expressions that come and go as the light turns.

The path goes through a few random sparse poses of the kind that models are tested on, from each to the next as
3 s² - 2 s³; after the last frame comes the first again. The light turns once about +y. Camera and exposure are chosen
once for all frames.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from gash_jax.apps.pictures.montage import montage
from gash_jax.apps.pictures.views import Picture, cast_view, exposure_for, shade_view, to_srgb
from gash_jax.files.atomic import FileError, whole_file
from gash_jax.geometry.animation import Animation
from gash_jax.geometry.mesh import Mesh
from gash_jax.light.environment import Light, project_light, rotate_light
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.models.deforming_model import DeformingModel
from gash_jax.prt.sequence import posed_meshes
from gash_jax.shapes.deformations import random_poses
from gash_jax.train.truth import Truth

FRAMES, POSES, PACE = 48, 4, 66  # PACE: milliseconds that a frame is shown
CAMERA = (20.0, 5.0)
EXPOSED = 8  # frames that the exposure is chosen from
QUALITY = 90  # of WebP, which keeps the colours that a GIF would lose, in a fraction of its bytes


def path_of_poses(animation: Animation, frames: int, poses: int = POSES, seed: int = 0) -> Animation:
    """A loop of blended expressions (module docstring), of an animation of blendshapes."""
    ends = random_poses(animation, seed, poses, held_out=True).parameters
    place = np.arange(frames) * poses / frames
    first, share = place.astype(int), (place % 1)[:, None]
    share = share**2 * (3 - 2 * share)
    rows = (1 - share) * ends[first] + share * ends[(first + 1) % poses]
    return animation._replace(parameters=rows.astype(np.float32), seconds=None)


def turned(light: Light, share: float) -> Light:
    """The light after that share of a turn about +y."""
    angle = 2 * np.pi * share
    across = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    return rotate_light(light, np.array(across))


def envelope(animation: Animation) -> Mesh:
    """The lowest and the highest place of every vertex over all frames, as a mesh that the camera is set up for."""
    ends = np.stack([animation.frame(0)] * 2)
    for frame in animation.frames():
        ends = np.stack([np.minimum(ends[0], frame), np.maximum(ends[1], frame)])
    faces = animation.mesh.faces
    return Mesh(
        ends.reshape(-1, 3),
        np.concatenate([animation.mesh.normals] * 2),
        np.concatenate([faces, faces + np.int32(len(ends[0]))]),
    )


def pairs(model: DeformingModel, truth: Truth, size: int) -> Iterator[tuple[Picture, Picture]]:
    """Every frame baked, and by the model."""
    moving, light = truth.scene.receivers, project_light(studio_light(), truth.bands)
    around, frames = envelope(moving), (frame for shard in truth.shards() for frame in shard)
    for number, (mesh, baked) in enumerate(zip(posed_meshes(moving), frames, strict=True)):
        lit, hit = turned(light, number / len(truth)), cast_view(mesh, CAMERA, size, around)
        found = baked.astype(np.float32), np.asarray(model.coefficients(mesh))
        one, other = (shade_view(hit, np.asarray(shade(coefficients, lit))) for coefficients in found)
        yield one, other


def movie(model: DeformingModel, truth: Truth, size: int) -> list[Image.Image]:
    """Frames of the animated picture: baked at the left, by the model at the right."""
    drawn = list(pairs(model, truth, size))
    exposure = exposure_for([one for one, _ in drawn[:: max(len(drawn) // EXPOSED, 1)]])
    names = (f"baked, {truth.rays} rays", f"by {model.config.name}")
    return [
        montage([(name, to_srgb(*view, exposure)) for name, view in zip(names, pair, strict=True)]) for pair in drawn
    ]


def check_movie(path: Path) -> None:
    """Raise FileError for a name of another format than WebP."""
    if path.suffix.lower() != ".webp":
        raise FileError(f"cannot write {path}: animated pictures are written as .webp, choose such a name")


def write_movie(path: Path, frames: list[Image.Image]) -> None:
    """Write an animated WebP that begins anew for ever, whole or not at all. Raises FileError for another name."""
    check_movie(path)
    with whole_file(path) as temporary:
        kept = {"save_all": True, "append_images": frames[1:], "duration": PACE, "loop": 0}
        frames[0].save(temporary, format="WEBP", quality=QUALITY, method=6, **kept)
