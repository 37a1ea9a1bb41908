"""Data parallel: the same batches and the same loss on four devices as on one."""

import json
import os
import subprocess
import sys

import jax
import numpy as np
import pytest

from gash_jax.models.examples import Example, WholeShapes
from gash_jax.models.families import build_model, model_config, model_graph
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train.objectives import flat, objectives
from tests.conftest import FAST_COMPILATION
from tests.helpers.bumpy import random_variables

SCRIPT = """
import json, sys
import jax, numpy as np
from flax.traverse_util import flatten_dict
from gash_jax.models.examples import Example
from gash_jax.models.families import family_of, model_config, model_graph
from gash_jax.models.model import load_model
from gash_jax.shapes.primitives import bumpy_sphere
from gash_jax.train import phase_run
from gash_jax.train.config import RunConfig, TrainConfig
from gash_jax.train.loop import initial_state, train_model
from gash_jax.train.objectives import objectives
from gash_jax.train.step import make_optimizer, train_step

phase_run.LOG_EVERY, SIZE, ALL = 1, 600, jax.devices()
rng, meshes = np.random.default_rng(0), [bumpy_sphere(size) for size in (2, 3, 4, 3, 2, 4, 3)]
labels = [rng.normal(0.3, 0.2, (len(mesh.vertices), 9)).astype(np.float32) for mesh in meshes]
seen = [(rng.random((len(mesh.vertices), 25)) < 0.7).astype(np.float32) for mesh in meshes]

def steps(run, examples, devices):
    # two steps of every phase
    draw, optimizer = family_of(run.model).batches(examples).draw, make_optimizer(run.optim)
    state, losses, place = initial_state(run, draw(SIZE, 0, 0, 1)), [], phase_run.placement(devices)
    params, moments, used = state.params, state.optimizer, set()
    for objective in objectives(run.model):
        for step in range(2):
            batch = place(draw(SIZE, 0, step, len(devices)))
            used |= {s.device for s in batch.coefficients.addressable_shards} if len(devices) > 1 else set(devices)
            params, moments, _, measures = train_step(
                params, moments, state.scale, batch, np.float32(1e-3), jax.random.key(0),
                objective=objective, optimizer=optimizer)
            losses.append(float(measures["loss"]))
    return len(used), losses, params

def whole_run(run, examples, devices):
    # the whole loop, in the folder that is the second argument
    jax.devices = lambda: devices
    path = train_model(run, examples, examples[:1], f"{sys.argv[2]}/{len(devices)}")
    lines = [json.loads(line) for line in open(path.parent / "metrics.jsonl")]
    return len(devices), [line["loss"] for line in lines if "loss" in line], load_model(path).params

found = {}
for net, options in json.loads(sys.argv[1]).items():
    config = model_config(**options)
    examples = [Example(model_graph(config, m), y, v) for m, y, v in zip(meshes, labels, seen)]
    run = RunConfig(model=config, train=TrainConfig(steps=6, batch_vertices=SIZE, checkpoint_every=100))
    for count in (4, 1):
        used, losses, params = (whole_run if net == "mlp" else steps)(run, examples, ALL[:count])
        weights = {name: np.asarray(leaf).tolist() for name, leaf in flatten_dict(params, sep="/").items()}
        found[f"{net}/{count}"] = {"used": used, "losses": losses, "weights": weights}
print(json.dumps(found))
"""
NETS = {
    "mlp": {"name": "mlp", "channels": 8, "layers": 1},
    "two-stage": {
        **{"name": "two-stage", "channels": 8, "layers": 1, "heads": 2, "neighbours": 6, "dropout": 0.0},
        **{"visibility_channels": 8, "visibility_layers": 1},
    },
    "rings": {"name": "rings", "channels": 8, "layers": 1, "heads": 2},
    "local": {"name": "local", "channels": 8, "layers": 1},
}


@pytest.mark.slow
def test_four_devices_give_the_loss_of_one(tmp_path) -> None:
    flags = f"--xla_force_host_platform_device_count=4 {FAST_COMPILATION}"
    command = [sys.executable, "-c", SCRIPT, json.dumps(NETS), str(tmp_path)]
    done = subprocess.run(command, env={**os.environ, "XLA_FLAGS": flags}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    found = json.loads(done.stdout.splitlines()[-1])
    for net in NETS:
        four, one = found[f"{net}/4"], found[f"{net}/1"]
        assert (four["used"], one["used"]) == (4, 1), net
        assert len(one["losses"]) == (6 if net == "mlp" else 2 if net == "rings" else 4)
        np.testing.assert_allclose(four["losses"], one["losses"], rtol=1e-5, err_msg=net)
        for name, value in one["weights"].items():
            limit = 1e-4 * max(1, np.abs(value).max())
            np.testing.assert_allclose(four["weights"][name], value, atol=limit, err_msg=f"{net} {name}")


def _examples() -> list[Example]:
    config, rng, found = model_config(**NETS["mlp"]), np.random.default_rng(1), []
    for size in (4, 9, 5, 6):
        mesh = bumpy_sphere(size)
        labels = rng.normal(size, 0.2, (len(mesh.vertices), 9)).astype(np.float32)
        found.append(Example(model_graph(config, mesh), labels, np.ones((len(mesh.vertices), 25), np.float32)))
    return found


def test_shards_hold_the_same_shapes_and_weigh_vertices_not_shards() -> None:
    examples = _examples()
    total = sum(len(example.coefficients) for example in examples) + 1
    module, phase = build_model(model_config(**NETS["mlp"])), objectives(model_config(**NETS["mlp"]))[0]
    params = random_variables(module, examples[0].graph)["params"]
    batches = {shards: WholeShapes(examples).draw(total, 0, 0, shards) for shards in (1, 2, 4)}
    losses = {shards: float(phase.loss(params, batch, None)) for shards, batch in batches.items()}
    labels = {
        s: np.sort(np.asarray(flat(b.coefficients))[np.asarray(flat(b.mask))], axis=0) for s, b in batches.items()
    }
    for shards in (2, 4):
        np.testing.assert_array_equal(labels[shards], labels[1])
        assert losses[shards] == pytest.approx(losses[1], rel=1e-5)
    # a mean of the shards' means would be another number here: the shards have different sizes and labels
    four = batches[4]
    alone = [phase.loss(params, jax.tree.map(lambda a, i=i: a[i : i + 1], four), None) for i in range(4)]
    assert abs(float(np.mean(alone)) - losses[1]) > 1e-2 * losses[1]


def test_devices_without_a_shape_count_for_nothing() -> None:
    examples = _examples()[:2]
    module, phase = build_model(model_config(**NETS["mlp"])), objectives(model_config(**NETS["mlp"]))[0]
    params = random_variables(module, examples[0].graph)["params"]
    one, four = (WholeShapes(examples).draw(2000, 0, 0, shards) for shards in (1, 4))
    assert four.mask.any(axis=1).tolist() == [True, True, False, False] and not four.weight[2:].any()
    assert float(phase.loss(params, four, None)) == pytest.approx(float(phase.loss(params, one, None)), rel=1e-5)
