"""The training loop over all phases of a run, which resumes bit for bit on a CPU.

A run folder holds `config.json`, `metrics.jsonl`, `events/` (TensorBoard), `checkpoint/` and, when finished,
`model.npz` (best parameters by the validation loss of the last phase). See `phase_run` for budgets and devices.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import jax
from flax.traverse_util import flatten_dict, unflatten_dict

from gash_jax.files.atomic import write_text
from gash_jax.files.settings import ConfigError
from gash_jax.models.examples import Batch, Example
from gash_jax.models.families import build_model, family_of
from gash_jax.models.model import save_model
from gash_jax.nn.config import ModelConfig
from gash_jax.train.checkpoint import has_checkpoint, restore_checkpoint
from gash_jax.train.config import RunConfig, load_config
from gash_jax.train.error_bound import error_bound
from gash_jax.train.logs import MetricsLog
from gash_jax.train.objectives import objectives
from gash_jax.train.phase_run import PhaseRun, ReportFn, TrainState
from gash_jax.train.precision import computes_in_half, initial_scale
from gash_jax.train.step import make_optimizer


@cache
def _initialiser(config: ModelConfig) -> Callable[..., Any]:
    return jax.jit(build_model(config).init)


def initial_state(config: RunConfig, example: Batch) -> TrainState:
    """Fresh parameters from the seed, optimiser of the first phase."""
    inputs = jax.tree.map(lambda leaf: leaf[0], example.inputs)
    params = _initialiser(config.model)(jax.random.key(config.train.seed), inputs)["params"]
    moments, scale = make_optimizer(config.optim).init(params), initial_scale(computes_in_half(config.train.precision))
    return TrainState(params, params, float("inf"), moments, scale, 0, 0, 0.0)


def open_folder(folder: Path, config: RunConfig) -> None:
    """Make the run's folder; a run that is there already must have the same config, but for its budget."""
    folder.mkdir(parents=True, exist_ok=True)
    saved = folder / "config.json"
    if saved.exists() and _without_budget(load_config(saved)) != _without_budget(config):
        raise ConfigError(f"{folder} holds a run with another config: choose another output folder, or delete it")
    write_text(saved, json.dumps(config.to_dict(), indent=1))


def _without_budget(config: RunConfig) -> RunConfig:
    return replace(config, train=replace(config.train, steps=0, seconds=0.0))


def train_model(
    config: RunConfig,
    training: Sequence[Example],
    validation: Sequence[Example],
    folder: str | Path,
    report: ReportFn | None = None,
    notify: Callable[[str], None] = lambda text: None,
    start: Any = None,
    unlike: Sequence[Example] = (),
) -> Path:
    """Train (or continue) the run in `folder` and return the path of its model file.

    `start` are parameters to begin with instead of random ones, or some of them. From shapes `unlike` those that it is
    trained on a network learns, beside those to validate on, what errors to expect. A finished run goes on if its
    budget was raised. `notify` gets what a user should know. Raises ConfigError if the folder holds a run of another
    config or no whole checkpoint, DivergenceError where the loss is not finite.
    """
    folder = Path(folder)
    open_folder(folder, config)
    put_together = family_of(config.model).batches
    held_out = [*validation, *unlike]
    draw = put_together(training).draw
    draw_held_out = put_together(held_out).draw if held_out else draw

    def in_order(examples: Sequence[Example]) -> list[Batch]:
        return put_together(examples).in_order(config.train.batch_vertices) if examples else []

    state = initial_state(config, draw(config.train.batch_vertices, config.train.seed, 0, 1))
    if start is not None:
        begun = unflatten_dict(flatten_dict(state.params) | flatten_dict(start))
        state = state._replace(params=begun, best=begun)
    if has_checkpoint(folder):
        state, note = restore_checkpoint(folder, state)
        if note:
            notify(note)
    plan = objectives(config.model, computes_in_half(config.train.precision))
    with MetricsLog(folder, [objective.phase.name for objective in plan], int(state.phase), int(state.step)) as log:
        while state.phase < len(plan):
            objective = plan[state.phase]
            drawn = draw_held_out if objective.phase.held_out else draw
            batches = in_order(held_out if objective.phase.held_out else validation)
            state = PhaseRun(config, objective, drawn, batches, folder, log, report).run(state)
            following = state.phase + 1
            error = state.best_error if following == len(plan) else float("inf")
            fresh = make_optimizer(config.optim).init(state.best)
            state = state._replace(
                params=state.best, best_error=error, optimizer=fresh, phase=following, step=0, elapsed=0.0
            )
    path, said = folder / "model.npz", dict[str, Any](validation=state.best_error)
    if (bound := error_bound(config.model, state.best, held_out)) is not None:
        said["bound"] = bound
    save_model(path, config.model, state.best, name=config.name, run=config.to_dict(), **said)
    return path
