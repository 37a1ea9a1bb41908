"""From a config to a trained model: corpus, graphs, teacher, training."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gash_jax.files.strict import ConfigError, from_dict
from gash_jax.models.batches import make_examples
from gash_jax.models.model import load_model
from gash_jax.train.checkpoint import has_checkpoint, restore_checkpoint
from gash_jax.train.config import RunConfig
from gash_jax.train.corpus import Item, build_corpus, split_indices
from gash_jax.train.distillation import taught
from gash_jax.train.loop import ReportFn, initial_state, train_model
from gash_jax.train.sampling import make_sampler

Progress = Callable[[int, int], None]


def run_config(
    config: RunConfig, folder: Path, progress: Progress | None = None, report: ReportFn | None = None
) -> tuple[Path, list[Item]]:
    """Train (or continue) the run in `folder`; its model file, and the validation shapes."""
    teacher = load_model(config.train.teacher) if config.train.teacher else None
    training, validation = split_indices(config.data)
    items = build_corpus(config.data, config.model.bands, np.concatenate([training, validation]), progress)
    examples, split = make_examples(items, config.model), len(training)
    lessons = examples[:split] if teacher is None else taught(examples[:split], items[:split], teacher)
    return train_model(config, lessons, examples[split:], folder, report), items[split:]


def best_so_far(folder: Path) -> tuple[RunConfig, Any, float]:
    """Config, best parameters and their validation loss of a run that has not finished. Raises ConfigError."""
    saved = folder / "config.json"
    if not saved.is_file() or not has_checkpoint(folder):
        raise ConfigError(f"{folder} is not a run with a checkpoint: start one with gash train")
    config = from_dict(RunConfig, json.loads(saved.read_text()))
    item = build_corpus(config.data, config.model.bands, split_indices(config.data)[0][:1])
    draw = make_sampler(config.model, make_examples(item, config.model))
    example = draw(len(item[0].coefficients) + 1, 0, 0, 1)
    state = restore_checkpoint(folder, initial_state(config, example))
    return config, state.best, float(state.best_error)
