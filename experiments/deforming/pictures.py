"""A strip of test frames of an object that deforms, under a light that turns: baked, said by a model, the difference.

    .venv/bin/python -m experiments.deforming.pictures --model runs/deforming/model.npz --animation FILE \
        --vertices 0:11248 --output strip.png --movie face.webp

--movie also writes an animated picture (`experiments.deforming.movie`); its frames are baked with --rays as well.
"""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

from experiments.deforming.movie import CAMERA, FRAMES, check_movie, movie, path_of_poses, turned, write_movie
from gash_jax.apps.pictures.montage import Panel, montage, signed_colors, write_picture
from gash_jax.apps.pictures.views import cast_view, exposure_for, shade_view, to_srgb
from gash_jax.formats.animations import load_animation
from gash_jax.light.environment import project_light
from gash_jax.light.shading import shade
from gash_jax.light.studio import studio_light
from gash_jax.models.deforming_model import DeformingModel, load_deforming_model
from gash_jax.prt.sequence import moving_scene, posed_meshes
from gash_jax.train.config import load_config
from gash_jax.train.deforming_run import split_animation
from gash_jax.train.truth import Truth, bake_truth

STRIP, SIZE, LIMIT = 6, 240, 0.05  # STRIP: frames of it


def strip(model: DeformingModel, test: Truth) -> Image.Image:
    """Three rows of pictures: baked, by the model, difference in exposed radiance; a column for each frame."""
    light, frames = project_light(studio_light(), test.bands), (frame for shard in test.shards() for frame in shard)
    drawn = []
    for number, (mesh, baked) in enumerate(zip(posed_meshes(test.scene.receivers), frames, strict=True)):
        lit, hit = turned(light, number / len(test)), cast_view(mesh, CAMERA, SIZE)
        said = model.coefficients(mesh)
        drawn.append([shade_view(hit, np.asarray(shade(found, lit))) for found in (baked.astype(np.float32), said)])
    exposure = exposure_for([pair[0] for pair in drawn])
    rows = [[], [], []]
    for number, (baked, said) in enumerate(drawn):
        rows[0].append(Panel(f"frame {number}, baked", to_srgb(baked[0], baked[1], exposure)))
        rows[1].append(Panel(f"frame {number}, {model.config.name}", to_srgb(said[0], said[1], exposure)))
        apart = exposure * (said[0] - baked[0]).mean(-1)
        rows[2].append(Panel("difference", signed_colors(apart, LIMIT, baked[1]), LIMIT))
    return montage([panel for row in rows for panel in row], columns=len(drawn))


def main(model: Path, animation: Path, vertices: str, rays: int, output: Path, movie_file: Path | None) -> None:
    """Draw the strip of a model's first test frames, and the animated picture where one is asked for."""
    fitted = load_deforming_model(model)
    if movie_file:
        check_movie(movie_file)
    data = [f"data.animation={animation}", f'data.vertices="{vertices}"', f"data.test_frames={STRIP}"]
    test = bake_truth(split_animation(load_config("deform", data).data).test, fitted.config.bands, rays)
    write_picture(output, strip(fitted, test))
    if movie_file:
        path = moving_scene(path_of_poses(load_animation(animation), FRAMES), vertices)
        write_movie(movie_file, movie(fitted, bake_truth(path, fitted.config.bands, rays), SIZE))


if __name__ == "__main__":
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("model", "animation", "output"):
        asked.add_argument(f"--{name}", type=Path, required=True)
    asked.add_argument("--vertices", default="", help="part of it, FIRST:LAST")
    asked.add_argument("--rays", type=int, default=1024)
    asked.add_argument("--movie", type=Path, dest="movie_file", help="also an animated picture, .webp")
    main(**vars(asked.parse_args()))
