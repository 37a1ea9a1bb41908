"""From a config to a trained model: corpus, graphs, teacher, training."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.files.atomic import FileError, as_path
from gash_jax.files.settings import ConfigError
from gash_jax.models.deforming_families import DEFORMING
from gash_jax.models.examples import Item, WholeShapes
from gash_jax.models.families import family_of, labels_of, make_examples
from gash_jax.models.model import load_model
from gash_jax.models.parameter_shapes import parameter_shapes
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.checkpoint import has_checkpoint, restore_checkpoint
from gash_jax.train.config import RunConfig, load_config
from gash_jax.train.corpus import build_corpus, split_indices
from gash_jax.train.deforming_run import run_deforming
from gash_jax.train.distillation import distilled
from gash_jax.train.loop import initial_state, train_model
from gash_jax.train.own_meshes import folder_items, labelled_mesh
from gash_jax.train.phase_run import ReportFn

Progress = Callable[[int, int], None]


def run_config(
    config: RunConfig,
    folder: str | Path,
    progress: Progress | None = None,
    report: ReportFn | None = None,
    notify: Callable[[str], None] = lambda text: None,
) -> tuple[Path, list[Item]]:
    """Train (or continue) the run in `folder`; its model file, and the validation shapes.

    Models of one object that deforms have none: what they score on test frames stands in the folder.

    >>> tiny = ["data.shapes=1", "data.rays=16", "data.min_vertices=150", "data.max_vertices=200"]
    >>> config = gash_jax.load_config("mlp", [*tiny, "data.validation_shapes=1", "train.steps=2", "model.channels=8"])
    >>> path, validation_shapes = gash_jax.run_config(config, "run")
    >>> gash_jax.load_model(path).config.name
    'mlp'
    """
    if not isinstance(config, RunConfig):
        raise ConfigError(f"a {type(config).__name__} is no config: give what load_config returns")
    folder = as_path(folder)
    if folder.exists() and not folder.is_dir():
        raise FileError(f"{folder} is no folder: name one for the run, which need not exist")
    if config.model.name in DEFORMING:
        return run_deforming(config, folder, progress)[0], []
    teacher = load_model(config.train.teacher) if config.train.teacher else None
    if teacher is not None:
        _check_taught(config, teacher.config.bands)
    start = _start(config)
    items, validation, broken = training_items(config, progress)
    examples = make_examples([*items, *validation, *broken], config.model)
    labelled, held_out = examples[: len(items)], examples[len(items) :]
    if teacher is not None:
        labelled = distilled(labelled, items, teacher)
    known, unlike = held_out[: len(validation)], held_out[len(validation) :]
    return train_model(config, labelled, known, folder, report, notify, start, unlike), validation


def training_items(config: RunConfig, progress: Progress | None = None) -> tuple[list[Item], list[Item], list[Item]]:
    """Shapes with labels to train and to validate on, and broken ones.

    The first two are of folders where the config names them, all others are generated.
    """
    data, (bands, bounces) = config.data, labels_of(config.model)
    sources = list(zip((data.folder, data.validation_folder, ""), split_indices(data), strict=True))
    wanted = np.concatenate([indices for folder, indices in sources if not folder])
    corpus = build_corpus(data, bands, wanted, progress, bounces=bounces)
    parts = []
    for folder, indices in sources:
        if folder:
            parts.append(folder_items(folder, data.rays, bands, progress, bounces=bounces))
        else:
            parts.append(corpus[: len(indices)])
            corpus = corpus[len(indices) :]
    largest = max(len(item.mesh.vertices) for item in parts[0])
    if data.folder and family_of(config.model).batches is WholeShapes and largest >= config.train.batch_vertices:
        raise ConfigError(f"a mesh has {largest} vertices: set train.batch_vertices to more than that")
    return parts[0], parts[1], parts[2]


def _check_taught(config: RunConfig, bands: int) -> None:
    """Raise ConfigError unless a network learns just what its teacher says."""
    if labels_of(config.model) != (bands, 0):
        fewer = " model.known_bands=1 model.known_bounces=0" if config.model.name == "local" else ""
        raise ConfigError(
            f"train.teacher={config.train.teacher} says {bands} bands and no bounces: set model.bands={bands}{fewer}"
        )


def _start(config: RunConfig) -> Any:
    """Parameters of the model that training starts from, if any; it may be a part of the network, as of fewer bands.

    Raises ConfigError where it is another network.
    """
    if not config.train.start_from:
        return None
    model = load_model(config.train.start_from)
    own, given = parameter_shapes(config.model), parameter_shapes(model.config)
    if model.config.name != config.model.name or not given.items() <= own.items():
        raise ConfigError(f"train.start_from={config.train.start_from} holds another network: {model.config}")
    return model.params


def best_so_far(folder: Path) -> tuple[RunConfig, Any, float]:
    """Config, best parameters and their validation loss of a run that has not finished. Raises ConfigError."""
    saved = folder / "config.json"
    if not saved.is_file() or not has_checkpoint(folder):
        raise ConfigError(f"{folder} is not a run with a checkpoint: start one with gash train")
    config = load_config(saved)
    bands, bounces = labels_of(config.model)
    item = labelled_mesh("any", bumpy_sphere(6), 2 if bounces else 1, bands, bounces)
    examples = make_examples([item], config.model)
    example = family_of(config.model).batches(examples).draw(len(item.coefficients) + 1, 0, 0)
    state, _ = restore_checkpoint(folder, initial_state(config, example))
    return config, state.best, float(state.best_error)
