"""One phase of training to the end of its budget, with its log lines and checkpoints.

A budget in seconds counts from the phase's first compiled step; a budget in steps makes the run a function of its
config alone. Where JAX sees several devices a batch is spread over them, whole shapes on each (data parallel through
`jax.sharding`); the loss is that of one device.
"""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax.training.dynamic_scale import DynamicScale
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Array

from gash_jax.files.cores import available_cores
from gash_jax.models.examples import Batch
from gash_jax.train.checkpoint import save_checkpoint
from gash_jax.train.config import RunConfig, TrainConfig
from gash_jax.train.logs import MetricsLog
from gash_jax.train.objectives import Objective
from gash_jax.train.precision import computes_in_half
from gash_jax.train.step import learning_rate, make_optimizer, train_step, validate

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


def make_clock(config: TrainConfig) -> Callable[[], float]:
    """Seconds on the wall, or CPU seconds of this process for each core it may use."""
    cores = available_cores()
    return time.perf_counter if config.clock == "wall" else lambda: time.process_time() / cores


class PhaseRun(NamedTuple):
    """One phase to the end of its budget, logging and checkpointing on the way."""

    config: RunConfig
    objective: Objective
    draw: Callable[[int, int, int, int], Batch]  # (vertices, seed, step, shards)
    batches: Sequence[Batch]
    folder: Path
    log: MetricsLog
    report: ReportFn | None

    def run(self, state: TrainState) -> TrainState:
        """The state at the end of the phase. Raises DivergenceError where the loss is no number any more."""
        train, clock = self.config.train, make_clock(self.config.train)
        half, optimizer = computes_in_half(train.precision), make_optimizer(self.config.optim)
        devices, key = jax.devices(), jax.random.key(train.seed)
        place = placement(devices)
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


def placement(devices: Sequence[jax.Device]) -> Callable[[Batch], Batch]:
    """Put shard i on device i; nothing to do on one."""
    if len(devices) == 1:
        return lambda batch: batch
    sharding = NamedSharding(Mesh(np.array(devices), ("shard",)), PartitionSpec("shard"))
    return lambda batch: jax.device_put(batch, sharding)
