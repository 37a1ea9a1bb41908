"""The training loop: AdamW, cosine decay, clipped gradients, phases, checkpoints, bit-for-bit resume on a CPU.

A run folder holds `config.json`, `metrics.jsonl`, `events/` (TensorBoard), `checkpoint/` and, when finished,
`model.npz` (best parameters by the validation loss of the last phase). A budget in seconds counts from each phase's
first compiled step; a budget in steps makes the run a function of its config alone. Where JAX sees several devices a
batch is spread over them, whole shapes on each (data parallel through `jax.sharding`); the loss is that of one device.
"""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax.training.dynamic_scale import DynamicScale
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array

from gash_jax.files.atomic import write_text
from gash_jax.files.cores import available_cores
from gash_jax.files.settings import ConfigError
from gash_jax.models.examples import Batch, Example
from gash_jax.models.families import build_model, family_of
from gash_jax.models.model import save_model
from gash_jax.nn.config import ModelConfig
from gash_jax.train.checkpoint import has_checkpoint, restore_checkpoint, save_checkpoint
from gash_jax.train.config import OptimConfig, RunConfig, TrainConfig, load_config
from gash_jax.train.logs import MetricsLog
from gash_jax.train.objectives import Objective, flat, objectives
from gash_jax.train.precision import computes_in_half, initial_scale, scaled_gradients

LOG_EVERY = 10

# (phase name, fraction of the phase done, measures of the last logged step)
ReportFn = Callable[[str, float, dict[str, float]], None]


class DivergenceError(ValueError):
    """The loss of a run is no number any more; the message says what to change."""


class TrainState(NamedTuple):
    """Everything a resumed run needs; `best` are the parameters with the lowest validation loss so far."""

    params: Any
    best: Any
    best_error: float
    optimizer: Any
    scale: DynamicScale
    phase: int
    step: int
    elapsed: float


@cache
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


@partial(jax.jit, static_argnames=("objective", "optimizer", "half"))
def train_step(
    params: Any,
    moments: Any,
    scale: DynamicScale,
    batch: Batch,
    rate: Array,
    key: Array,
    *,
    objective: Objective,
    optimizer: Any,
    half: bool = False,
) -> tuple[Any, Any, DynamicScale, dict[str, Array]]:
    """One step on one batch; only the phase's parameters change (the others have gradient 0).

    A step whose gradients overflowed in half precision changes nothing but the loss scale.
    """
    trainable = objective.phase.trainable
    frozen = {name: value for name, value in params.items() if trainable and name not in trainable}
    chosen = {name: value for name, value in params.items() if name not in frozen}
    loss, gradients, scale, finite = scaled_gradients(
        lambda chosen: objective.loss({**frozen, **chosen}, batch, key), chosen, scale, half
    )
    gradients = {**gradients, **jax.tree.map(jnp.zeros_like, frozen)}
    updates, after = optimizer.update(gradients, moments, params)
    moved = {**jax.tree.map(lambda p, u: p - rate * u, params, updates), **frozen}
    if half:
        keep = lambda new, old: jnp.where(finite, new, old)  # noqa: E731
        moved, after = jax.tree.map(keep, moved, params), jax.tree.map(keep, after, moments)
    measures = {"loss": loss, "gradient_norm": optax.tree.norm(gradients)}
    return moved, after, scale, measures | ({"scale": jnp.asarray(scale.scale)} if half else {})


@partial(jax.jit, static_argnames="objective")
def predict_step(params: Any, batch: Batch, *, objective: Objective) -> Array:
    """Output of every vertex of a batch, without dropout."""
    return objective.output(params, batch, None)


def validate(params: Any, batches: Sequence[Batch], objective: Objective) -> dict[str, float]:
    """Loss and measures over the vertices of all validation shapes together."""
    outputs, labels, normals = [], [], []
    for batch in batches:
        mask = np.asarray(flat(batch.mask))
        outputs.append(np.asarray(predict_step(params, batch, objective=objective))[mask])
        labels.append(np.asarray(flat(getattr(batch, objective.phase.labels)))[mask])
        normals.append(np.asarray(flat(batch.normals))[mask])
    output, label, normal = (np.concatenate(arrays) for arrays in (outputs, labels, normals))
    loss = float(objective.phase.loss(jnp.asarray(output), jnp.asarray(label), jnp.ones(len(output), bool)))
    return {"validation": loss, **objective.measure(output, label, normal)}


@cache
def _initialiser(config: ModelConfig) -> Callable[..., Any]:
    return jax.jit(build_model(config).init)


def initial_state(config: RunConfig, example: Batch) -> TrainState:
    """Fresh parameters from the seed, optimiser of the first phase."""
    inputs = jax.tree.map(lambda leaf: leaf[0], example.inputs)
    params = _initialiser(config.model)(jax.random.key(config.train.seed), inputs)["params"]
    moments, scale = make_optimizer(config.optim).init(params), initial_scale(computes_in_half(config.train.precision))
    return TrainState(params, params, float("inf"), moments, scale, 0, 0, 0.0)


def _open_folder(folder: Path, config: RunConfig) -> None:
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
) -> Path:
    """Train (or continue) the run in `folder` and return the path of its model file.

    `start` are parameters to begin with instead of random ones. A finished run goes on if its budget was raised.
    `notify` gets what a user should know. Raises ConfigError if the folder holds a run of another config or no whole
    checkpoint, DivergenceError where the loss is not finite.
    """
    folder = Path(folder)
    _open_folder(folder, config)
    put_together = family_of(config.model).batches
    batches = put_together(validation).in_order(config.train.batch_vertices) if validation else []
    draw = put_together(training).draw
    state = initial_state(config, draw(config.train.batch_vertices, config.train.seed, 0, 1))
    if start is not None:
        state = state._replace(params=start, best=start)
    if has_checkpoint(folder):
        state, note = restore_checkpoint(folder, state)
        if note:
            notify(note)
    plan = objectives(config.model, computes_in_half(config.train.precision))
    with MetricsLog(folder, [objective.phase.name for objective in plan], int(state.phase), int(state.step)) as log:
        while state.phase < len(plan):
            state = _PhaseRun(config, plan[state.phase], draw, batches, folder, log, report).run(state)
            following = state.phase + 1
            error = state.best_error if following == len(plan) else float("inf")
            fresh = make_optimizer(config.optim).init(state.best)
            state = state._replace(
                params=state.best, best_error=error, optimizer=fresh, phase=following, step=0, elapsed=0.0
            )
    path = folder / "model.npz"
    save_model(path, config.model, state.best, name=config.name, run=config.to_dict(), validation=state.best_error)
    return path


def make_clock(config: TrainConfig) -> Callable[[], float]:
    """Seconds on the wall, or CPU seconds of this process for each core it may use."""
    cores = available_cores()
    return time.perf_counter if config.clock == "wall" else lambda: time.process_time() / cores


class _PhaseRun(NamedTuple):
    """One phase to the end of its budget, logging and checkpointing on the way."""

    config: RunConfig
    objective: Objective
    draw: Callable[[int, int, int, int], Batch]  # (vertices, seed, step, shards)
    batches: Sequence[Batch]
    folder: Path
    log: MetricsLog
    report: ReportFn | None

    def run(self, state: TrainState) -> TrainState:
        train, clock = self.config.train, make_clock(self.config.train)
        half, optimizer = computes_in_half(train.precision), make_optimizer(self.config.optim)
        devices, key = jax.devices(), jax.random.key(train.seed)
        place = _placement(devices)
        share = self.objective.phase.share
        budget_steps = max(1, round(train.steps * share)) if train.steps else 0
        started, first = clock() - state.elapsed, True

        def used(step: int) -> float:
            return step / budget_steps if budget_steps else (clock() - started) / (train.seconds * share)

        while (fraction := used(state.step)) < 1.0:
            rate = jnp.float32(learning_rate(self.config.optim, fraction))
            seed = train.seed + 1 + state.phase
            batch = place(self.draw(train.batch_vertices, seed, state.step, len(devices)))
            step_key = jax.random.fold_in(key, (state.phase << 24) + state.step)
            params, moments, scale, measures = train_step(
                *(state.params, state.optimizer, state.scale, batch, rate, step_key),
                **{"objective": self.objective, "optimizer": optimizer, "half": half},
            )
            state = state._replace(params=params, optimizer=moments, scale=scale, step=state.step + 1)
            if first:  # compilation is not training time, neither at the beginning nor after an interruption
                jax.block_until_ready(params)
                validate(params, self.batches[:1], self.objective)
                started, first = clock() - state.elapsed, False
            if state.step % LOG_EVERY == 0:
                self._log(state, float(rate), measures, used(state.step))
            if state.step % train.checkpoint_every == 0:
                elapsed = clock() - started
                state = self._checkpoint(state, elapsed)
                started = clock() - elapsed  # validation is not training time either
        return self._checkpoint(state, clock() - started)

    def _log(self, state: TrainState, rate: float, measures: dict[str, Array], fraction: float) -> None:
        values = {"rate": rate, **{name: float(value) for name, value in measures.items()}}
        # in half precision a step may overflow, is skipped, and halves the scale: only a vanished scale is a failure
        if not np.isfinite(values["loss"]) and values.get("scale", 0.0) < 1.0:
            raise DivergenceError(
                f"the loss is {values['loss']} at step {state.step}: lower optim.learning_rate and start again"
            )
        self.log.write(state.phase, state.step, values)
        if self.report:
            self.report(self.objective.phase.name, min(fraction, 1.0), values)

    def _checkpoint(self, state: TrainState, elapsed: float) -> TrainState:
        """Keep the parameters if they are the best so far on the validation shapes (or if there are none); save."""
        if self.batches:
            values = validate(state.params, self.batches, self.objective)
            self.log.write(state.phase, state.step, values)
            if values["validation"] < state.best_error:
                state = state._replace(best=state.params, best_error=values["validation"])
        else:
            state = state._replace(best=state.params)
        state = state._replace(elapsed=elapsed)
        save_checkpoint(self.folder, state)
        return state


def _placement(devices: Sequence[jax.Device]) -> Callable[[Batch], Batch]:
    """Put shard i on device i; nothing to do on one."""
    if len(devices) == 1:
        return lambda batch: batch
    sharding = NamedSharding(Mesh(np.array(devices), ("shard",)), PartitionSpec("shard"))
    return lambda batch: jax.device_put(batch, sharding)
