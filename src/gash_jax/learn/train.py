"""The training loop: AdamW, cosine decay, clipped gradients, phases, checkpoints, bit-for-bit resume on a CPU.

A run folder holds `config.json`, `metrics.jsonl` (one line a logged step), `checkpoint/` and, when finished,
`model.npz` (best parameters by validation MSE of the last phase). A budget in seconds counts from each phase's
first compiled step; a budget in steps makes the run a function of its config alone.
"""

import json
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array

from gash_jax.learn.batches import Batch, Example, collate, draw_batch
from gash_jax.learn.checkpoint import has_checkpoint, restore_checkpoint, save_checkpoint
from gash_jax.learn.config import ConfigError, OptimConfig, RunConfig
from gash_jax.learn.model import save_model
from gash_jax.learn.objectives import Phase, phases
from gash_jax.nn.registry import build_model

LOG_EVERY = 10

# (phase name, fraction of the phase done, measures of the last logged step)
ReportFn = Callable[[str, float, dict[str, float]], None]


class TrainState(NamedTuple):
    """Everything a resumed run needs; `best` are the parameters with the lowest validation error so far."""

    params: Any
    best: Any
    best_error: float
    optimizer: Any
    phase: int
    step: int
    elapsed: float


def make_optimizer(config: OptimConfig) -> optax.GradientTransformation:
    """Clipped AdamW; the learning rate is applied by the step, which knows how much of the budget is used."""
    return optax.chain(
        optax.clip_by_global_norm(config.clip_norm),
        optax.scale_by_adam(),
        optax.add_decayed_weights(config.weight_decay),
    )


def learning_rate(config: OptimConfig, fraction: float) -> float:
    """Linear warm-up, then cosine to zero; `fraction` of the phase's budget is used."""
    if fraction < config.warmup:
        return config.learning_rate * fraction / config.warmup
    rest = (fraction - config.warmup) / (1.0 - config.warmup)
    return config.learning_rate * 0.5 * (1.0 + float(np.cos(np.pi * min(rest, 1.0))))


@partial(jax.jit, static_argnames=("phase", "optimizer"))
def train_step(
    params: Any, moments: Any, batch: Batch, rate: Array, key: Array, *, phase: Phase, optimizer: Any
) -> tuple[Any, Any, dict[str, Array]]:
    """One step on one batch; only the phase's parameters change (the others have gradient 0)."""
    frozen = {name: value for name, value in params.items() if phase.trainable and name not in phase.trainable}
    chosen = {name: value for name, value in params.items() if name not in frozen}

    def objective(chosen: Any) -> tuple[Array, dict[str, Array]]:
        return phase.loss({**frozen, **chosen}, batch, key)

    (loss, measures), gradients = jax.value_and_grad(objective, has_aux=True)(chosen)
    gradients = {**gradients, **jax.tree.map(jnp.zeros_like, frozen)}
    updates, moments = optimizer.update(gradients, moments, params)
    moved = jax.tree.map(lambda p, u: p - rate * u, params, updates)
    return (
        {**moved, **frozen},
        moments,
        {"loss": loss, "gradient_norm": optax.tree.norm(gradients), **measures},
    )


@partial(jax.jit, static_argnames="phase")
def evaluate_step(params: Any, batch: Batch, *, phase: Phase) -> Array:
    """Validation loss of a batch, without dropout."""
    return phase.loss(params, batch, None)[0]


def validation_batches(examples: Sequence[Example], size: int) -> list[Batch]:
    """Every validation shape exactly once, in padded batches."""
    batches, group, used = [], [], 0
    for example in examples:
        count = len(example.coefficients)
        if group and used + count >= size:
            batches.append(collate(group, size))
            group, used = [], 0
        group.append(example)
        used += count
    return [*batches, collate(group, size)] if group else batches


def _validate(params: Any, batches: Sequence[Batch], phase: Phase) -> float:
    losses = [(float(evaluate_step(params, batch, phase=phase)), int(batch.mask.sum())) for batch in batches]
    return sum(loss * n for loss, n in losses) / max(sum(n for _, n in losses), 1)


def initial_state(config: RunConfig, example: Batch) -> TrainState:
    """Fresh parameters from the seed, optimiser of the first phase."""
    params = build_model(config.model).init(jax.random.key(config.train.seed), example.graph)["params"]
    return TrainState(params, params, float("inf"), make_optimizer(config.optim).init(params), 0, 0, 0.0)


def train_model(
    config: RunConfig,
    training: Sequence[Example],
    validation: Sequence[Example],
    folder: str | Path,
    report: ReportFn | None = None,
) -> Path:
    """Train (or continue) the run in `folder` and return the path of its model file.

    Raises ConfigError if the folder holds a run of another config.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    saved, resolved = folder / "config.json", json.dumps(config.to_dict(), indent=1)
    if saved.exists() and saved.read_text() != resolved:
        raise ConfigError(f"{folder} holds a run with another config: choose another output folder, or delete it")
    saved.write_text(resolved)
    batches = validation_batches(validation, config.train.batch_vertices)
    state = initial_state(config, draw_batch(training, config.train.batch_vertices, config.train.seed, 0))
    if has_checkpoint(folder):
        state = restore_checkpoint(folder, state)
    plan = phases(config.model)
    with open(folder / "metrics.jsonl", "a") as log:
        while state.phase < len(plan):
            state = _train_phase(config, plan[state.phase], state, training, batches, folder, log, report)
            following = state.phase + 1
            error = state.best_error if following == len(plan) else float("inf")
            fresh = make_optimizer(config.optim).init(state.best)
            state = TrainState(state.best, state.best, error, fresh, following, 0, 0.0)
    path = folder / "model.npz"
    save_model(path, config.model, state.best, name=config.name, run=config.to_dict(), validation=state.best_error)
    return path


def _train_phase(config, phase, state, training, batches, folder, log, report) -> TrainState:
    """Run one phase to the end of its budget, logging and checkpointing on the way."""
    train, optimizer = config.train, make_optimizer(config.optim)
    key = jax.random.key(train.seed)
    budget_steps = round(train.steps * phase.share) if train.steps else 0
    started = time.perf_counter() - state.elapsed

    def used(step: int) -> float:
        return step / budget_steps if budget_steps else (time.perf_counter() - started) / (train.seconds * phase.share)

    fresh = state.step == 0
    while (fraction := used(state.step)) < 1.0:
        rate = jnp.float32(learning_rate(config.optim, fraction))
        batch = draw_batch(training, train.batch_vertices, train.seed + 1 + state.phase, state.step)
        step_key = jax.random.fold_in(key, (state.phase << 24) + state.step)
        params, moments, measures = train_step(
            state.params, state.optimizer, batch, rate, step_key, phase=phase, optimizer=optimizer
        )
        state = state._replace(params=params, optimizer=moments, step=state.step + 1)
        if fresh:  # compilation is not training time
            jax.block_until_ready(params)
            _validate(params, batches[:1], phase)
            started, fresh = time.perf_counter(), False
        if state.step % LOG_EVERY == 0:
            values = {name: float(value) for name, value in measures.items()}
            log.write(json.dumps({"phase": phase.name, "step": state.step, "rate": float(rate), **values}) + "\n")
            if report:
                report(phase.name, min(used(state.step), 1.0), values)
        if state.step % train.checkpoint_every == 0:
            state = _note_best(state, batches, phase, log)._replace(elapsed=time.perf_counter() - started)
            save_checkpoint(folder, state)
    state = _note_best(state, batches, phase, log)._replace(elapsed=time.perf_counter() - started)
    save_checkpoint(folder, state)
    return state


def _note_best(state: TrainState, batches: Sequence[Batch], phase: Phase, log: Any) -> TrainState:
    """Keep the parameters if they are the best so far on the validation shapes (or if there are none)."""
    error = _validate(state.params, batches, phase) if batches else 0.0
    log.write(json.dumps({"phase": phase.name, "step": state.step, "validation": error}) + "\n")
    log.flush()
    better = error < state.best_error or not batches
    return state._replace(best=state.params, best_error=error) if better else state
