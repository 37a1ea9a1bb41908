"""What `gash bench frontier` reads: meshes and frames of animations by name, and models that some method is."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gash_jax.files.atomic import FileError
from gash_jax.formats.animations import GLTF, load_animation
from gash_jax.formats.gltf_animation import moves
from gash_jax.formats.meshes import read_mesh
from gash_jax.geometry.mesh import Mesh
from gash_jax.models.deforming_model import DeformingModel, is_deforming, load_deforming_model
from gash_jax.models.model import Model, load_model, model_file, shipped_models
from gash_jax.prt.sequence import posed_meshes

BANDS = 3  # of the weights that ship
FAMILIES = ("mlp", "gnn", "two-stage", "local")  # of networks that some method is
MOST_FRAMES = 8  # of an animation, spread evenly


class Models(NamedTuple):
    """Networks by name, and models of one object that deforms."""

    networks: dict[str, Model]
    deforming: dict[str, DeformingModel]


def read_frames(paths: Sequence[Path], up: str) -> dict[str, list[Mesh]]:
    """Meshes by the names of their files, each a list of one, and of an animation the frames that are measured.

    Raises FileError for two of one name, FileError or MeshError for what cannot be read.
    """
    found: dict[str, list[Mesh]] = {}
    for path in paths:
        if path.stem in found:
            raise FileError(f"two meshes are called {path.stem}: results are kept by name, give one another name")
        suffix = path.suffix.lower()
        if suffix == ".npz" or (suffix in GLTF and path.is_file() and moves(path)):
            animation = load_animation(path, up)
            count = min(MOST_FRAMES, len(animation))
            chosen = np.linspace(0, len(animation) - 1, count).round().astype(int)
            some = animation._replace(parameters=animation.parameters[chosen], seconds=None)
            found[path.stem] = list(posed_meshes(some))
        else:
            found[path.stem] = [read_mesh(path, up)[0]]
    return found


def load_models(given: Sequence[str]) -> Models:
    """The networks that ship and the models that were given, by the names of their files or runs.

    Raises FileError for one that no method is, of too few bands, or of a name that is taken.
    """
    networks = {name: load_model(name) for name in shipped_models()}
    deforming: dict[str, DeformingModel] = {}
    for text in given:
        file = model_file(text)
        name = file.parent.name if file.stem == "model" and file.parent.name else file.stem
        if name in networks or name in deforming:
            raise FileError(f"two models are called {name}: results are kept by name, give one another name")
        if is_deforming(file):
            deforming[name] = model = load_deforming_model(text)
        else:
            networks[name] = model = load_model(text)
            if model.config.name not in FAMILIES:
                raise FileError(f"{text} is a {model.config.name} model: measured are {', '.join(FAMILIES)}")
        bands = model.config.bands
        if bands < BANDS or (bands != BANDS and name in networks):
            raise FileError(f"{text} has {bands} bands: what is measured has {BANDS}")
    return Models(networks, deforming)
