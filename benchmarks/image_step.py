"""One training step of DeepPRT's U-Net at its shipped sizes: is it right, how long does it take, what memory.

    .venv/bin/python -m benchmarks.image_step --output docs/results/image_step.json

A batch of frames of a generated body with bumps, as geometry images. *Gradient*: the slope of the loss along the
gradient, by a difference quotient, over the gradient's squared length, which should be 1; taken with a head of random
numbers, as with that of a fresh network, of zeros, no other layer has a gradient. *Memory*: what the compiled
step allots, arguments and temporary arrays together. FLOPs are those that XLA counts.
"""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.options import options, saved
from gash_jax.geometry.geometry_image import geometry_image
from gash_jax.geometry.parameterisation import parameterise
from gash_jax.measure.provenance import provenance
from gash_jax.models.training_poses import TrainingPoses
from gash_jax.nn.unet import UNetConfig, build_unet
from gash_jax.prt.bake import bake_transfer
from gash_jax.prt.sequence import posed_meshes
from gash_jax.shapes.deformations import blendshape_animation
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.config import RunConfig, load_config
from gash_jax.train.image_training import (
    Images,
    ImageState,
    arrays_of_poses,
    frames_as_images,
    image_step,
    initial_state,
)
from gash_jax.train.step import make_optimizer

CONFIGS = ("deep-prt-small", "deep-prt")
STEPS = 3
ALONG = 1e-4  # of the parameters' length: how far the difference quotient goes


def batch_of(config: UNetConfig, frames: int, detail: int) -> Images:
    """Some frames of a generated body that deforms, baked with few rays."""
    moving = blendshape_animation(bumpy_sphere(detail), 0, frames, 4)
    baked = [bake_transfer(mesh, config.bands, 64).coefficients.astype(np.float16) for mesh in posed_meshes(moving)]
    image = geometry_image(parameterise(moving.mesh), config.size)
    poses = TrainingPoses(moving, [np.stack(baked)])
    return frames_as_images(arrays_of_poses(config, image, poses), image, poses)


def with_random_head(state: ImageState) -> ImageState:
    """The same network, its head of random numbers."""
    head = state.params["head"]
    kernel = 0.1 * jax.random.normal(jax.random.key(1), head["kernel"].shape)
    return state._replace(params={**state.params, "head": {**head, "kernel": kernel}})


def slope_over_gradient(config: UNetConfig, state: Any, inputs: jax.Array, targets: jax.Array) -> float:
    """How fast the loss grows along the gradient, over how fast it should (module docstring)."""

    @jax.jit
    def loss(params: Any) -> jax.Array:
        variables = {"params": params, "batch_stats": state.means}
        network = build_unet(config, targets.shape[-1])
        found: Any = network.apply(variables, inputs, training=True, mutable=["batch_stats"])[0]
        return jnp.mean(jnp.abs(found - targets))

    def length(tree: Any) -> float:
        return float(sum(np.sum(np.asarray(leaf, np.float64) ** 2) for leaf in jax.tree.leaves(tree))) ** 0.5

    gradient = jax.grad(loss)(state.params)
    step = ALONG * length(state.params) / length(gradient)

    def moved(by: float) -> float:
        return float(loss(jax.tree.map(lambda p, g: p + by * g, state.params, gradient)))

    return (moved(step) - moved(-step)) / (2 * step) / length(gradient) ** 2


def measure(run: RunConfig, images: Images) -> dict[str, Any]:
    """Figures of one config, and what a step does to the loss of its own batch."""
    config, optimizer = cast("UNetConfig", run.model), make_optimizer(run.optim)
    state = initial_state(run, images)
    inputs, targets = (jnp.asarray(part, jnp.float32) for part in (images.inputs, images.targets))
    slope = slope_over_gradient(config, with_random_head(state), inputs, targets)
    rate, static = jnp.float32(run.optim.learning_rate), {"config": config, "optimizer": optimizer}
    arguments = (state.params, state.means, state.moments, inputs, targets, rate)
    started = time.perf_counter()
    step = image_step.lower(*arguments, **static).compile()
    compiled = time.perf_counter() - started
    held, counted = step.memory_analysis(), step.cost_analysis()
    assert held is not None and counted is not None
    kept, losses, seconds = arguments[:3], [], []
    for _ in range(STEPS):
        started = time.perf_counter()
        *kept, loss = step(*kept, *arguments[3:])
        losses.append(float(jax.block_until_ready(loss)))
        seconds.append(time.perf_counter() - started)
    return {
        "config": run.name,
        "parameters": sum(leaf.size for leaf in jax.tree.leaves(kept[0])),
        "size": config.size,
        "frames": len(inputs),
        "slope_over_gradient": slope,
        "losses": losses,
        "finite": all(bool(jnp.isfinite(leaf).all()) for leaf in jax.tree.leaves(kept)),
        "seconds": float(np.median(seconds)),
        "compile_seconds": compiled,
        "bytes": held.argument_size_in_bytes + held.temp_size_in_bytes,
        "flops": counted["flops"],
    }


def main(output: Path | None, quick: bool) -> dict[str, Any]:
    """Measure the shipped configs; `quick`: one tiny network."""
    rows = []
    for name in CONFIGS[:1] if quick else CONFIGS:
        run = load_config(name)
        if quick:
            run = replace(run, model=UNetConfig("deep-prt", bands=2, size=32, channels=3, levels=2, changes=True))
        config = cast("UNetConfig", run.model)
        rows.append(measure(run, batch_of(config, 2 if quick else run.train.batch_frames, 4 if quick else 32)))
        print(rows[-1], flush=True)
    return saved(output, {**provenance(seed=0, arguments={"steps": STEPS}), "rows": rows})


if __name__ == "__main__":
    main(**options(__doc__, "output", "quick"))
