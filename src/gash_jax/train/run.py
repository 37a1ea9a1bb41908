"""From a config to a trained model: corpus, graphs, teacher, training."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.files.settings import ConfigError
from gash_jax.models.examples import Item
from gash_jax.models.families import family_of, make_examples
from gash_jax.models.model import load_model
from gash_jax.train.checkpoint import has_checkpoint, restore_checkpoint
from gash_jax.train.config import RunConfig, run_from_dict
from gash_jax.train.corpus import build_corpus, split_indices
from gash_jax.train.distillation import distilled
from gash_jax.train.loop import ReportFn, initial_state, train_model

Progress = Callable[[int, int], None]


def run_config(
    config: RunConfig, folder: Path, progress: Progress | None = None, report: ReportFn | None = None
) -> tuple[Path, list[Item]]:
    """Train (or continue) the run in `folder`; its model file, and the validation shapes."""
    teacher = load_model(config.train.teacher) if config.train.teacher else None
    training, validation = split_indices(config.data)
    items = build_corpus(config.data, config.model.bands, np.concatenate([training, validation]), progress)
    examples, split = make_examples(items, config.model), len(training)
    labelled = examples[:split] if teacher is None else distilled(examples[:split], items[:split], teacher)
    return train_model(config, labelled, examples[split:], folder, report), items[split:]


def best_so_far(folder: Path) -> tuple[RunConfig, Any, float]:
    """Config, best parameters and their validation loss of a run that has not finished. Raises ConfigError."""
    saved = folder / "config.json"
    if not saved.is_file() or not has_checkpoint(folder):
        raise ConfigError(f"{folder} is not a run with a checkpoint: start one with gash train")
    config = run_from_dict(json.loads(saved.read_text()))
    item = build_corpus(config.data, config.model.bands, split_indices(config.data)[0][:1])
    examples = make_examples(item, config.model)
    example = family_of(config.model).batches(examples).draw(len(item[0].coefficients) + 1, 0, 0)
    state = restore_checkpoint(folder, initial_state(config, example))
    return config, state.best, float(state.best_error)
