"""Train the network of `gash bake --guided` on generated shapes.

    .venv/bin/python -m experiments.guided.train --output src/gash_jax/weights/reconstruction/guided.npz

The error of a mesh counts relative to that of its own rays, band by band, so that all meshes and all numbers of rays
count alike. Half of the steps see one number of rays, the others more rays where more is hidden, as a bake to an error
has them.
"""

import math
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax.traverse_util import flatten_dict

from benchmarks.options import parser
from experiments.guided.examples import COUNTS, Example, load_examples
from gash_jax.apps.progress import progress_bar
from gash_jax.files.caches import keep_compiled_programs
from gash_jax.files.npz import write_npz
from gash_jax.measure.provenance import provenance
from gash_jax.nn.reconstruction import Around, Reconstruction, Seen, by_band, edge_features, reference_noise

SEED, SHAPES, STEPS = 31, 64, 2500
SIZES = (1024, 2048, 4096, 8192, 16384)  # of padded meshes
BAND_WEIGHTS = np.array([2, 2, 2, 1, 1, 1], np.float32) / 9
EXPECTED = 0.02  # weight of the expected error
LEARNING_RATE = 1e-2


def padded(example: Example) -> dict[str, Any]:
    """A mesh in one of a few sizes; vertices that fill it up have no edge."""
    count = len(example.places)
    size = next(size for size in SIZES if size >= count)

    def fill(array: np.ndarray) -> np.ndarray:
        return np.concatenate([array, np.zeros((size - count, *array.shape[1:]), array.dtype)])

    rows = {name: fill(getattr(example, name)) for name in ("places", "normals", "table", "found", "truth", "doubt")}
    rows = {name: jnp.asarray(array.T) for name, array in rows.items()}  # vertices last, as in the network
    return {**rows, "real": np.arange(size) < count}


def draw_counts(rng: np.random.Generator, example: Example) -> np.ndarray:
    """An index of COUNTS for every vertex: one for all, or more where more is hidden."""
    count, most = len(example.places), len(COUNTS) - 1
    if rng.random() < 0.5:
        return np.full(count, rng.integers(most + 1))
    share = example.shares[1][example.table].mean(axis=1)
    urgency = np.log2(share * (1 - share) + 0.01)
    level = rng.uniform(1, 6) + rng.uniform(0, 1) * (urgency - urgency.mean()) + rng.normal(0, 0.3, count)
    return np.clip(np.rint(level), 1, most).astype(int)


def step_loss(
    module: Reconstruction, params: Any, mesh: dict[str, Any], residual: jax.Array, rays: jax.Array, share: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Error relative to that of the mesh's own rays, mean over bands; with the likelihood of the expected error."""
    places, normals, table, found, real = (mesh[name] for name in ("places", "normals", "table", "found", "real"))
    edges = edge_features(places, normals, places[:, table], normals[:, table], found)
    seen = Seen(residual, reference_noise(rays, share, module.bands), rays, share)
    applied: Any = module.apply({"params": params}, seen, table, Around(edges, found))
    rebuilt, expected = applied

    def error(values: jax.Array) -> jax.Array:
        return jnp.where(real, by_band((values - mesh["truth"]) ** 2, module.bands), 0)

    # without what the bake itself is off by, on average
    left, own, doubt, count = error(rebuilt), error(residual).sum(axis=1), mesh["doubt"], jnp.sum(real)
    ratio = (left - doubt).sum(axis=1) / (jnp.maximum(own - doubt.sum(axis=1), 0.3 * own) + 1e-7 * count)
    likelihood = jnp.where(real, (left - doubt) / expected + jnp.log(expected), 0).sum() / count / module.bands
    # the square: a mesh that gains nothing weighs more than one that gains twice
    return jnp.sum(BAND_WEIGHTS * (ratio + 0.5 * ratio**2)) + EXPECTED * likelihood, jnp.sum(BAND_WEIGHTS * ratio)


def train(
    examples: list[Example], steps: int, seed: int = 0, report: Callable[[int, int], None] | None = None
) -> tuple[Reconstruction, Any, list[float]]:
    """The module, its weights, and the ratio of every step."""
    module, rng = Reconstruction(), np.random.default_rng(seed)
    meshes = [padded(example) for example in examples]
    first, size = meshes[0], len(meshes[0]["real"])
    edges, ones = jnp.zeros((5, *first["table"].shape)), jnp.ones(size)
    blank = Seen(jnp.zeros(first["truth"].shape), jnp.ones((module.bands, size)), ones, ones)
    params = module.init(jax.random.PRNGKey(seed), blank, first["table"], Around(edges, first["found"]))["params"]
    optimiser = optax.chain(
        optax.clip_by_global_norm(1.0), optax.adam(optax.cosine_decay_schedule(LEARNING_RATE, steps))
    )
    state, ratios = optimiser.init(params), []

    @jax.jit
    def update(params: Any, state: Any, *arrays: Any) -> tuple[Any, Any, jax.Array]:
        gradient, ratio = jax.grad(partial(step_loss, module), has_aux=True)(params, *arrays)
        change, state = optimiser.update(gradient, state)
        return optax.apply_updates(params, change), state, ratio

    for step in range(steps):
        number = rng.integers(len(examples))
        example, mesh = examples[number], meshes[number]
        chosen = draw_counts(rng, example)
        size, count, k = len(mesh["real"]), len(chosen), len(mesh["truth"])
        residual, share, rays = np.zeros((k, size), np.float32), np.zeros(size, np.float32), np.ones(size, np.float32)
        everyone = np.arange(count)
        residual[:, :count], share[:count] = example.residuals[chosen, everyone].T, example.shares[chosen, everyone]
        rays[:count] = np.array(COUNTS)[chosen]
        params, state, ratio = update(params, state, mesh, residual, rays, share)
        ratios.append(float(ratio))
        if report:
            report(step + 1, steps)
    return module, params, ratios


def main(output: Path, shapes: int, steps: int) -> None:
    keep_compiled_programs()
    with progress_bar(f"{shapes} shapes") as update:
        examples = load_examples(SEED, shapes, update)
    with progress_bar("training") as update:
        module, params, ratios = train(examples, steps, report=update)
    last = math.fsum(ratios[-steps // 5 :]) / len(ratios[-steps // 5 :])
    print(f"error of the last fifth of the steps, relative to that of the rays: {last:.3f}")
    arrays = {name: np.asarray(leaf) for name, leaf in flatten_dict(params, sep="/").items()}
    sizes = [module.hidden, module.bands]
    output.parent.mkdir(parents=True, exist_ok=True)
    write_npz(
        output, arrays, {**provenance(seed=SEED), "sizes": sizes, "shapes": shapes, "steps": steps, "ratio": last}
    )


if __name__ == "__main__":
    command = parser(__doc__, "output")
    command.add_argument("--shapes", type=int, default=SHAPES)
    command.add_argument("--steps", type=int, default=STEPS)
    main(**vars(command.parse_args()))
