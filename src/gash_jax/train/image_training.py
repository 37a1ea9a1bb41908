"""Train the U-Net of `models.deep_prt` on the frames of an object: L1 between images, Adam, batches of a few frames.

A run that was interrupted goes on from its last checkpoint, bit for bit on a CPU: which frames a step sees, and its
learning rate, follow from its number alone.
"""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, Float

from gash_jax.geometry.geometry_image import GeometryImage, geometry_image
from gash_jax.geometry.image_fit import image_fit
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.models.deep_prt import (
    MEAN,
    change_arrays,
    image_arrays,
    inputs_of,
    network_arrays,
    pose_image,
)
from gash_jax.models.pose_reader import fit_reader, reader_arrays
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.nn.unet import UNetConfig, build_unet
from gash_jax.prt.sequence import posed_meshes
from gash_jax.train.checkpoint import has_checkpoint, restore_checkpoint, save_checkpoint
from gash_jax.train.config import RunConfig
from gash_jax.train.logs import MetricsLog
from gash_jax.train.phase_run import LOG_EVERY, DivergenceError, make_clock
from gash_jax.train.step import learning_rate, make_optimizer

PHASE = "images"
ROOM = 0.01  # of a channel's range, on either side of what was seen: a sigmoid never reaches its ends


class ImageState(NamedTuple):
    """Everything that a resumed run needs."""

    params: Any
    means: Any  # of batch normalisation
    moments: Any
    step: int
    elapsed: float


class Images(NamedTuple):
    """Frames as images, float16; targets as shares of each channel's range."""

    inputs: Float[np.ndarray, "t n n i"]
    targets: Float[np.ndarray, "t n n c"]
    low: Float[np.ndarray, "c"]
    high: Float[np.ndarray, "c"]


def arrays_of_poses(config: UNetConfig, image: GeometryImage, poses: TrainingPoses) -> dict[str, np.ndarray]:
    """All that a model keeps but its network: the image of its rest, and with `model.changes` the means."""
    arrays = image_arrays(image, poses.animation.mesh)
    if config.changes:
        arrays |= change_arrays(arrays, posed_meshes(poses.animation), _frames(poses))
    return arrays


def frames_as_images(arrays: dict[str, np.ndarray], image: GeometryImage, poses: TrainingPoses) -> Images:
    """All frames of an animation as images by the map of its rest; targets are those that give vertices most back."""
    fit, size, count, mean = image_fit(image), len(image.face), len(poses.animation), arrays.get(MEAN, np.float32(0))
    inputs = np.empty((count, size, size, *pose_image(arrays, *poses.animation.mesh[:2]).shape[2:]), np.float16)
    targets = np.empty((count, size, size, poses.shards[0].shape[-1]), np.float16)
    for t, (mesh, frame) in enumerate(zip(posed_meshes(poses.animation), _frames(poses), strict=True)):
        inputs[t] = pose_image(arrays, mesh.vertices, mesh.normals)
        targets[t] = fit(np.asarray(frame, np.float32) - mean)
    low, high = (np.asarray(find(targets, axis=(0, 1, 2)), np.float32) for find in (np.min, np.max))
    room = np.maximum(ROOM * (high - low), 1e-3 * np.abs(high + low) + 1e-6)  # some channels hardly change
    low, high = low - room, high + room
    for t in range(count):
        targets[t] = (targets[t] - low) / (high - low)
    return Images(inputs, targets, low, high)


def _frames(poses: TrainingPoses) -> Iterator[Float[np.ndarray, "v c"]]:
    return (frame for shard in poses.shards for frame in shard)


@partial(jax.jit, static_argnames=("config", "optimizer"), donate_argnames=("params", "means", "moments"))
def image_step(
    params: Any,
    means: Any,
    moments: Any,
    inputs: Float[Array, "b n n i"],
    targets: Float[Array, "b n n c"],
    rate: Array,
    *,
    config: UNetConfig,
    optimizer: optax.GradientTransformation,
) -> tuple[Any, Any, Any, Array]:
    """One step; parameters, running means and moments of the optimiser after it, and the loss before it."""

    def loss(chosen: Any) -> tuple[Array, Any]:
        found, changed = build_unet(config, targets.shape[-1]).apply(
            {"params": chosen, "batch_stats": means}, inputs, training=True, mutable=["batch_stats"]
        )
        return jnp.mean(jnp.abs(found - targets)), changed["batch_stats"]

    (value, after), gradients = jax.value_and_grad(loss, has_aux=True)(params)
    updates, moments = optimizer.update(gradients, moments, params)
    return jax.tree.map(lambda p, u: p - rate * u, params, updates), after, moments, value


def fit_deep_prt(
    run: RunConfig, poses: TrainingPoses, folder: Path, report: Callable[[float], None]
) -> dict[str, np.ndarray]:
    """The arrays of a trained model. Raises DivergenceError where the loss is no number any more, MeshError for a mesh
    that has no map to the square."""
    rest, config = poses.animation.mesh, cast("UNetConfig", run.model)
    image = geometry_image(parameterise(rest), config.size)
    arrays = arrays_of_poses(config, image, poses)
    images = frames_as_images(arrays, image, poses)
    state = train_images(run, images, folder, report)
    trained = network_arrays({"params": state.params, "batch_stats": state.means})
    ranges = {"low": images.low, "high": images.high}
    return {**reader_arrays(fit_reader(poses.animation)[0]), **arrays, **ranges, **trained}


def initial_state(run: RunConfig, images: Images) -> ImageState:
    """Fresh parameters from the seed, of a network that says the mean of all texels of its targets.

    From random images a network of mere changes came to say nothing at all: it first unlearns them, and its last
    ReLUs with them.
    """
    config = cast("UNetConfig", run.model)
    blank = jnp.zeros((1, config.size, config.size, inputs_of(config)), jnp.float32)
    found = jax.jit(build_unet(config, len(images.low)).init)(jax.random.key(run.train.seed), blank)
    share = np.mean([image.mean(axis=(0, 1), dtype=np.float64) for image in images.targets], axis=0)
    head, bias = found["params"]["head"], np.tile(np.log(share / (1 - share)), config.fold**2)
    found["params"]["head"] = {"kernel": jnp.zeros_like(head["kernel"]), "bias": jnp.asarray(bias, jnp.float32)}
    return ImageState(found["params"], found["batch_stats"], make_optimizer(run.optim).init(found["params"]), 0, 0.0)


def train_images(run: RunConfig, images: Images, folder: Path, report: Callable[[float], None]) -> ImageState:
    """Train to the end of the budget, from where the folder's checkpoint stands."""
    train, clock, optimizer = run.train, make_clock(run.train), make_optimizer(run.optim)
    state, first = initial_state(run, images), True
    if has_checkpoint(folder):
        state = restore_checkpoint(folder, state)[0]
    started = clock() - state.elapsed

    def used(step: int) -> float:
        return step / train.steps if train.steps else (clock() - started) / train.seconds

    with MetricsLog(folder, [PHASE], 0, int(state.step)) as log:
        while (fraction := used(state.step)) < 1.0:
            rate = jnp.float32(learning_rate(run.optim, fraction))
            frames = _frames_of_step(train.seed, int(state.step), len(images.inputs), train.batch_frames)
            batch = (jnp.asarray(part[frames], jnp.float32) for part in (images.inputs, images.targets))
            params, means, moments, loss = image_step(
                *(state.params, state.means, state.moments), *batch, rate, config=run.model, optimizer=optimizer
            )
            state = ImageState(params, means, moments, state.step + 1, state.elapsed)
            if first:  # compilation is not training time, neither at the beginning nor after an interruption
                jax.block_until_ready(params)
                started, first = clock() - state.elapsed, False
            if state.step % LOG_EVERY == 0 or used(state.step) >= 1.0:
                _log(log, state, float(rate), float(loss))
                report(min(used(state.step), 1.0))
            if state.step % train.checkpoint_every == 0:
                state = state._replace(elapsed=clock() - started)
                save_checkpoint(folder, state)
                started = clock() - state.elapsed
    state = state._replace(elapsed=clock() - started)
    save_checkpoint(folder, state)
    return state


def _frames_of_step(seed: int, step: int, count: int, batch: int) -> np.ndarray:
    """Frames of a batch: every epoch is a permutation of its own, of which steps take their parts."""
    steps = max(count // batch, 1)
    epoch, part = divmod(step, steps)
    return np.random.default_rng([seed, epoch]).permutation(count)[part * batch : (part + 1) * batch]


def _log(log: MetricsLog, state: ImageState, rate: float, loss: float) -> None:
    if not np.isfinite(loss):
        raise DivergenceError(
            f"the loss is {loss} at step {state.step}: lower optim.learning_rate and start again in another folder"
        )
    log.write(0, int(state.step), {"rate": rate, "loss": loss})
